"""The rigid-sheet predictor of every fit: its swing in closed form, and the warning of a fit that hardly beats it."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace

from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.identification.trivial import describe_trivial, fitted_pendulum, pendulum, swing, vertical
from fit.methods import SI
from fit.recordings.recording import prepare
from formats.fit_records import ErrorFigure, TrivialFigure
from formats.nature import GRAVITY
from tests.fit.scenes import hung, material, sheet, simulate_take, take_of
from tests.formats.damage import a_report


def shaken(amplitude=0.01, hz=0.5, seconds=12.0):
    """A hanger that goes sideways through the cloth by a sine that lasts."""
    time = np.arange(0, seconds, 1 / 30)
    return time, np.stack([0 * time, amplitude * np.sin(2 * np.pi * hz * time), 0 * time], 1)


def test_a_small_swing_has_the_gain_and_phase_of_a_damped_oscillator():
    """th'' + c th' + g/L th = -a_n/L: at 0.5 Hz, L 0.4 m, c 2/s, a lag of atan(c w / (w0^2 - w^2)) once at rest."""
    time, moved = shaken()
    recording = prepare(take_of(sheet(), time, moved, hung(sheet(), time)))
    length, damping, turns = 0.4, 2.0, 2 * np.pi * 0.5
    angle = swing(recording, np.array([length]), np.array([damping]))[0]
    forced = 0.01 * turns**2 / length / (9.81 / length - turns**2 + 1j * damping * turns)
    true = np.imag(forced * np.exp(1j * turns * recording.time))
    late = (recording.time > 7) & (recording.time < 11.5)
    assert angle[late] == pytest.approx(true[late], abs=0.03 * np.abs(forced))


def test_a_hanging_board_and_a_pendulum_are_where_the_flat_cloth_has_their_points():
    time, moved = shaken(amplitude=0.0)
    garment = sheet(grid=4)
    recording = prepare(take_of(garment, time, moved, hung(garment, time)))
    assert vertical(recording) == pytest.approx(recording.points, abs=1e-6)
    assert pendulum(recording, 0.3, 2.0) == pytest.approx(recording.points, abs=1e-6)


def test_a_board_cut_with_a_slanted_edge_hangs_at_right_angles_to_that_edge():
    """A point half along an edge of 0.3 and 0.4 m, and 0.1 m below: once the edge is level, 0.1 m under its middle."""
    point = SimpleNamespace(at_m=(0.15 + 0.08, 0.2 - 0.06))  # along the edge is (0.6, 0.8), so below is (0.8, -0.6)
    garment = SimpleNamespace(outline_m=[(0.0, 0.0), (0.3, 0.4), (0.7, 0.1), (0.4, -0.3)], points=[point])
    ends = np.array([[0.0, 0.0, 1.0, 0.5, 0.0, 1.0]])
    recording = SimpleNamespace(garment=garment, time=np.zeros(1), held=lambda at: np.repeat(ends, len(at), 0))
    assert vertical(recording)[0, 0] == pytest.approx([0.25, 0.0, 0.9])


def test_the_two_numbers_of_a_pendulum_are_found_again():
    time, moved = shaken(amplitude=0.05, hz=0.8)
    garment = sheet()
    empty = prepare(take_of(garment, time, moved, hung(garment, time)))
    swung = prepare(take_of(garment, time, moved, pendulum(empty, 0.35, 1.5)))
    assert fitted_pendulum([swung]) == (0.35, 1.5)


@pytest.mark.parametrize(
    ("after", "sentence"),
    [
        (
            0.021,
            "Warning: the fit does not beat a trivial predictor: 21.0 mm held out, a rigid sheet that "
            "swings as a pendulum 20.0 mm",
        ),
        (0.0185, "Warning: the fit hardly beats a trivial predictor: 18.5 mm held out"),
        (
            0.017,
            "The fit misses by 17.0 mm held out, a rigid sheet that swings as a pendulum 20.0 mm (mean distance of all "
            "points).",
        ),
    ],
)
def test_a_fit_says_how_it_stands_to_the_better_rigid_sheet(after, sentence):
    def error(mean):
        return ErrorFigure(mean_m=mean, max_m=mean, per_frame_m=[mean], time_s=[0.0])

    figures = [
        TrivialFigure(name="vertical", train=error(0.001), held_out=error(0.03)),
        TrivialFigure(name="pendulum", train=error(0.001), held_out=error(0.02)),
    ]
    assert describe_trivial(after, figures, is_held_out=True).startswith(sentence)


def test_every_fit_has_both_beside_it():
    garment, (time, moved) = sheet(), shaken(amplitude=0.06, hz=0.7, seconds=2.5)
    row = material(garment, velocity_damping=2.0)
    takes = [simulate_take(garment, time, k * moved, row, noise=0.001, name=f"take-{k}") for k in (1, 0.7)]
    takes[1] = dataclasses.replace(takes[1], report=a_report(other_blocks=1, other_takes=1, trailing_bytes=10))
    result = calibrate(takes[:1], takes[1:], request_of(SI, [], iterations=2, seed=1, spacing=0.15))
    assert any(note.startswith("Warning: the take take-0.7: 1 block of other takes") for note in result.notes)
    assert "Warning: the take take-0.7: 10 bytes follow its end." in result.notes
    states = [(one.take_id, one.state, one.trailing_bytes) for one in result.take_states]
    assert states == [("take-1", "sound", 0), ("take-0.7", "damaged", 10)]
    assert [one.name for one in result.trivial] == ["vertical", "pendulum"]
    assert all(one.held_out is not None for one in result.trivial)
    assert set(result.trivial[1].parameters) == {"length_m", "damping_per_s"}
    assert any("rigid sheet" in note for note in result.notes)
    assert len(result.trivial[0].held_out.per_frame_m) == len(time)
    assert replace(result, trivial=[]).trivial == []


def test_a_hanger_that_is_accelerated_upwards_pulls_its_pendulum_straighter():
    """1 m/s^2 through the cloth and 3 m/s^2 upwards: the sheet leans by atan(1 / (9.81 + 3)) once it is at rest."""
    instants = np.arange(0, 4, 1 / 30)

    def held(at):
        arm = np.array([0.1, 0.0, 0.0])
        moved = np.stack([0 * at, 0.5 * at**2, 1.5 * at**2], 1)
        return np.concatenate([moved - arm, moved + arm], 1)

    recording = SimpleNamespace(time=instants, duration=float(instants[-1]), held=held)
    angle = swing(recording, np.array([0.25]), np.array([6.0]))[0]
    assert angle[instants > 3.3][:10] == pytest.approx(np.full(10, -np.arctan(1 / (GRAVITY + 3))), rel=1e-3)


def test_the_two_numbers_of_a_pendulum_are_those_of_all_takes_together():
    """Of takes that swing 50 mm and, with other numbers, 2 mm the first one decides, in either order."""
    found = []
    for amplitude, numbers in ((0.05, (0.35, 1.5)), (0.002, (0.8, 0.5))):
        time, moved = shaken(amplitude=amplitude, hz=0.8, seconds=4.0)
        empty = prepare(take_of(sheet(), time, moved, hung(sheet(), time)))
        found.append(dataclasses.replace(empty, points=pendulum(empty, *numbers)))
    assert fitted_pendulum(found[1:]) == (0.8, 0.5)
    assert fitted_pendulum(found) == fitted_pendulum(found[::-1]) == (0.35, 1.5)
