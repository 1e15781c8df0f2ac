"""What shows a shift of frames, computed here one by one as its definition says: leaps, shapes, extrapolations."""

from __future__ import annotations

import numpy as np
import pytest

from formats.importers import c3d_shifts
from formats.importers.c3d_doubled import FrameBytes
from formats.importers.c3d_shifts import (
    _candidates,
    _continue,
    _frames_of,
    _leaps,
    _numbers,
    _off,
    _shift_behind,
    _spread,
    _unlike,
    _usually_seen,
)

INTEL, FLOAT = 84, 4
LARGEST = float(np.finfo(np.float32).max)


def stored(places, analogue=0):
    """Return a reader of frames with these positions, (frames, markers, 3), seen, and where they are."""
    frames, points = places.shape[:2]
    rows = np.zeros((frames, points * 4 + analogue), "<f4")
    rows[:, : 4 * points].reshape(frames, points, 4)[..., :3] = places
    rows[:, 4 * points :] = 7.0
    raw, width = rows.tobytes(), rows.shape[1] * 4
    where = FrameBytes(0, len(raw), len(raw), width, FLOAT, points, INTEL)
    return (lambda at, size: raw[at : at + size]), where, raw


def moving(frames, points, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(frames)[:, None, None]
    return (rng.integers(-400, 400, (points, 3)) + 30 * np.sin(0.4 * time + rng.random((points, 3)))).astype("<f4")


def leaps_by_definition(places):
    """How far frame k + 2 is from the extrapolation of frames k - 1 and k, in the median of the markers."""
    places, found = places.astype(float), []
    for k in range(len(places) - 2):
        last, earlier, behind = places[k], places[max(k - 1, 0)], places[k + 2]
        off = [max(abs(c - b - 2 * (b - a))) for a, b, c in zip(earlier, last, behind, strict=True)]
        off = np.median([np.inf if np.isnan(one) else one for one in off])
        are_gone = [2 * sum((one == np.median(frame, axis=0)).all() for one in frame) > len(frame)
                    for frame in (last, behind)]  # fmt: skip
        found.append(0.0 if any(are_gone) else off)
    return found


@pytest.mark.parametrize("at_once", [1, 2, 3, 5, 1000])
@pytest.mark.parametrize(("frames", "points", "analogue"), [(3, 4, 0), (4, 7, 3), (19, 16, 0), (20, 5, 2)])
def test_leaps_are_those_of_their_definition_however_many_frames_are_read_at_once(
    monkeypatch, at_once, frames, points, analogue
):
    places = moving(frames, points)
    if frames > 10:
        places[6, : points - 1] = 0.0  # most markers gone
        places[12, 0] = np.nan
    read, where, _ = stored(places, analogue)
    monkeypatch.setattr(c3d_shifts, "SCANNED_AT_ONCE", at_once * where.width)
    pieces = list(_leaps(read, where, frames))
    assert len(pieces) == -(-(frames - 2) // at_once)
    np.testing.assert_allclose(np.concatenate(pieces), leaps_by_definition(places))


def test_leaps_are_those_of_markers_that_are_usually_seen():
    places = moving(12, 40)
    places[:8, 3] = 0.0  # at 0, 0, 0 in two of three frames
    places[:6, 5] = 0.0  # in half of them
    read, where, raw = stored(places)
    some = _usually_seen(np.frombuffer(raw, "<f4").reshape(12, -1), 40)
    seen = [k for k in range(40) if k != 3]
    assert some.tolist() == [seen[int(at)] for at in np.linspace(0, 38, 16)]
    np.testing.assert_allclose(np.concatenate(list(_leaps(read, where, 12))), leaps_by_definition(places[:, some]))


def test_where_no_marker_is_usually_seen_all_count():
    assert _usually_seen(np.zeros((3, 20), "<f4"), 5).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("count", [1, 2, 15, 16, 17, 31, 100])
def test_sixteen_markers_are_spread_from_the_first_to_the_last(count):
    found = _spread(np.arange(count) + 5).tolist()
    assert (found[0], found[-1], len(found)) == (5, count + 4, min(count, 16))
    assert max(np.diff(found), default=0) <= max(1, -(-count // 15))


def candidates_by_definition(leaps):
    first = [k for k in range(len(leaps)) if leaps[k] > 1.5 * max(leaps[:k], default=0.0)][:16]
    largest = sorted(range(len(leaps)), key=lambda k: -leaps[k])[:16]
    usual = {k: np.median(leaps[:k]) if k >= 5 else 0.0 for k in range(len(leaps))}
    return [k for k in sorted({*first, *largest}) if leaps[k] > 4 * usual[k]]


@pytest.mark.parametrize("seed", range(12))
def test_candidates_are_the_first_and_the_largest_leaps_beyond_the_usual(seed):
    rng = np.random.default_rng(seed)
    leaps = rng.lognormal(0.0, 1.5, int(rng.integers(1, 60)))
    leaps[rng.random(len(leaps)) < 0.2] = 0.0
    assert _candidates(leaps) == candidates_by_definition(leaps.tolist())


def test_among_equal_leaps_the_first_are_candidates():
    leaps = np.array([0.0] * 6 + [1.0] * 40)
    assert _candidates(leaps) == candidates_by_definition(leaps.tolist()) == [6, 7, 8, 9, 10, 11]


@pytest.mark.parametrize(("before", "usual"), [(4, 0.0), (5, 1.0), (6, 1.0)])
def test_a_leap_is_compared_with_five_frames_before_it_or_with_none(before, usual):
    """Four times the median is not beyond it."""
    leaps = np.array([1.0] * before + [4.0])
    assert (before in _candidates(leaps)) == (usual == 0.0)
    leaps[-1] = np.nextafter(4.0, 5.0)
    assert before in _candidates(leaps)


@pytest.mark.parametrize(
    ("width", "block", "frames"),
    [(512, 3, {3}), (256, 1, {2, 3}), (1024, 3, {1}), (500, 0, {0, 1}), (513, 1, {0, 1}), (511, 1, {1, 2})],
)
def test_a_block_lies_in_the_frames_that_its_bytes_are_of(width, block, frames):
    assert _frames_of([block], width) == {byte // width for byte in range(512 * block, 512 * block + 512)} == frames


def shifted(before, by, frames=12, points=6):
    """Frames in steady motion by whole numbers, and foreign bytes in the frame behind `before`."""
    start = np.random.default_rng(3).integers(-90, 90, (points, 3)) * 8
    places = start + np.arange(frames)[:, None, None] * np.array([3, -2, 5])
    _, where, raw = stored(places.astype("<f4"))
    at = (before + 1) * where.width + 5
    raw = (raw[:at] + b"\x5a" * by + raw[at:])[: len(raw)]
    return (lambda at, size: raw[at : at + size]), where


@pytest.mark.parametrize("by", [1, 4, 7, 16, 33, 95])
@pytest.mark.parametrize("before", [1, 4])
def test_a_shift_is_found_by_its_bytes_and_steady_motion_goes_on_exactly_behind_it(before, by):
    assert _shift_behind(*shifted(before, by), before, 12) == (0.0, by)


def test_no_shift_is_found_where_there_is_none_or_too_few_frames_are_behind_it():
    read, where = shifted(4, 7)
    assert _shift_behind(read, where, 7, 12) is None
    assert _shift_behind(read, where, 4, 6) is None
    assert _shift_behind(read, where, 4, 7) == (0.0, 7)


def test_the_frame_behind_the_last_wanted_one_says_nothing_of_a_shift():
    """It would continue the frame before it as that stands, as if nothing were shifted."""
    by, before, count = 16, 4, 7
    read, where = shifted(before, by)
    frames = [np.frombuffer(read(k * where.width, where.width), "<f4").reshape(-1, 4) for k in (before, before + 2)]
    after = frames[1] + (frames[1] - frames[0]) / 2

    def other(at, size):
        raw = bytearray(read(0, 12 * where.width))
        raw[count * where.width + by : (count + 1) * where.width] = after.astype("<f4").tobytes()[by:]
        return bytes(raw[at : at + size])

    assert _shift_behind(other, where, before, count) == (0.0, by)
    assert _shift_behind(other, where, before, count + 1) is None


def test_numbers_are_read_later_by_each_shift_and_are_zeros_behind_the_end(monkeypatch):
    places = moving(3, 5)
    read, where, raw = stored(places)
    padded = raw + bytes(200)
    shifts = [0, 3, 8, 40, 79]
    for at_once in (1, 2, 5, 100):
        monkeypatch.setattr(c3d_shifts, "SHIFTS_AT_ONCE", at_once)
        found = _numbers(read, where, 2, np.array([0, 2, 4]), shifts)
        assert found.shape == (5, 3, 4)
        for row, by in zip(found, shifts, strict=True):
            whole = np.frombuffer(padded, "<f4", 20, 2 * where.width + by).reshape(5, 4)
            usable = np.abs(whole[[0, 2, 4]]) > 1e-37
            np.testing.assert_array_equal(row[usable], whole[[0, 2, 4]][usable].astype(float))


def test_distances_are_of_the_farthest_axis_and_what_is_no_number_is_as_far_as_can_be():
    positions = np.array([[[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0]], [[np.inf, 0.0, 0.0], [-np.inf, 0.0, 0.0]]])
    found = _off(positions, [np.array([[1.0, 5.0, 1.0], [0.0, 0.0, 0.0]]), np.zeros((2, 3))])
    assert found.tolist() == [[[3.0, LARGEST], [LARGEST, LARGEST]], [[3.0, LARGEST], [LARGEST, LARGEST]]]


def test_a_shape_is_compared_without_the_common_displacement():
    last = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    moved, bent, lost = last + np.array([5.0, -3.0, 2.0]), last.copy(), last.copy()
    bent[2, 2] = 0.6
    lost[0, 0] = np.nan
    found = _unlike(np.array([moved, bent, lost]), last)
    assert found == pytest.approx([0.0, 0.2, LARGEST / 3])


def test_positions_continue_a_path_from_before_or_from_behind():
    """The first reading is off by its nearer prediction; of the others nine markers in ten have to be near."""
    rng = np.random.default_rng(5)
    earlier, way = rng.normal(0, 100, (20, 3)), rng.normal(0, 1, (20, 3))
    last, steps = earlier + way, 2
    behind = np.stack([last + 40.0, last + steps * way, last + 3.0])
    behind[1, :2] += 50.0  # one marker in ten
    median, nearest = _continue(behind, behind[0] + 20.0, last, earlier, steps)
    assert median == pytest.approx(0.0)  # 40 back by two steps of 20
    median, nearest = _continue(behind, behind[0], last, earlier, steps)
    off = np.abs(behind[0] - last - steps * way).max(1)
    assert median == pytest.approx(min(np.median(off), 40.0))
    expected = [
        min(np.quantile(np.abs(one - aim).max(1), 0.9) for aim in (last, last + steps * way)) for one in behind[1:]
    ]
    np.testing.assert_allclose(nearest, expected)
