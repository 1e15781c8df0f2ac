"""The used part of a take with missing frames, and the warning on the missing ones."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from time import process_time

import numpy as np
import pytest

from fit.errors import FitError
from fit.recordings.intact import FRAME_FIELDS, describe_missing, intact_part
from fit.recordings.recording import prepare
from formats.sights import SETTLING
from tests.fit.recordings.silhouettes import silhouette_sheet, swung
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


def test_both_sides_of_a_hole_in_the_middle_are_used():
    """Frames 0 to 149 and 181 to 599: the second part is judged for 11.4 s, and the hole lasts 1.1 s."""
    take = with_a_hole(150, 180)
    used = intact_part(take)
    assert len(used.time) == 569
    assert used.points_valid[:30].mean() > 0.9
    (note,) = describe_missing([take])
    assert note == (
        "Warning: the take a is incomplete (569 frames are left; missing: 4.97 to 6.03 s); "
        "used: 0.00 to 4.97 s and 6.03 to 19.97 s; "
        "2.5 s after a hole are not judged, as how the hanger moved there is lost."
    )


@pytest.mark.parametrize(
    ("first", "last", "left"),
    [
        (150, 240, slice(0, 509)),  # 5.0 s, a hole of 3.1 s, 9.4 s that are judged
        (150, 350, slice(150, 399)),  # 5.0 s, 6.7 s, 5.8 s
        (30, 329, slice(30, 300)),  # 1.0 s, 10.0 s, 6.5 s
        (20, 60, slice(20, 559)),  # 0.6 s, 1.4 s, 15.4 s
        (150, 550, slice(0, 150)),  # 5.0 s, 13.4 s, none of 1.6 s
        (400, 560, slice(0, 400)),  # 13.3 s, 5.4 s, none of 1.3 s
    ],
)
def test_a_hole_is_bridged_only_where_both_sides_are_judged_for_longer_than_it_lasts(first, last, left):
    take = with_a_hole(first, last)
    used = intact_part(take)
    assert used.time.tolist() == take.time[left].tolist()
    if left.start:
        assert not used.points_valid[: round(30 * SETTLING)].any()
        assert used.points_valid[80:].mean() > 0.9


def test_several_holes_are_bridged_and_the_parts_listed():
    """Frames 150 to 179 and 300 to 329 are missing, one second each."""
    take = with_a_hole(150, 179)
    kept = np.r_[0:270, 300:570]
    arrays = {name: values[kept] for name in FRAME_FIELDS if (values := getattr(take, name)) is not None}
    second = (float(take.time[269]), float(take.time[300]))
    twice = replace(take, **arrays, missing=(*take.missing, second))
    assert len(intact_part(twice).time) == 540
    (note,) = describe_missing([twice])
    assert "missing: 4.97 to 6.00 s and 9.97 to 11.00 s); used: 0.00 to 4.97 s, 6.00 to 9.97 s and 11.00 to" in note


def test_holes_by_the_thousand_take_no_time():
    """A header may list ten thousand; each frame is then a part of its own, and the last 300 frames are whole."""
    take = a_take(frames=3000)
    take = replace(take, time=np.concatenate([np.arange(2700.0), 2700 + np.arange(300) / 30]), is_complete=False)
    take = replace(take, missing=tuple((float(a), float(b)) for a, b in pairwise(take.time[:2700])))
    begin = process_time()
    used = intact_part(take)
    assert process_time() - begin < 1.0
    assert len(used.time) >= 300


def test_frames_that_were_recorded_are_simulated_on_both_sides_of_a_hole():
    """Twelve seconds at 20 a second, of which 5 to 6.5 s are lost: judged are 5 s before and 3 s after, 2.5 s later."""
    time = np.arange(0, 12, 1 / 20)
    whole = swung(silhouette_sheet("material"), time, time)
    kept = (time <= 5.0) | (time >= 6.5)
    arrays = {name: values[kept] for name in FRAME_FIELDS if (values := getattr(whole, name)) is not None}
    recording = prepare(replace(whole, **arrays, missing=((5.0, 6.5),), is_complete=False))
    judged = recording.time[recording.valid.any(1)]
    assert recording.duration == pytest.approx(11.95, abs=0.06)
    assert ((judged < 5.05) | (judged > 6.45 + SETTLING)).all()
    assert (judged < 5.05).sum() > 95
    assert (judged > 6.45 + SETTLING).sum() > 55


def test_a_take_whose_first_frames_are_lost_begins_with_cloth_of_unknown_state():
    """The first 30 frames, one second: the next 2.5 s, 75 frames, are not judged unless they begin at rest."""
    whole = a_take(frames=300)
    kept = slice(30, None)
    arrays = {name: values[kept] for name in FRAME_FIELDS if (values := getattr(whole, name)) is not None}
    for begin in (float(whole.time[0]), -np.inf):
        lost = replace(whole, **arrays, missing=((begin, float(whole.time[30])),), is_complete=False)
        used = intact_part(lost)
        assert len(used.time) == 270
        assert not used.points_valid[:75].any()
        assert used.points_valid[80:].mean() > 0.9
        assert describe_missing([lost])[0].endswith(
            "; its first 2.5 s are not judged, as how the cloth hung there is lost."
        )
        still = replace(lost, held=np.zeros_like(lost.held), points=np.ones_like(lost.points))
        assert intact_part(still).points_valid[:75].mean() > 0.9


def test_holes_that_leave_nothing_to_judge_are_named_as_the_cause():
    """Ten seconds, every other one of which is lost: each stretch ends before it would be judged."""
    time = np.arange(0, 10, 1 / 20)
    whole = swung(silhouette_sheet("material"), time, time)
    kept = time.astype(int) % 2 == 1
    arrays = {name: values[kept] for name in FRAME_FIELDS if (values := getattr(whole, name)) is not None}
    spans = tuple((k - 0.05 if k else -np.inf, k + 1.0) for k in range(0, 10, 2))
    with pytest.raises(FitError) as caught:
        prepare(replace(whole, **arrays, missing=spans, is_complete=False))
    assert caught.value.what == "no stretch between its gaps is long enough: 2.5 s after each gap are not judged"


def first_part_lost():
    """Fourteen seconds after frames that are lost."""
    whole = a_take(frames=600)
    kept = slice(181, None)
    arrays = {name: values[kept] for name in FRAME_FIELDS if (values := getattr(whole, name)) is not None}
    return replace(whole, **arrays, missing=((-np.inf, float(whole.time[181])),), is_complete=False)


def test_a_part_that_begins_at_rest_forgets_nothing():
    take = first_part_lost()
    take.held[:], take.points[:] = 0.0, 1.0
    assert intact_part(take).points_valid[:30].mean() > 0.9


@pytest.mark.parametrize(("swings", "is_judged"), [(1, True), (3, False)])
def test_cloth_that_swings_under_a_resting_hanger_is_not_at_rest(swings, is_judged):
    """Of four points one may be tracked badly; where most of them swing by 4 cm, the cloth does."""
    take = first_part_lost()
    take.held[:], take.points[:] = 0.0, 1.0
    take.points[:, :swings, 1] += 0.04 * np.sin(2 * np.pi * 0.8 * take.time)[:, None]
    assert (intact_part(take).points_valid[:30].mean() > 0.9) == is_judged


def test_cloth_that_nobody_sees_is_not_known_to_rest():
    take = first_part_lost()
    take.held[:], take.points[:] = 0.0, 1.0
    take.points_valid[:20] = False
    assert not intact_part(take).points_valid[20:60].any()


@pytest.mark.parametrize(("size", "is_at_rest"), [(0.0039, True), (0.0041, False)])
def test_ends_that_tremble_by_four_millimetres_in_half_a_second_are_not_at_rest(size, is_at_rest):
    """Fifteen frames, of which the middle one is where the ends are on average; what comes later may move."""
    take = first_part_lost()
    take.held[:], take.points[:] = 0.0, 1.0
    take.held[:15, 1, 2] = size * np.sqrt(15 / 14) * np.array([1.0, -1.0] * 7 + [0.0])
    take.held[15:, 1, 2] = 1.0
    assert (intact_part(take).points_valid[:30].mean() > 0.9) == is_at_rest


def test_of_parts_with_more_frames_and_longer_ones_the_longer_is_used():
    """Frames 0 to 299 in ten seconds, and after 16 s 331 to 599 whose clock went half as fast."""
    take = with_a_hole(300, 330)
    later = take.time[300:]
    slow = np.concatenate([take.time[:300], 15 + later[0] + 2 * (later - later[0])])
    missing = ((float(slow[299]), float(slow[300])),)
    assert len(intact_part(replace(take, time=slow, missing=missing)).time) == 269


@pytest.mark.parametrize("missing", [(), ((5.0, 5.4),), ((7.0, np.inf),)])
def test_short_gaps_and_a_lost_end_leave_the_take_as_it_is(missing):
    """0.4 s are bridged, as where the hanger was not seen for so long."""
    take = replace(a_take(), missing=missing)
    assert intact_part(take) is take


def test_missing_and_used_seconds_are_stated():
    """Frame 29 is at 0.97 s, frame 330 at 11.00 s, the last at 19.97 s."""
    (note,) = describe_missing([a_take(), with_a_hole(30, 329)])
    assert note == (
        "Warning: the take a is incomplete (300 frames are left; missing: 0.97 to 11.00 s); "
        "used: 11.00 to 19.97 s; its first 2.5 s are not judged, as how the cloth hung there is lost."
    )


def test_of_a_take_that_only_lacks_its_end_all_that_is_left_is_used():
    (note,) = describe_missing([replace(a_take(), is_complete=False)])
    assert note.endswith("(150 frames are left; missing: its end was never written).")


@pytest.mark.parametrize(("seen", "is_at_rest"), [(1, False), (2, True)])
def test_rest_shows_in_two_frames_of_the_ends_and_not_in_one(seen, is_at_rest):
    take = first_part_lost()
    take.held[:], take.points[:] = 0.0, 1.0
    take.held[seen:15] = np.nan
    assert (intact_part(take).points_valid[:30].mean() > 0.9) == is_at_rest
