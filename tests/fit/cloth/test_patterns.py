"""Garments beyond one plain panel: any outline, holes, a sewn back, cloth cut on the bias."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from scipy.optimize import curve_fit

from benchmarks.clamps import Clamp, clamps
from firmware_host.synthetic.garments import shirt
from fit.cloth.bundles import ROW
from fit.cloth.mesh import ClothMesh, build_mesh
from fit.cloth.model import Resolution
from fit.cloth.quads import is_inside, quadrilaterals
from fit.cloth.simulator import Simulator
from fit.cloth.support import hanger
from fit.effects import find_effects
from fit.engines.plain_grid import plain_grid
from fit.errors import FitError
from fit.recordings.recording import prepare
from formats.garment import TrackedPoint
from tests.fit.scenes import hung, material, sheet, swing, take_of

GRAVITY = 9.80665
# The sheet of 0.4 m x 0.45 m with corners in the middle of its sides, none opposite another.
EIGHT = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.2), (0.2, -0.45), (0.05, -0.45), (-0.2, -0.45), (-0.2, -0.25), (-0.2, -0.1))
HOLE = ((-0.05, -0.2), (0.05, -0.2), (0.05, -0.3), (-0.05, -0.3))
TUBE = ((1, 2), (3, 0))  # the sides of a four-cornered panel
SHIRT_SEAMS = ((0, 1), (1, 2), (3, 4), (4, 5), (6, 7), (7, 8), (9, 0))  # all but the cuffs and the hem
STAR = tuple(
    (float(r * np.cos(a)), float(r * np.sin(a)))
    for r, a in zip([0.3, 0.12] * 5, np.pi * (0.9 - np.arange(10) / 5), strict=True)
)


def cut(**changes):
    """The plain sheet with changes."""
    return msgspec.structs.replace(sheet(), format="hangtime-garment/2", **changes)


GARMENTS = {
    "eight corners": cut(outline_m=EIGHT),
    "hole": cut(holes_m=(HOLE,)),
    "tube": cut(seams=TUBE),
    "bias": cut(grain_degrees=45.0),
    "T-shirt": shirt(),
    "T-shirt with a back": msgspec.structs.replace(shirt(), format="hangtime-garment/2", seams=SHIRT_SEAMS),
    "star": cut(outline_m=STAR, points=sheet().points[:0]),
}


def test_of_few_tracked_points_the_nearest_one_stands_for_a_node():
    """Two at the ends of the top: each of them for its own half. Without any, no node is known."""
    for count in (0, 1, 2):
        mesh = build_mesh(cut(points=sheet().points[:count]), 0.1)
        assert mesh.pull_weights.tolist() == [[float(count > 0), 0.0, 0.0]] * len(mesh.rest)
        known = np.abs(mesh.rest[:, 0]) > 0.01
        nearest = (mesh.rest[known, 0] > 0.0) & (count == 2)
        assert mesh.pull_points[known].tolist() == [[int(k)] * 3 for k in nearest]


def test_cloth_held_at_its_corners_starts_in_the_folds_of_the_first_instant():
    """The hem is 60 mm in front of the bar at first, and 10 mm a second later; the hanger goes on meanwhile."""
    garment, time = sheet(held="corners", grid=3), np.arange(0, 1.5, 1 / 30)
    moved = 0.1 * time[:, None] * [1.0, 0.0, 0.0]
    points = hung(garment, time) + moved[:, None]
    points[:, 3:, 1] += (0.06 - 0.05 * time)[:, None] * np.repeat([0.5, 1.0], 3)
    recording = prepare(take_of(garment, time, moved, points, sd=1e-4))
    mesh = build_mesh(garment, 0.1)
    start = hanger(recording)(mesh).start(recording.held(np.zeros(1)))
    # A spline of points in one plane is this plane; smoothing leaves straight paths, 1 mm is a sixtieth of the fold.
    assert mesh.points.apply(start[0]) == pytest.approx(points[0], abs=1e-3)


@pytest.mark.parametrize("name", GARMENTS)
def test_the_mesh_has_the_garments_area_and_slopes_along_the_threads(name):
    """x = (2 X + 3 Y, X, Y): slopes along threads turned by a are R(a) (2, 3), and second derivatives are none."""
    garment = GARMENTS[name]
    mesh = build_mesh(garment, 0.08)
    assert mesh.area == pytest.approx(garment.mass_kg / garment.areal_density, rel=1e-9)
    field = np.column_stack([mesh.rest @ [2.0, 3.0], mesh.rest])
    slopes = mesh.fibres.stencils.apply(field)
    across, down = slopes[: mesh.fibres_across], slopes[mesh.fibres_across :]
    angle = np.radians(garment.grain_degrees)
    c, s = np.cos(angle), np.sin(angle)
    assert across == pytest.approx(np.tile([2 * c + 3 * s, c, s], (len(across), 1)), abs=1e-9)
    assert down == pytest.approx(np.tile([3 * c - 2 * s, -s, c], (len(down), 1)), abs=1e-9)
    assert np.abs(mesh.bends.stencils.apply(field)).max() < 1e-9
    parts = mesh.fibres.area[: mesh.fibres_across], mesh.fibres.area[mesh.fibres_across :], mesh.shear_area
    assert [part.sum() for part in parts] == pytest.approx([mesh.area] * 3)


@pytest.mark.parametrize("name", ["eight corners", "hole", "bias", "T-shirt", "tube"])
def test_a_garment_rolled_to_a_cylinder_stores_the_plates_energy(name):
    """1/2 B / R^2 per area, whichever way the mesh and the threads run."""
    mesh = build_mesh(GARMENTS[name], 0.05)
    angle = mesh.rest[:, 0] / 0.5
    rolled = np.column_stack([0.5 * np.sin(angle), mesh.rest[:, 1], 0.5 * np.cos(angle)])
    energy = 0.5 * (mesh.bends.stencils.apply(rolled) ** 2).sum()
    # 0.2 %: cubic elements of 0.15 m follow an arc of 0.5 m that closely.
    assert energy == pytest.approx(0.5 / 0.5**2 * mesh.area, rel=2e-3)


def test_a_hole_takes_exactly_its_own_mass():
    """0.1 m x 0.1 m of 0.2 kg/m^2 are 2 g; the sheet had 36 g."""
    mass = 0.2 * build_mesh(GARMENTS["hole"], 0.05).node_area
    assert mass.sum() == pytest.approx(0.034, rel=1e-9)
    assert mass.min() > 0


def test_seams_join_the_layers_and_nothing_else_does():
    """A tube has twice the sheet's nodes less those on its two seams; the hem is open all the way round."""
    single, tube = build_mesh(cut(grain_degrees=0.0), 0.05), build_mesh(GARMENTS["tube"], 0.05)
    rows = len(np.unique(np.round(single.rest[:, 1], 9)))
    assert len(tube.rest) == 2 * len(single.rest) - 2 * rows
    assert tube.hem_length.sum() == pytest.approx(2 * 0.4)
    sides = np.abs(tube.rest[:, 0]) > 0.2 - 1e-9
    assert np.abs(tube.bulge[sides]).max() < 1e-12
    assert tube.bulge.min() == pytest.approx(-tube.bulge.max())


@pytest.mark.parametrize("side", [0.3, 0.15, pytest.param(0.06, marks=pytest.mark.slow)])
@pytest.mark.parametrize("loops", [(STAR,), (shirt().outline_m,), (sheet().outline_m, HOLE)])
def test_quadrilaterals_are_convex_clockwise_and_inside(loops, side):
    loops = [np.array(loop) for loop in loops]
    places, quads = quadrilaterals(loops, side)
    ring = places[quads]
    ahead, behind = np.roll(ring, -1, 1) - ring, np.roll(ring, 1, 1) - ring
    turn = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    assert turn.max() < 0
    assert is_inside(ring.mean(1), loops).all()


def swings(garment, *, point=2, seconds=5.0, **changes):
    """Frequency [1/s] of the first swing after a nudge, and the positions of the point at the end of a still hang."""
    time = np.arange(0, seconds, 1 / 30)
    recording = prepare(take_of(garment, time, swing(time, amplitude=0.002, hz=0.9, stop=1.5), hung(garment, time)))
    row = material(garment, velocity_damping=0.3, **changes)
    moved = Simulator(recording).run(row).points[0, :, point]
    late = time > 2.2

    def wave(t, a, b, omega, decay):
        return np.exp(-decay * (t - 2.2)) * (a * np.cos(omega * t) + b * np.sin(omega * t))

    found, _ = curve_fit(wave, time[late], moved[late, 1] - moved[late, 1].mean(), p0=[0.01, 0.0, 5.6, 0.15])
    return found[2], moved[-1, 2]


@pytest.mark.slow
def test_outlines_and_tubes_swing_and_stretch_as_the_plain_panel_does():
    """The same sheet as eight corners, and as the front and back of a tube of twice the mass."""
    omega, bottom = swings(sheet(), stretch_stiffness=60.0)
    for changed in (cut(outline_m=EIGHT), cut(seams=TUBE, mass_kg=0.072)):
        other, lower = swings(changed, stretch_stiffness=60.0)
        assert other == pytest.approx(omega, rel=2e-3)
        # rho g L^2 / (2 k) = 3.3 mm of stretch, within 1 %, and single precision.
        assert lower == pytest.approx(bottom, abs=4e-5)


@pytest.mark.slow
def test_a_hole_changes_the_swing_and_a_thread_direction_the_stretch():
    """A panel cut on the bias hangs by its shear stiffness: at 45 degrees 1/E = 1/(2 k) + 1/(4 G)."""
    omega, bottom = swings(sheet(), stretch_stiffness=60.0)
    holed, _ = swings(cut(holes_m=(HOLE,), mass_kg=0.034), stretch_stiffness=60.0)
    assert holed != pytest.approx(omega, rel=5e-3)
    _, on_bias = swings(cut(grain_degrees=45.0), stretch_stiffness=60.0, shear_stiffness=10.0)
    plain = -bottom - 0.45
    # 60 / (1 / (1/120 + 1/40)) = 2 where the sides are free to draw in; the held edge does not let them.
    assert 1.5 < (-on_bias - 0.45) / plain < 2.05


def test_threads_that_cross_the_elements_have_at_their_own_samples_only_what_shear_has():
    """60 N/m beside a shear of 10 N/m: 10 at the fibres' samples, 50 at those of shear; of 5 N/m all at their own."""
    rows = np.concatenate([material(sheet(), stretch_stiffness=k, shear_stiffness=10.0) for k in (60.0, 5.0)])
    none = np.zeros((2, 0))
    columns = [ROW.stretch_down, ROW.stretch_across, ROW.shear_down, ROW.shear_across]
    for garment, expected in (
        (GARMENTS["bias"], [[10, 10, 50, 50], [5, 5, 0, 0]]),
        (sheet(), [[60, 60, 0, 0], [5, 5, 0, 0]]),
    ):
        recording = prepare(take_of(garment, np.arange(20) / 30, np.zeros((20, 3))))
        assert Simulator(recording).kernel_rows(rows, none)[:, columns].tolist() == expected


def test_uniform_strain_gives_equal_forces_wherever_it_is_sampled(monkeypatch):
    """All nodes held and drawn apart evenly: forces with stiffening, damping and viscosity, or with viscosity alone.

    Both candidates are viscous, so that they share a kernel.
    """

    def drawn(instants):
        return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]) + np.outer(
            instants, [0.0, 0.0, 0.0, 0.3, 0.0, 0.1, 0.0, 0.0, 0.2]
        )

    switched_on = {"membrane_damping_time": 2e-3, "stiffening": 8.0, "viscosity_time": 0.1, "stretch_ratio": 0.4}
    rows = np.concatenate(
        [
            material(sheet(), stretch_stiffness=60.0, shear_stiffness=10.0, bending_stiffness=1e-9, **changes)
            for changes in ({"viscosity_time": 0.1}, switched_on)
        ]
    )

    def forces():
        recording = prepare(take_of(GARMENTS["bias"], np.arange(0, 0.2, 0.01), np.zeros((20, 3))))
        everywhere = Clamp(lambda places: np.full(len(places), True), drawn)
        support = clamps(everywhere, start=drawn(np.zeros(1))[0], gravity=0.0)
        simulator = Simulator(recording, support=support, resolution=Resolution(spacing=0.1))
        return simulator.run(rows, shapes=True).forces

    crossed = forces()
    monkeypatch.setattr(ClothMesh, "is_crossed", False)
    plain = forces()
    assert np.abs(crossed[0] - crossed[1]).max() > 0.1 * np.abs(crossed).max()  # what is switched on counts
    # Rates are differences between steps, of strains in single precision.
    assert crossed == pytest.approx(plain, abs=1e-3 * float(np.abs(plain).max()))


def test_holes_that_touch_the_outline_cannot_be_meshed():
    """The file's check refuses them; a program that makes its own garment gets a sentence too."""
    with pytest.raises(FitError, match="cannot be meshed"):
        build_mesh(cut(holes_m=(((-0.1, -0.2), (0.3, -0.2), (0.3, -0.3)),)), 0.05)


@pytest.mark.processor_time(20)
def test_coinciding_corners_are_refused_in_one_sentence_too():
    """Their piece of a side is never an edge, however often it is halved."""
    corners = sheet().outline_m
    with pytest.raises(FitError, match="cannot be meshed"):
        build_mesh(cut(outline_m=(*corners, corners[0])), 0.05)


def test_four_corners_of_which_one_is_turned_in_make_no_grid():
    """0.4 x 0.45 / 2 less the notch to (-0.02, -0.1): a grid of them would fold over itself."""
    turned_in = cut(outline_m=((-0.2, 0.0), (0.2, 0.0), (0.0, -0.45), (-0.02, -0.1)), points=sheet().points[:0])
    assert not turned_in.is_panel
    assert build_mesh(turned_in, 0.05).area == pytest.approx(turned_in.area_m2, rel=1e-9)


def test_tracked_points_of_a_tube_are_on_its_front():
    """Front and back lie over each other, so that rounding would choose."""
    at = [(x, y) for x in np.linspace(-0.18, 0.18, 9) for y in np.linspace(-0.43, -0.02, 9)]
    points = tuple(TrackedPoint(name=f"p{k}", at_m=(float(x), float(y))) for k, (x, y) in enumerate(at))
    mesh = build_mesh(cut(seams=TUBE, points=points), 0.05)
    front = np.unique(mesh.cells[: len(mesh.cells) // 2])
    assert np.isin(mesh.points.nodes, front).all()


def test_a_hem_that_ends_in_a_point_is_the_two_sides_that_meet_there():
    """Two sides of sqrt(0.2^2 + 0.25^2) m; a hem of 10 g/m moves 6.4 g to them."""
    pointed = cut(
        outline_m=((-0.2, 0.0), (0.2, 0.0), (0.2, -0.2), (0.0, -0.45), (-0.2, -0.2)), points=sheet().points[:0]
    )
    mesh = build_mesh(pointed, 0.05)
    assert mesh.hem_length.sum() == pytest.approx(2 * np.hypot(0.2, 0.25))
    even = 0.3 * mesh.node_area
    moved = find_effects(["hem"])[0].node_mass(even, mesh, np.array([0.01]))
    assert moved.sum() == pytest.approx(even.sum())
    assert (moved - even * (1 - 0.0064031 / even.sum())).sum() == pytest.approx(0.0064031, rel=1e-3)
    assert (moved > even).any()


def test_a_notch_of_a_millimetre_is_refused_with_how_large_it_may_be():
    notched = (*sheet().outline_m[:2], (0.2, -0.2), (0.199, -0.2005), (0.2, -0.201), *sheet().outline_m[2:])
    with pytest.raises(FitError, match=r"too small for any step.*12 mm or more"):
        build_mesh(cut(outline_m=notched), 0.05)


def test_an_engine_of_plain_grids_refuses_what_is_no_plain_panel():
    with pytest.raises(FitError, match="plain four-cornered panels only"):
        plain_grid(GARMENTS["tube"], 0.05)
