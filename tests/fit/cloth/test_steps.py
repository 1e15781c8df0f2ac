"""The kernel against the same steps in NumPy: forces in x, y and z, settling, pull, lanes, and every kind of mesh."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from fit import runtime
from fit.cloth.contact import Contact
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.cloth.support import hanger
from fit.effects import find_effects
from fit.recordings.bodies import Body, BodyMotion
from fit.recordings.recording import prepare
from tests.fit.cloth.steps import Steps, amplitudes_by_name
from tests.fit.cloth.steps_in_contact import StepsInContact
from tests.fit.scenes import hung, material, sheet, swing, take_of

TIME = np.arange(20) / 400  # s
# Single precision leaves 1e-7 m and 1e-5 N of forces up to 0.4 N, and a start moved by a rounding error as much.
NEAR, NEAR_FORCE = 1e-6, 1e-4  # m, N
EFFECTS = ("air_drag", "draught", "bending_hysteresis", "rest_curvature", "added_mass", "stretch_viscosity")


def scene(effects=(), *, settle_time=0.0, turned=0.0, spacing=0.06, time=TIME):
    """A sheet that starts stretched, sheared and folded, on a bar that moves every way and turns; and its start."""
    garment = replace(sheet(width=0.4, height=0.3, grid=3, mass=0.024), grain_degrees=turned)
    path = 8 * swing(time, amplitude=0.3, hz=4.0, start=-0.05, sideways=0.2) + (0.4 * time**2)[:, None]
    take = take_of(garment, time, path, hung(garment, time) + 1.5 * path[:, None] + [0.004, 0.02, -0.01])
    turn = np.stack([0 * time, 3 * time**2, -2 * time**2], 1)
    recording = prepare(dataclasses.replace(take, held=take.held + np.stack([-turn, turn], 1)))

    def support(mesh):
        (x, y), plain = mesh.rest.T, hanger(recording)(mesh)
        down = (y.max() - y) / 0.3
        moved = down[:, None] * np.stack(
            [0.02 * np.sin(9 * y + 4 * x), 0.03 * np.cos(14 * x) * np.sin(11 * y), 0.02 * np.cos(8 * x)], 1
        )
        return dataclasses.replace(
            plain, start=lambda ends: plain.start(ends) + moved, settle_time=settle_time, settle_damping=9.0
        )

    return Simulator(recording, find_effects(effects), resolution=Resolution(spacing=spacing), support=support)


def several(garment):
    """Three fabrics that differ in every number that a base model has."""
    one = material(
        garment, stretch_stiffness=50.0, shear_stiffness=9.0, bending_stiffness=2e-4, membrane_damping_time=4e-4,
        bending_damping_time=8e-3, velocity_damping=1.5, stretch_ratio=0.5, bending_ratio=-0.6, stiffening=15.0,
        tilt_x=0.15, tilt_y=-0.1, gravity_log=0.2,
    )  # fmt: skip
    return one * np.array([[1.0], [1.07], [0.9]])


def compared(simulator, rows, sizes=None, hz=0.0, steps=Steps):
    """Compare kernel and NumPy, all candidates in one call of the kernel.

    Returns the largest difference of any node at each frame [m], that of the last forces [N], and NumPy's candidates.
    """
    if sizes is None:
        sizes = np.zeros((len(rows), simulator.columns[-1].stop if simulator.columns else 0))
    found = simulator.run(rows, sizes, observer_hz=hz, shapes=True)
    _, groups = simulator.groups(rows, sizes, shapes=False)
    octaves = {k: group.half_octaves for group in groups for k in group.members}
    start = runtime.jittered(simulator.support.start(simulator.support.path(np.zeros(1))))[0]
    tracked = Steps.dense(simulator.mesh.points, len(simulator.mesh.rest))
    places, forces, those = [], [], []
    for k, row in enumerate(groups[0].candidates.materials):
        one = steps(simulator, row, amplitudes_by_name(simulator.effects, sizes[k]))
        shapes, force = one.run(start, octaves[k], 2 * np.pi * hz)
        assert np.abs(shapes[-1] - shapes[0]).max() > 0.02
        assert found.points[k] == pytest.approx(tracked @ found.shapes[k], abs=NEAR)
        places.append(np.abs(found.shapes[k] - shapes).max((1, 2)))
        forces.append(np.abs(found.forces[k] - force).max())
        those.append(one)
    return np.max(places, 0), max(forces), those


@pytest.mark.parametrize(
    ("settle_time", "hz", "turned"),
    [(0.0, 0.0, 0.0), (0.0203, 3.0, 0.0), (0.0, 0.0, 20.0)],
    ids=["at once", "settled and pulled", "threads across the elements"],
)
def test_plain_cloth_goes_where_the_documented_steps_go(settle_time, hz, turned):
    """Without settling the first step meets stretched cloth, and has no step before it that it could be damped by."""
    simulator = scene(settle_time=settle_time, turned=turned)
    places, force, _ = compared(simulator, several(simulator.recording.garment), hz=hz)
    assert places.max() < NEAR
    assert force < NEAR_FORCE


@pytest.mark.parametrize("turned", [0.0, 20.0], ids=["along the elements", "across the elements"])
def test_cloth_with_every_effect_of_the_kernel_goes_where_the_documented_steps_go(turned):
    """Drag, wind, friction in bending, rest curvature, added mass and viscosity; threads along and across."""
    simulator = scene(EFFECTS, turned=turned)
    sizes = np.array([1.2, 1.5, -2.0, 2e-3, 15.0, -25.0, 0.3, 1e-3]) * np.array([[1.0], [0.8], [1.3]])
    places, force, _ = compared(simulator, several(simulator.recording.garment), sizes)
    assert places.max() < NEAR
    assert force < NEAR_FORCE


def folded():
    """A sheet folded up behind itself; a capsule and a box, which move and turn, push and rub it.

    It ends at 0.038 s, as rounding errors grow to 0.2 mm by 0.048 s.
    """
    plain = scene(time=0.8 * TIME)
    bodies = (
        Body(centre=(0.03, 0.05, -0.1), half_size=(0.0, 0.0, 0.05), radius=0.045, taper=0.2),
        Body(centre=(0.1, -0.1, -0.18), half_size=(0.06, 0.08, 0.03), radius=0.01),
    )
    when = np.arange(8)[:, None] * 0.01
    ways = ((bodies[0], [0.5, -1.0, 0.8], [4.0, -7.0, 6.0]), (bodies[1], [-0.6, 1.2, 0.9], [-5.0, 3.0, 4.0]))
    poses = np.stack(
        [
            np.concatenate(
                [body.centre + when * speed, Rotation.from_rotvec(when * turn).as_matrix().reshape(-1, 9)], 1
            )
            for body, speed, turn in ways
        ],
        1,
    )

    def support(mesh):
        x, y = mesh.rest.T
        down = np.clip(y.max() - y, 0, None)
        back = down > 0.15
        z = np.where(back, down - 0.3, -down)
        hung_so = np.stack([x, np.where(back, 0.14 * (down - 0.15) + 0.001, 0.0) + 0.004 * np.sin(20 * x), z], 1)
        return dataclasses.replace(
            hanger(plain.recording)(mesh), start=lambda ends: np.repeat(hung_so[None], len(ends), 0),
            settle_time=0.01, settle_damping=5.0,
        )  # fmt: skip

    contact = Contact(bodies=bodies, motion=BodyMotion(0.01, poses), friction=0.4, clearance=0.004, spacing=0.04)
    return Simulator(
        plain.recording, find_effects(["self_contact"]), resolution=Resolution(spacing=0.07), support=support,
        contact=contact,
    )  # fmt: skip


def test_cloth_in_contact_goes_where_the_documented_steps_go():
    """Layers of 28 and 2 mm side by side, with friction. Rounding leaves 1e-5 m and 1e-3 N."""
    simulator = folded()
    rows, sizes = several(simulator.recording.garment)[::2], np.array([[0.028], [0.002]])
    places, force, those = compared(simulator, rows, sizes, steps=StepsInContact)
    assert min(one.met for one in those) > 200
    assert min(one.leant for one in those) > 500
    assert places.max() < 5e-5
    assert force < 5e-3
