"""Labels exchanged in a cycle are told from bytes of whole markers that a C3D file lost, or that were inserted."""

from __future__ import annotations

import numpy as np
import pytest

from formats.importers.c3d_cycles import is_cycle
from tests.formats.test_c3d_shifts import AT, begin_of, hanging, made, named, read, refused

TURN = 25  # a frame at which the swing of `hanging` turns: no marker steps


@pytest.mark.parametrize("points", [3, 4, 5])
@pytest.mark.parametrize("scale", [-1.0, 0.1])
@pytest.mark.parametrize("count", [2, 10, 40])
@pytest.mark.parametrize("way", [1, -1])
def test_labels_exchanged_in_a_cycle_for_some_frames_are_no_shift(tmp_path, points, scale, count, way):
    """A cycle leaps as a shift by a marker's bytes does, and ends."""
    places = hanging(points)
    places[AT : AT + count] = np.roll(places[AT : AT + count], way, axis=1)
    tracks = read(tmp_path, made(places, scale))
    places[AT : AT + count] = np.nan
    np.testing.assert_allclose(1e3 * tracks.positions, places, atol=0.051)
    names = "m0, m1, m2" + f" and {points - 3} more" * (points > 3)
    assert tracks.warning == (
        f"labels seem exchanged, so these count as not seen: {names} from frame {AT + 1} to frame {AT + count} "
        f"({AT / 100:.2f} to {(AT + count - 1) / 100:.2f} s)"
    )


@pytest.mark.parametrize(("points", "more"), [(4, {}), (9, {}), (9, {"analogue": 7}), (32, {"processor": "dec"})])
@pytest.mark.parametrize("scale", [-1.0, 0.1])
@pytest.mark.parametrize("way", [1, -2])
@pytest.mark.parametrize("at", [40, 140, 205])
def test_labels_exchanged_in_a_cycle_to_the_end_are_read(tmp_path, points, more, scale, way, at):
    places = hanging(points)
    places[at:] = np.roll(places[at:], way, axis=1)
    scale = -1.0 if more.get("processor") else scale
    tracks = read(tmp_path, made(places, scale, **more))
    assert "labels seem exchanged, so these count as not seen: m0, m1, m2" in tracks.warning
    lesser = slice(at, None) if at > 150 else slice(0, at)
    places[lesser] = np.nan
    np.testing.assert_allclose(1e3 * tracks.positions, places, atol=0.051)


def with_lost_and_foreign(points, count, at, slot, analogue, order):
    """A file of which bytes within a frame are lost, and as many foreign ones follow 20 frames later, or before."""
    raw = made(hanging(points), analogue=analogue)
    width = 4 * (4 * points + analogue)
    first, second = (begin_of(raw) + one * width + slot * 16 for one in (at, at + 20))
    foreign = np.random.default_rng(count + slot).bytes(count)
    if order == "lost first":
        return raw[:first] + raw[first + count : second] + foreign + raw[second:]
    return raw[:first] + foreign + raw[first : second - count] + raw[second:]


@pytest.mark.parametrize(("points", "analogue"), [(4, 0), (9, 0), (9, 3), (32, 0)])
@pytest.mark.parametrize("order", ["lost first", "foreign first"])
@pytest.mark.parametrize("count", [16, 32])
@pytest.mark.parametrize("slot", [0, 1, 2])
@pytest.mark.parametrize("at", [AT, 198])
def test_bytes_of_whole_markers_that_are_replaced_later_are_no_cycle(
    tmp_path, points, analogue, order, count, slot, at
):
    frame, more, less = named(refused(tmp_path, with_lost_and_foreign(points, count, at, slot, analogue, order)))
    assert min(abs(frame - (at + 1)), abs(frame - (at + 21))) <= 2
    assert count in (more, less)


@pytest.mark.parametrize("slot", [1, 2, 6])
@pytest.mark.parametrize("at", [TURN, TURN + 50])
def test_bytes_lost_at_a_turn_are_told_by_the_frame_in_which_they_lack(tmp_path, slot, at):
    named(refused(tmp_path, with_lost_and_foreign(9, 16, at, slot, 0, "lost first")))


def lines(step, later=0, places=1):
    """Five frames of nine markers 60 apart that step by `step`; behind two, their labels are moved in a cycle."""
    rest = 60.0 * np.stack([np.arange(9), np.arange(9) % 2, np.zeros(9)], 1)
    frames = rest + np.array([step, step / 3, 0]) * np.arange(5)[:, None, None]
    for k in range(2, 5):
        taken = np.arange(9) < places
        frames[k] = np.where(taken[:, None], rest[np.arange(9) - places], 0) + (frames[k] - rest)[0]
        frames[k, ~taken] = (rest + (frames[k] - frames[k])[0])[: 9 - places] + step * k * np.array([1, 1 / 3, 0])
        frames[k, taken] = rest[np.arange(9) - places][taken] + step * (k + later) * np.array([1, 1 / 3, 0])
    return frames


@pytest.mark.parametrize("places", [1, 2, 4])
def test_markers_of_another_frame_are_a_step_early_or_late(places):
    assert is_cycle(lines(5.0, places=places), places) is True
    assert is_cycle(lines(5.0, -1, places), places) is False
    assert is_cycle(lines(5.0, 1, places), places) is False
    assert is_cycle(lines(0.0, places=places), places) is None


def test_an_acceleration_that_all_markers_have_is_no_step():
    pull = 2.0 * np.arange(5.0)[:, None, None] ** 2 * np.array([0, 0, 1.0]) * (np.arange(5) > 1)[:, None, None]
    assert is_cycle(lines(1.0) + pull, 1) is True
    assert is_cycle(lines(1.0, -1) + pull, 1) is False


def test_a_frame_of_both_kinds_is_no_cycle():
    frames = lines(0.0)
    frames[2, :4] = frames[1, :4]
    assert is_cycle(frames, 1) is False
    frames[2] = frames[1]
    assert is_cycle(frames, 1) is None
    frames[2, 4] = frames[3, 4]  # one label alone leads another path: no shift does
    assert is_cycle(frames, 1) is None


def test_foreign_values_under_the_labels_beyond_a_frame_are_no_cycle():
    frames = lines(0.0)
    frames[2:, 0] = 7000.0
    assert is_cycle(frames, 1) is False
    frames[2:, 0] = np.nan
    assert is_cycle(frames, 1) is None
