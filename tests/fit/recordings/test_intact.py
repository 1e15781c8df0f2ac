"""A take with a hole is used where it is whole, and what is missing is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fit.recordings.intact import FRAME_FIELDS, SETTLING_TIME, describe_missing, longest_intact
from tests.formats.test_archive import a_take


def with_a_hole(first, last, frames=600):
    """Twenty seconds, of which frames `first` to `last` are missing."""
    whole = a_take(frames=frames)
    kept = np.r_[0:first, last + 1 : frames]
    arrays = {
        name: getattr(whole, name)[kept]
        for name in ("time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers")
    }
    span = (float(whole.time[first - 1]), float(whole.time[last + 1]))
    return replace(whole, **arrays, missing=(span,), is_complete=False)


def test_the_longer_part_is_used_from_its_own_beginning_and_what_went_before_is_forgotten():
    """Frames 0 to 149 and 181 to 599: the second has 419, of which the first 2.5 s, 75 frames, are not judged."""
    take = longest_intact(with_a_hole(150, 180))
    assert len(take.time) == 419
    assert not take.points_valid[: round(30 * SETTLING_TIME)].any()
    assert take.points_valid[80:].mean() > 0.9


def test_the_first_part_begins_at_the_takes_own_beginning_and_forgets_nothing():
    take = longest_intact(with_a_hole(400, 430))
    assert len(take.time) == 400
    assert take.points_valid[:30].mean() > 0.9


def test_of_two_parts_the_one_that_is_judged_for_longer_is_used():
    """Frames 0 to 99 are 3.3 s, 131 to 249 are 3.9 s, of which 1.4 s are judged; from rest all of them."""
    take = with_a_hole(100, 130, frames=250)
    assert longest_intact(take).time[0] == take.time[0]
    take.held[100:] = 0.0
    assert longest_intact(take).time[0] == take.time[100]


def test_a_take_whose_first_frames_are_lost_begins_with_cloth_of_unknown_state():
    """The first 30 frames, one second: the next 2.5 s, 75 frames, are not judged unless they begin at rest."""
    whole = a_take(frames=300)
    kept = slice(30, None)
    arrays = {name: values[kept] for name in FRAME_FIELDS if (values := getattr(whole, name)) is not None}
    for begin in (float(whole.time[0]), -np.inf):
        lost = replace(whole, **arrays, missing=((begin, float(whole.time[30])),), is_complete=False)
        used = longest_intact(lost)
        assert len(used.time) == 270
        assert not used.points_valid[:75].any()
        assert used.points_valid[80:].mean() > 0.9
        assert describe_missing([lost])[0].endswith(
            "; its first 2.5 s are not judged, as how the cloth hung there is lost."
        )
        still = replace(lost, held=np.zeros_like(lost.held))
        assert longest_intact(still).points_valid[:75].mean() > 0.9


def test_a_part_that_begins_at_rest_forgets_nothing():
    take = with_a_hole(150, 180)
    take.held[150:] = 0.0
    assert longest_intact(take).points_valid[:30].mean() > 0.9


@pytest.mark.parametrize(("size", "is_at_rest"), [(0.0039, True), (0.0041, False)])
def test_ends_that_tremble_by_four_millimetres_in_half_a_second_are_not_at_rest(size, is_at_rest):
    """Fifteen frames, of which the middle one is where the ends are on average; what comes later may move."""
    take = with_a_hole(150, 180)
    take.held[150:] = 0.0
    take.held[150:165, 1, 2] = size * np.sqrt(15 / 14) * np.array([1.0, -1.0] * 7 + [0.0])
    take.held[165:, 1, 2] = 1.0
    assert (longest_intact(take).points_valid[:30].mean() > 0.9) == is_at_rest


def test_of_parts_with_more_frames_and_longer_ones_the_longer_is_used():
    """Frames 0 to 299 in ten seconds, and 331 to 599 whose clock went half as fast."""
    take = with_a_hole(300, 330)
    later = take.time[300:]
    slow = np.concatenate([take.time[:300], later[0] + 2 * (later - later[0])])
    assert len(longest_intact(replace(take, time=slow)).time) == 269


@pytest.mark.parametrize("missing", [(), ((5.0, 5.4),), ((7.0, np.inf),)])
def test_short_gaps_and_a_lost_end_leave_the_take_as_it_is(missing):
    """0.4 s are bridged, as where the hanger was not seen for so long."""
    take = replace(a_take(), missing=missing)
    assert longest_intact(take) is take


def test_what_is_missing_and_what_is_used_is_said():
    """Frame 149 is at 4.97 s, frame 181 at 6.03 s, the last at 19.97 s."""
    (note,) = describe_missing([a_take(), with_a_hole(150, 180)])
    assert note == (
        "Warning: the take a is incomplete (569 frames are left; missing: 4.97 to 6.03 s); "
        "used: 6.03 to 19.97 s; its first 2.5 s are not judged, as how the cloth hung there is lost."
    )


def test_of_a_take_that_only_lacks_its_end_all_that_is_left_is_used():
    (note,) = describe_missing([replace(a_take(), is_complete=False)])
    assert note.endswith("(150 frames are left; missing: its end was never written).")
