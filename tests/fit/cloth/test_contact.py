"""Contact forces on cloth at rest, with itself and with bodies, against hand calculation."""

# No `from __future__ import annotations` here: Taichi reads the annotations of kernels.

import functools

import numpy as np
import pytest

from fit import runtime
from fit.cloth.contact import CONTACT_DAMPING, CONTACT_OMEGA, Contact, surface_of
from fit.cloth.kernel_arguments import contact_bundle, zeros
from fit.cloth.mesh import build_mesh
from fit.errors import FitError
from fit.recordings.bodies import Body, capsule, half_space, sphere
from tests.fit.scenes import sheet

DENSITY = 0.2  # kg/m^2
STIFFNESS = DENSITY * CONTACT_OMEGA**2 / 2  # Pa/m
LANES = 4
SIDE = 0.3  # m


@pytest.fixture(scope="module")
def cloth():
    """A sheet of 0.3 m x 0.3 m, two elements a side, with samples 30 mm apart."""
    mesh = build_mesh(sheet(width=SIDE, height=SIDE), 0.05)
    return mesh, surface_of(mesh, 0.03)


@functools.cache
def kernel():
    """Contact alone, on one group of lanes."""
    runtime.start()
    import taichi as ti

    from fit.cloth.touching import touching

    vectors = ti.types.ndarray(dtype=ti.types.vector(LANES, ti.f32), ndim=1)
    whole, numbers = ti.types.ndarray(dtype=ti.i32, ndim=1), ti.types.ndarray(dtype=ti.f32, ndim=1)

    @ti.kernel
    def evaluate(
        x: vectors, v: vectors, f: vectors, w: whole, memory: vectors, alone: numbers, chosen: vectors,
        nodes: ti.i32,
    ):  # fmt: skip
        for task in range(512):
            if task == 0:
                touching(0, 0, nodes, 1, x, v, f, w, memory, alone, chosen[0], chosen[1], 0.0, 1.0, LANES)

    return evaluate


def pushed(cloth, contact, places, speeds=None):
    """Forces of contact on the nodes [N], (nodes, 3), as the kernel computes them; all lanes alike."""
    forces = pushed_lanes(cloth, contact, places, [contact.thickness] * LANES, speeds)
    assert (forces == forces[..., :1]).all()
    return forces[..., 0]


def pushed_lanes(cloth, contact, places, thickness, speeds=None):
    """The same of candidates of several thicknesses [m] side by side, (nodes, 3, lanes)."""

    def lanes(values):
        made = zeros((np.size(values), LANES))
        made[...] = np.ravel(values)[:, None]
        return made

    evaluate = kernel()
    mesh, surface = cloth
    still = np.zeros_like(places)
    f = lanes(still)
    arguments = contact_bundle(surface, contact, np.array([thickness]), len(mesh.rest))
    chosen = zeros((2, LANES))
    chosen[:] = np.array([thickness, [DENSITY] * LANES])
    with runtime.vectors_kept():
        evaluate(
            lanes(places), lanes(still if speeds is None else speeds), f, *arguments,
            chosen, len(mesh.rest),
        )  # fmt: skip
    return f.reshape(-1, 3, LANES).astype(float)


# Rows of samples [m] from the fold, and how wide each counts: weights of six places that integrate cubics.
ROWS, WIDTHS = np.array([0.06, 0.09, 0.12, 0.15]), np.array([0.031786, 0.031786, 0.030446, 0.012768])


def folded(mesh, gap):
    """The lower half of the sheet folded up behind the upper one like a book that is open by `gap` [m] at its end.

    Returns the nodes' places, z being the distance from the fold, and which of them are of the lower half.
    """
    below = mesh.rest[:, 1] + SIDE / 2
    is_back = below < -1e-9
    return np.stack([mesh.rest[:, 0], np.where(is_back, -2 * gap / SIDE * below, 0.0), np.abs(below)], 1), is_back


def torque_by_hand(pressure):
    """Torque about the fold [N m] of the pressure [Pa] at each of `ROWS`, the rows that meet the other layer's."""
    return SIDE * float((WIDTHS * ROWS * pressure).sum())


def test_samples_carry_linear_fields_and_stand_for_the_whole_area(cloth):
    mesh, surface = cloth
    found = surface.samples.apply(np.column_stack([mesh.rest, mesh.rest @ [2.0, 3.0] + 1.0]))
    assert len(surface.area) == 11 * 11
    assert found[:, 2] == pytest.approx(found[:, :2] @ [2.0, 3.0] + 1.0)
    assert surface.area.sum() == pytest.approx(SIDE**2)


def test_layers_share_their_samples_on_a_seam():
    """A tube of 0.3 m: 11 x 11 samples each side, less the eleven on either seam that both have."""
    import msgspec

    tube = msgspec.structs.replace(sheet(width=SIDE, height=SIDE), format="hangtime-garment/2", seams=((1, 2), (3, 0)))
    surface = surface_of(build_mesh(tube, 0.05), 0.03)
    assert len(surface.area) == 2 * 121 - 22
    assert surface.area.sum() == pytest.approx(2 * SIDE**2)


def test_two_layers_push_each_other_apart_by_stiffness_times_overlap(cloth):
    """Kept 5 mm apart, open by 3 mm at the end: 100 kPa/m x 2 mm = 200 Pa there, 380 Pa in the second row of samples.

    The first row is too near along the cloth. Torque about the fold: 0.3 m x (31.8 mm (60 x 380 + 90 x 320) +
    30.4 mm x 120 x 260 + 12.8 mm x 150 x 200) mm Pa = 0.892 N m.
    """
    mesh, _ = cloth
    places, is_back = folded(mesh, 0.003)
    force = pushed(cloth, Contact(thickness=0.005), places)
    by_hand = torque_by_hand(STIFFNESS * (0.005 - 0.02 * ROWS))
    assert by_hand == pytest.approx(0.892, rel=1e-3)
    assert force[is_back, 1] @ places[is_back, 2] == pytest.approx(by_hand, rel=1e-3)
    assert force[~is_back, 1] @ places[~is_back, 2] == pytest.approx(-by_hand, rel=1e-3)


def test_layers_farther_apart_than_their_thickness_do_not_touch(cloth):
    mesh, _ = cloth
    assert not pushed(cloth, Contact(thickness=0.005), folded(mesh, 0.013)[0]).any()


def test_candidates_side_by_side_push_as_each_does_alone(cloth):
    """Layers 3 mm apart and less, of 2 to 8 mm: to the last bit what each thickness does in all lanes."""
    mesh, _ = cloth
    places, _ = folded(mesh, 0.003)
    thickness = [0.002, 0.004, 0.006, 0.008]
    together = pushed_lanes(cloth, Contact(thickness=0.008), places, thickness)
    for lane, one in enumerate(thickness):
        alone = pushed_lanes(cloth, Contact(thickness=0.008), places, [one] * LANES)
        assert (together[..., lane] == alone[..., lane]).all()
        assert alone.any()


def crumpled(mesh, rng):
    """A fold whose layers are bent and within reach of each other here and there, moving at random."""
    places, is_back = folded(mesh, 0.004)
    x, z = places[:, 0] / SIDE, places[:, 2] / SIDE
    bumps = rng.normal(size=(2, 3)) * 0.004
    for layer, bump in enumerate(bumps):
        chosen = is_back == bool(layer)
        places[chosen, 1] += (bump[0] * np.sin(5 * x) + bump[1] * np.cos(4 * z) + bump[2] * x * z)[chosen]
    return places, rng.normal(size=places.shape) * 0.3


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_contact_neither_pushes_nor_turns_the_cloth_as_a_whole(cloth, friction):
    """Momentum stands to single precision; friction acts a thickness apart, so its torque is only nearly none."""
    mesh, _ = cloth
    places, speeds = crumpled(mesh, np.random.default_rng(3))
    force = pushed(cloth, Contact(thickness=0.006, friction=friction), places, speeds)
    size = np.abs(force).sum()
    assert size > 1.0
    assert np.abs(force.sum(0)).max() < 1e-5 * size
    torque = np.cross(places, force)
    assert np.abs(torque.sum(0)).max() < (1e-5 if friction == 0.0 else 2e-2) * size * SIDE


def stored(surface, places, thickness):
    """Energy of contact by its definition [J], in plain numpy."""
    y = surface.samples.apply(places)
    a, b, c, d = (y[surface.quads[:, k]] for k in range(4))
    one, two = (b - a + d - c) / 2, (c - a + d - b) / 2
    normal = np.cross(one, two)
    square = (normal**2).sum(1)
    away = y[:, None] - ((a + b + c + d) / 4)[None]
    gap = np.abs(np.einsum("sqc,qc->sq", away, normal / np.sqrt(square)[:, None]))
    first = np.einsum("sqc,qc->sq", away, np.cross(two, normal) / square[:, None])
    second = np.einsum("sqc,qc->sq", away, np.cross(normal, one) / square[:, None])
    ends = surface.windows
    share = np.clip(2 * np.minimum(ends[:, 2] - first, ends[:, 3] + first), 0, 1)
    share = share * np.clip(2 * np.minimum(ends[:, 0] - second, ends[:, 1] + second), 0, 1)
    overlap = np.clip(thickness - gap, 0, None) * surface.may_meet
    return float((surface.area[:, None] * share * STIFFNESS * overlap**2).sum() / 4)


def test_forces_are_the_slope_of_the_energy(cloth):
    """Along smooth displacements; what the moving windows would add is left out, a few per cent of bumps as steep."""
    mesh, surface = cloth
    places, _ = crumpled(mesh, np.random.default_rng(3))
    force = pushed(cloth, Contact(thickness=0.006), places)
    step = 1e-6
    for seed in range(5):
        moved = np.random.default_rng(seed).normal(size=(3, 3))
        way = places @ moved + np.sin(9 * places @ moved)
        slope = stored(surface, places + step * way, 0.006) - stored(surface, places - step * way, 0.006)
        assert (force * way).sum() == pytest.approx(-slope / (2 * step), rel=0.05, abs=0.02 * np.abs(force).sum())


def test_separating_layers_are_damped_but_never_held_back(cloth):
    """Closing at 10 cm/s at its end adds c x 10 cm/s = 6 Pa there; opening at 37 m/s leaves nothing."""
    mesh, _ = cloth
    places, is_back = folded(mesh, 0.003)
    speeds = np.zeros_like(places)
    still = pushed(cloth, Contact(thickness=0.005), places)
    speeds[is_back, 1] = -0.1 * places[is_back, 2] / 0.15
    nearing = pushed(cloth, Contact(thickness=0.005), places, speeds) - still
    by_hand = torque_by_hand(CONTACT_DAMPING * CONTACT_OMEGA * DENSITY * 0.1 * ROWS / 0.15)
    assert nearing[is_back, 1] @ places[is_back, 2] == pytest.approx(by_hand, rel=1e-3)
    speeds[is_back, 1] = 250.0 * places[is_back, 2]
    assert not pushed(cloth, Contact(thickness=0.005), places, speeds).any()


def test_friction_is_bounded_by_its_coefficient(cloth):
    """Sliding with a coefficient of 0.4 at up to 20 m/s: 0.4 of the pressure against the motion."""
    mesh, _ = cloth
    places, is_back = folded(mesh, 0.003)
    speeds = np.zeros_like(places)
    speeds[is_back, 0] = 20.0 * places[is_back, 2] / 0.15
    force = pushed(cloth, Contact(thickness=0.005, friction=0.4), places, speeds)
    ratio = force[is_back, 0] @ places[is_back, 2] / (force[is_back, 1] @ places[is_back, 2])
    assert ratio == pytest.approx(-0.4, rel=1e-3)


BODIES = {
    "sphere": (sphere((0.0, 0.0, 0.0), 0.1), (0.0, 0.0, 0.3), 0.2),
    "capsule, beside": (capsule((0.0, -0.2, 0.0), (0.0, 0.2, 0.0), 0.1), (0.3, 0.1, 0.0), 0.2),
    "capsule, beyond": (capsule((0.0, -0.2, 0.0), (0.0, 0.2, 0.0), 0.1), (0.0, 0.7, 0.0), 0.4),
    "half-space": (half_space((0.0, 0.0, 1.0), (0.0, 0.0, 2.0)), (5.0, 3.0, 1.5), 0.5),
    "half-space, within": (half_space((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)), (-0.2, 3.0, 9.0), -0.2),
    "box": (Body(centre=(0.0, 0.0, 0.0), half_size=(0.1, 0.2, 0.3)), (0.4, 0.0, 0.7), 0.5),
    "box, within": (Body(centre=(0.0, 0.0, 0.0), half_size=(0.1, 0.2, 0.3), radius=0.05), (0.04, 0.0, 0.0), -0.11),
}


@pytest.mark.parametrize("name", BODIES)
def test_distance_from_a_body(name):
    body, place, distance = BODIES[name]
    assert body.distance(np.array(place)) == pytest.approx(distance, abs=1e-9)


@pytest.mark.parametrize("name", BODIES)
def test_a_body_pushes_straight_out_by_its_stiffness_times_overlap(name, cloth):
    """Clearance 30 mm, a sheet shrunk to a point 10 mm from the surface: 2 k x 20 mm x 0.09 m^2 = 360 N outwards."""
    body, place, _ = BODIES[name]
    mesh, _ = cloth
    step = 1e-5
    out = np.array([body.distance(place + step * e) - body.distance(place - step * e) for e in np.eye(3)]) / (2 * step)
    at = np.array(place) + (0.01 - body.distance(np.array(place))) * out
    places = at + 1e-6 * np.column_stack([mesh.rest, 0 * mesh.rest[:, 0]])
    force = pushed(cloth, Contact(bodies=(body,), clearance=0.03), places)
    # Single precision in the half-space, whose middle is 50 m away, is 4 um of 20 mm.
    assert force.sum(0) == pytest.approx(2 * STIFFNESS * 0.02 * SIDE**2 * out, rel=2e-3, abs=2e-3 * 360)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Contact(thickness=-0.001), "contact thickness: cannot be -0.001; choose 0 to"),
        (lambda: Contact(friction=float("nan")), "contact friction: cannot be nan"),
        (lambda: Contact(bodies=(sphere((0, 0, 0), 0.01),)), "slips through between samples"),
        (lambda: Contact(spacing=1.0), "contact spacing: cannot be 1.0 m; choose 0.005 to 0.1"),
        (lambda: sphere((0, 0, 0), 0.0), "has no inside"),
        (lambda: sphere((0, 0, float("inf")), 1.0), "has no inside"),
        (lambda: capsule((0, 0, 0), (0, 0, 0), 0.1), "is a sphere"),
        (lambda: half_space((0, 0, 0), (0, 0, 0)), "has no direction"),
    ],
)
def test_contact_that_cannot_be_simulated_is_refused(make, says):
    with pytest.raises(FitError, match=says):
        make()
