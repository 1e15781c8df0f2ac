"""Contact of moving cloth with itself and with bodies: falls, folds and swings against hand calculation."""

import numpy as np
import pytest

from benchmarks.clamps import clamps
from benchmarks.contact import height_of_upper_layer, swung, turned_over
from fit.cloth.contact import CONTACT_DAMPING, CONTACT_OMEGA, Contact
from fit.cloth.crossings import crossings
from fit.cloth.simulator import Simulator
from fit.recordings.bodies import capsule, half_space, sphere
from fit.recordings.recording import prepare
from tests.fit.scenes import material, sheet, take_of

DENSITY = 0.2  # kg/m^2
SIDE = 0.3  # m
GRAVITY = 9.80665  # m/s^2
LEVEL = np.array([0.0, 0.15, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])  # the sheet's middle above the origin


def dropped(contact, seconds=1.0, *, rate=30, gravity=GRAVITY, **changes):
    """A level sheet of 18 g that nothing holds: the simulator and what it did."""
    garment = sheet(width=SIDE, height=SIDE, mass=DENSITY * SIDE**2)
    time = np.arange(0, seconds, 1 / rate)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3))))
    simulator = Simulator(recording, support=clamps(start=LEVEL, gravity=gravity), contact=contact)
    return simulator, simulator.run(material(garment, **changes), shapes=True)


FLOOR = half_space((0.0, 0.0, -0.05), (0.0, 0.0, 1.0))


@pytest.mark.slow  # a body carries a sheet below, and another floor bounces one
def test_a_sheet_on_a_floor_lies_a_clearance_above_it_and_presses_with_its_weight():
    """-50 mm + 2 mm - g / omega^2 = -48.01 mm; 18 g are 0.1765 N."""
    ended = [dropped(Contact(bodies=(FLOOR,)), velocity_damping=20.0, seconds=s)[1] for s in (1.25, 1.5, 1.75)]
    assert ended[-1].shapes[0, -1, :, 2] == pytest.approx(-0.048 - GRAVITY / CONTACT_OMEGA**2, abs=5e-5)
    # A weight that hardly presses is hardly damped: at any one instant it still trembles, by under a micrometre.
    weight = np.mean([rollouts.forces[0].sum(0) for rollouts in ended], 0)
    assert weight == pytest.approx([0, 0, 0.018 * GRAVITY], abs=0.04 * 0.1765)


def test_a_sheet_bounces_off_a_floor_as_the_law_of_contact_says():
    """One mass on the law, in steps of five microseconds: it comes back to 32 % of its height.

    Damping that acted from the first touch to the last would leave exp(-2 pi zeta / sqrt(1 - zeta^2)) = 14 %.
    """
    _, rollouts = dropped(Contact(bodies=(FLOOR,)), velocity_damping=0.0, seconds=0.3, rate=240)
    height = rollouts.shapes[0, :, :, 2].mean(1) + 0.048
    landed = int(np.argmin(height))
    z, speed, highest = 0.048, 0.0, 0.0
    for _ in range(60_000):
        overlap = max(-z, 0.0)
        push = CONTACT_OMEGA**2 * overlap - min(4 * overlap / 0.002, 1) * 2 * CONTACT_DAMPING * CONTACT_OMEGA * speed
        speed += 5e-6 * (max(push, 0.0) - GRAVITY)
        z += 5e-6 * speed
        highest = max(highest, z) if speed > 0 else highest
    assert highest / 0.048 == pytest.approx(0.318, abs=0.002)
    # The sheet's step is a quarter of 1 / omega.
    assert height[landed:].max() == pytest.approx(highest, rel=0.05)


@pytest.mark.parametrize(
    "body", [sphere((0.0, 0.0, -0.13), 0.12), capsule((-0.3, 0.0, -0.07), (0.3, 0.0, -0.07), 0.06)],
    ids=["sphere", "cylinder"],
)  # fmt: skip
def test_a_sheet_hangs_over_a_body_that_carries_its_weight(body):
    """No part of it is inside; what the body gives is 0.1765 N, straight up."""
    simulator, rollouts = dropped(
        Contact(bodies=(body,), thickness=0.004, friction=0.6), velocity_damping=8.0, seconds=2.5
    )
    distance = body.distance(simulator.surface.samples.apply(rollouts.shapes[0, -1].astype(float)))
    # Over the sphere it rests on a few folds, which sink in by 0.12 to 0.15 mm; the law is as stiff as steps allow.
    assert distance.min() == pytest.approx(0.002, abs=3e-4)
    assert distance.max() > 0.015
    # It still creeps into its last place.
    assert rollouts.forces[0].sum(0) == pytest.approx([0, 0, 0.018 * GRAVITY], abs=0.04 * 0.1765)


@pytest.mark.slow
def test_a_sheet_that_is_folded_lies_on_itself_and_how_thick_it_is_hardly_matters():
    """Without contact the upper half lies on the floor, within the lower one; with it, as high as it is thick.

    3 and 6 mm in place of 5 move the nodes by less than those 2 and 1 mm.
    """
    simulator, through = turned_over(0.0)
    assert height_of_upper_layer(simulator, through[-1]) == pytest.approx(0.0, abs=1e-4)
    known = {d: turned_over(d)[1][-1] for d in (0.003, 0.005, 0.006)}
    for thickness, shape in known.items():
        # The row meets the other layer up to a few tenths of a millimetre away from its stated position.
        assert height_of_upper_layer(simulator, shape) == pytest.approx(thickness, abs=6e-4)
        moved = float(np.sqrt(((shape - known[0.005]) ** 2).sum(1).mean()))
        assert moved <= abs(thickness - 0.005)


@pytest.mark.slow  # the sheet above lies on itself by the same law
def test_front_and_back_of_a_swung_skirt_do_not_pass_through_each_other():
    """Without contact they do in most pictures."""
    passed = []
    for thickness in (0.0, 0.005):
        simulator, row = swung("tube", thickness, 1.5)
        shapes = simulator.run(row, shapes=True).shapes[0].astype(float)
        passed.append([crossings(simulator.surface, shape) for shape in shapes[::3]])
    assert np.mean(np.array(passed[0]) > 0) > 0.5
    assert passed[1] == [0] * 15


def test_layers_that_hit_each_other_create_no_energy():
    """A sheet falls over a cylinder without friction or damping: the energy never exceeds the initial energy."""
    rod = capsule((-0.5, 0.0, -0.03), (0.5, 0.0, -0.03), 0.02)
    rate = 240
    simulator, rollouts = dropped(
        Contact(thickness=0.005, bodies=(rod,), spacing=0.03), seconds=0.6, rate=rate, velocity_damping=0.0,
        bending_damping_time=0.0,
    )  # fmt: skip
    shapes = rollouts.shapes[0].astype(float)
    mass = DENSITY * simulator.mesh.node_area
    speed = np.diff(shapes, axis=0) * rate
    kinetic = 0.5 * (mass * (speed**2).sum(2)).sum(1)
    height = (shapes[1:, :, 2] + shapes[:-1, :, 2]) / 2
    energy = kinetic + GRAVITY * (mass * height).sum(1)
    assert kinetic.max() > 0.01
    assert energy.max() < 1e-4  # it starts at rest at height 0


@pytest.mark.slow  # `test_contact.py` has a quicker test of candidates side by side
def test_a_candidate_in_contact_does_not_depend_on_its_batch():
    """Alone, or beside seven others that are thicker or heavier: the same to the last bit."""
    from fit.effects import find_effects

    rod = capsule((-0.5, 0.0, -0.03), (0.5, 0.0, -0.03), 0.02)
    garment = sheet(width=SIDE, height=SIDE, mass=DENSITY * SIDE**2)
    time = np.arange(0, 0.7, 1 / 30)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3))))
    contact = Contact(bodies=(rod,), spacing=0.03)
    simulator = Simulator(recording, find_effects(["self_contact"]), support=clamps(start=LEVEL), contact=contact)
    row = material(garment)
    others = np.concatenate([row, np.repeat(material(garment, areal_density=0.25), 7, 0)])
    amplitudes = np.linspace(0.004, 0.015, 8)[:, None]
    alone = simulator.run(row, amplitudes[:1], shapes=True).shapes[0]
    assert (simulator.run(others, amplitudes, shapes=True).shapes[0] == alone).all()
    assert np.abs(simulator.run(row, np.zeros((1, 1)), shapes=True).shapes[0] - alone).max() > 0.005
