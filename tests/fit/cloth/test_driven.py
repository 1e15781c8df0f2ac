"""Moving bodies: their poses, their path lengths, and their contact with cloth."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.clamps import clamps
from fit.cloth import launch
from fit.cloth.contact import Contact
from fit.cloth.crossings import pierces
from fit.cloth.simulator import Simulator
from fit.errors import FitError
from fit.recordings.bodies import Body, BodyMotion, capsule, placed
from fit.recordings.recording import prepare
from tests.fit.scenes import hung, material, sheet, swing, take_of

SIDE, DENSITY = 0.3, 0.2  # m, kg/m^2
LEVEL = np.array([0.0, 0.15, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0])


def on_a_table(way, seconds=1.0):
    """A sheet that nothing holds on a table that goes `way(t)` [m], (n, 3): the last positions, and how fast it is."""
    garment = sheet(width=SIDE, height=SIDE, mass=DENSITY * SIDE**2)
    time = np.arange(0, seconds, 1 / 30)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3))))
    table = Body(centre=(0.0, 0.0, -0.102), half_size=(2.0, 2.0, 0.1))
    instants = np.arange(0, seconds + 0.1, 0.005)
    poses = np.tile(np.concatenate([table.centre, np.ravel(table.axes)]), (len(instants), 1, 1))
    poses[:, 0, :3] += way(instants)
    contact = Contact(bodies=(table,), friction=0.6, motion=BodyMotion(0.005, poses))
    run = Simulator(recording, support=clamps(start=LEVEL), contact=contact).run(
        material(garment, velocity_damping=0.0), shapes=True
    )
    shapes = run.shapes[0].astype(float)
    return shapes[-1], (shapes[-1] - shapes[-4]) / (3 / 30)


def test_a_rising_table_lifts_the_cloth():
    """0.1 m in a second, smoothly; the cloth then lies 2 mm above it, and sinks in by 10 um."""

    def way(t):
        u = np.clip(t / 0.8, 0, 1)
        return np.stack([0 * t, 0 * t, 0.1 * u**2 * (3 - 2 * u)], 1)

    places, speed = on_a_table(way, 1.2)
    assert places[:, 2] == pytest.approx(0.1, abs=3e-4)
    assert np.abs(speed).max() < 0.02


def test_a_table_that_moves_aside_takes_the_cloth_along():
    """Friction of 0.6 brings it to 0.5 m/s within 0.5 / (0.6 g) = 0.085 s; against a table at rest it would brake."""
    _, speed = on_a_table(lambda t: np.stack([0.5 * t, 0 * t, 0 * t], 1))
    assert speed[:, 0].mean() == pytest.approx(0.5, abs=0.02)


def test_a_tapering_capsule_is_as_thick_as_its_ends_say():
    body = Body(centre=(0, 0, 0), half_size=(0.0, 0.0, 0.2), radius=0.06, taper=-0.1)
    places = np.array([[0.0, 0.0, 0.3], [0.0, 0.0, -0.3], [0.1, 0.0, 0.0]])
    slant = np.hypot(1, 0.1)
    assert body.distance(places) == pytest.approx(np.array([0.06, 0.02, 0.04]) / slant)
    assert body.thickness == pytest.approx(0.08)
    with pytest.raises(FitError, match="has no end"):
        Body(centre=(0, 0, 0), half_size=(0.0, 0.0, 0.2), radius=0.06, taper=0.4)


def test_a_turning_capsule_has_gone_as_far_as_its_end():
    """A quarter turn about its middle, 0.25 m from end to middle: the corner of its box goes 0.26 m times pi/2."""
    body = capsule((0.0, 0.0, -0.2), (0.0, 0.0, 0.2), 0.05)
    angle = np.linspace(0, np.pi / 2, 101)
    axes = np.zeros((101, 1, 3, 3))
    axes[:, 0, 0] = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], 1)
    axes[:, 0, 1] = [0, 1, 0]
    axes[:, 0, 2] = np.stack([-np.sin(angle), 0 * angle, np.cos(angle)], 1)
    motion = BodyMotion(0.01, np.concatenate([np.zeros((101, 1, 3)), axes.reshape(101, 1, 9)], 2))
    assert motion.way((body,))[-1] == pytest.approx(np.hypot(0.25, 0.05) * np.pi / 2, rel=1e-3)
    between = motion.at(np.array([0.005, 0.5, 2.0]))
    for pose in between[:, 0]:
        frame = pose[3:].reshape(3, 3)
        assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
        placed(body, pose)
    assert between[-1, 0, 9:] == pytest.approx([-1, 0, 0], abs=1e-9)


def test_paths_and_bodies_must_be_as_many():
    with pytest.raises(FitError, match="1 bodies move on 2 paths"):
        Contact(bodies=(Body(centre=(0, 0, 0), half_size=(1, 1, 1)),), motion=BodyMotion(0.1, np.zeros((3, 2, 12))))


def test_a_path_through_a_triangle_is_distinguished_from_one_beside_it():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    start = np.array([[0.2, 0.2, 1], [0.9, 0.9, 1], [0.2, 0.2, 2]])
    end = np.array([[0.2, 0.2, -1], [0.9, 0.9, -1], [0.2, 0.2, 1]])
    assert pierces(start, end, np.tile(triangle, (3, 1, 1))).tolist() == [True, False, False]


def test_a_simulation_in_pieces_is_the_same_to_the_last_bit_and_can_be_interrupted():
    garment = sheet()
    time = np.arange(0, 1, 1 / 30)
    recording = prepare(take_of(garment, time, swing(time, amplitude=0.1, hz=1.5, start=0.0), hung(garment, time)))
    simulator = Simulator(recording)
    told = []
    whole = simulator.run(material(garment), shapes=True)
    pieces = simulator.run(material(garment), shapes=True, progress=told.append)
    assert (pieces.shapes == whole.shapes).all()
    assert (pieces.forces == whole.forces).all()
    assert told == pytest.approx(np.arange(1, 31) / 30)

    def stop(share):
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulator.run(material(garment), progress=stop)


def test_a_long_simulation_runs_in_pieces_that_let_ctrl_c_through_and_is_the_same_to_the_last_bit(monkeypatch):
    garment = sheet()
    time = np.arange(0, 1, 1 / 30)
    recording = prepare(take_of(garment, time, swing(time, amplitude=0.1, hz=1.5, start=0.0), hung(garment, time)))
    simulator = Simulator(recording)
    shares, pieces = [], launch._pieces
    monkeypatch.setattr(launch, "_pieces", lambda clock, count: shares.append(count) or pieces(clock, count))
    whole = simulator.run(material(garment), shapes=True)
    monkeypatch.setattr(launch, "NUMBERS_A_PIECE", 1e4)
    apart = simulator.run(material(garment), shapes=True)
    assert (apart.shapes == whole.shapes).all()
    assert (apart.forces == whole.forces).all()
    assert shares[0] == 1
    assert shares[-1] > 5


def test_pieces_have_fifty_million_numbers_each_and_are_a_hundred_at_most():
    assert [launch.pieces_for(steps, 1000) for steps in (0, 49_999, 50_000, 120_000, 10**9)] == [1, 1, 2, 3, 100]
