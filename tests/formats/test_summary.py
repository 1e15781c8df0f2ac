"""A take's figures, each worked by hand."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.fault_words import state_of_take
from formats.garment import TrackedPoint
from formats.missing import missing_words
from formats.rig import Calibration
from formats.summary import describe, summarise
from formats.take import FrameState
from tests.formats.test_archive import a_scan, a_take

FRAMES = 60


def made():
    """Two seconds at 30 frames a second, with chosen values for each figure."""
    take = a_take(frames=FRAMES)
    valid = np.ones((FRAMES, 4), bool)
    valid[:15, 0] = False
    valid[:, 3] = False
    sd = np.full((FRAMES, 4, 3), 0.003)
    sd[..., 0, :] = [0.003, 0.004, 0.0]
    sd[:15, 0] = 9.0  # not seen
    held = np.zeros((FRAMES, 2, 3))
    held[10, 0] = (0.02, -0.03, 0.0)
    held[20, 0] = (-0.02, 0.0, 0.004)
    held_valid = np.ones((FRAMES, 2), bool)
    held_valid[:6, 0] = False
    held[:6] = 5.0
    state = np.zeros(FRAMES, np.uint16)
    state[:3] = FrameState.MARKER_LOST
    state[2:7] |= FrameState.TOO_FAR | FrameState.CLOCK_JUMPED
    pitch = np.full(FRAMES, np.nan)
    pitch[:20] = 0.1
    hidden = np.zeros((FRAMES, 4), bool)
    hidden[:30, 3] = True
    quality = np.full(FRAMES, np.nan)
    quality[:5] = (0.1, 0.2, 0.9, 0.95, 1.0)
    return replace(
        take, time=np.arange(FRAMES) / 30 + 7.0, points_valid=valid, points_sd=sd, held=held, held_valid=held_valid,
        state=state, pitch=pitch, points_hidden=hidden, quality=quality,
    )  # fmt: skip


def test_a_summary_has_the_figures_of_its_take():
    found = summarise(made())
    assert (found["frames"], found["duration_s"], found["rate_hz"]) == (60, pytest.approx(59 / 30, abs=5e-4), 30.0)
    assert [p["seen_percent"] for p in found["points"]] == [75.0, 100.0, 100.0, 0.0]
    assert [p["hidden_percent"] for p in found["points"]] == [0.0, 0.0, 0.0, 50.0]
    # sqrt((9 + 16 + 0) / 3) mm of what was seen, and nothing of what never was.
    assert [p["sd_mm"] for p in found["points"]] == [pytest.approx(2.89), 3.0, 3.0, None]
    assert found["hanger_seen_percent"] == 90.0
    assert found["hanger_travel_mm"] == [40.0, 30.0, 4.0]
    assert found["pitch_seen_percent"] == pytest.approx(33.3)
    assert found["quality"] == 0.9
    states = {name: count for name, count in found["states"].items() if count}
    assert states == {"marker lost": 3, "too far": 5, "clock jumped": 5}
    unseen = replace(made(), held_valid=np.zeros((FRAMES, 2), bool), points_hidden=None, quality=None, pitch=None)
    found = summarise(unseen)
    assert found["hanger_travel_mm"] == [0.0, 0.0, 0.0]
    assert (found["quality"], found["pitch_seen_percent"]) == (None, 0.0)
    assert [p["hidden_percent"] for p in found["points"]] == [0.0] * 4


def test_a_summary_says_its_figures_in_words():
    said = describe(summarise(made()))
    for line in (
        "length    1.967 s, 60 frames, 30 a second", "garment   sheet, 30.0 g",
        "hanger    seen in 90 % of the frames, travels 40 x 30 x 4 mm",
        "point     p0             seen  75.0 %   noise 2.89 mm a coordinate", "seen   0.0 %   never seen   hidden 50 %",
        "quality   0.9 in the median frame", "state     too far in 5 frames", "note      who: me",
    ):  # fmt: skip
        assert line in said
    assert "INCOMPLETE" not in said
    assert "INCOMPLETE" in describe(summarise(replace(made(), is_complete=False)))


def test_a_summary_is_reported_line_by_line():
    """Every line but those of points, which the test above reads; 25 and 7 of 59 steps go over a hole."""
    made_once = made()
    time = made_once.time + np.repeat([0.0, 1.0, 3.0], [30, 20, 10])
    known = Calibration(
        gravity_from="accelerometer", gravity_sd_degrees=0.25, depth_scale=1.0123, depth_scale_sd=0.004,
        depth_offset_px=(1.25, -0.5), depth_offset_sd_px=(0.3, 0.2), held_sd_m=((1e-3, 2e-3, 1e-3), (1e-3, 1e-3, 3e-3)),
    )  # fmt: skip
    spans = ((time[29], time[30]), (time[49], time[50]))
    take = replace(
        made_once, time=time, missing=spans, is_complete=False, scans=(a_scan(7.4, 1),) * 2,
        rig=msgspec.structs.replace(made_once.rig, calibration=known),
    )  # fmt: skip
    assert describe(summarise(take)).splitlines() == [
        "take      a   (INCOMPLETE)",
        "missing   0.97 to 2.00 s and 2.63 to 4.67 s",
        "created   2026-01-01T00:00:00Z",
        "length    4.967 s, 60 frames, 30 a second",
        "rig       bench",
        "calibrated gravity +- 0.25 degrees (accelerometer); depth scale 1.0123 +- 0.004; "
        "depth offset 1.25, -0.50 px +- 0.2; held ends +- 3.0 mm",
        "garment   sheet, 30.0 g",
        "hanger    seen in 90 % of the frames, travels 40 x 30 x 4 mm",
        "motion    still",
        "tracked   material points, which stay on the cloth",
        "point     p0             seen  75.0 %   noise 2.89 mm a coordinate",
        "point     p1             seen 100.0 %   noise 3 mm a coordinate",
        "point     p2             seen 100.0 %   noise 3 mm a coordinate",
        "point     p3             seen   0.0 %   never seen   hidden 50 %",
        "quality   0.9 in the median frame, 1 at best",
        "surface   scanned 2 times",
        "state     marker lost in 3 frames",
        "state     clock jumped in 5 frames",
        "state     too far in 5 frames",
        "source    test",
        "note      who: me",
    ]


def of_points(count, sd):
    """A single frame of silhouette points with given standard deviations [m]; a point without one was not seen."""
    take = a_take(frames=1)
    garment = msgspec.structs.replace(
        take.garment, points_are="silhouette",
        points=tuple(TrackedPoint(name=f"p{k}", at_m=(0.01 * k, -0.1)) for k in range(count)),
    )  # fmt: skip
    return replace(
        take, garment=garment, points=np.zeros((1, count, 3)), points_valid=np.full((1, count), sd is not None),
        points_sd=np.full((1, count, 3), sd or np.nan), state=np.zeros(1, np.uint16), source="", notes={},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("count", "sd", "line"),
    [
        (12, 0.002, "point     p11            seen 100.0 %   noise 2 mm a coordinate"),
        (13, 0.002, "points    13, seen 100 %, median noise 2 mm a coordinate"),
        (13, None, "points    13, seen 0 %, never seen"),
    ],
)
def test_more_than_twelve_points_are_reported_in_one_line_and_a_single_frame_has_no_rate(count, sd, line):
    told = describe(summarise(of_points(count, sd))).splitlines()
    assert told[-1] == line
    assert told[2] == "length    0 s, 1 frame"
    assert told[7] == "tracked   points of a silhouette, which slide over the cloth"
    assert len(told) == (20 if count == 12 else 9)


@pytest.mark.parametrize(
    ("known", "words"),
    [
        ({}, None),
        ({"gravity_sd_degrees": 0.5}, "gravity +- 0.5 degrees"),
        ({"gravity_sd_degrees": 0.0}, "gravity exact"),
        ({"depth_scale": 0.98, "depth_scale_sd": 0.01}, "depth scale 0.9800 +- 0.01"),
        ({"depth_offset_sd_px": (np.inf, 0.4)}, "depth offset 0.00, 0.00 px +- 0.4 along the one axis that was "
                                                "measured"),
        ({"gravity_sd_degrees": 1.0, "held_sd_m": ((0.001,) * 3, (0.002,) * 3)},
         "gravity +- 1 degrees; held ends +- 2.0 mm"),
    ],
)  # fmt: skip
def test_a_summary_names_what_was_calibrated_and_nothing_else(known, words):
    take = made()
    take = replace(take, rig=msgspec.structs.replace(take.rig, calibration=Calibration(**known)))
    told = [line for line in describe(summarise(take)).splitlines() if line.startswith("calibrated")]
    assert told == ([f"calibrated {words}"] if words else [])


@pytest.mark.parametrize(
    ("spans", "words"),
    [
        ((), ""),
        (((12.0, 13.5),), "2.00 to 3.50 s"),
        (((12.0, np.inf),), "from 2.00 s on"),
        (((-np.inf, 12.0),), "all frames before 2.00 s"),
        (((14.028, 14.032), (16.0, 17.0)), "at 4.03 s and 6.00 to 7.00 s"),
        (((11.0, 12.0), (13.0, 14.0), (15.0, np.inf)), "1.00 to 2.00 s, 3.00 to 4.00 s and from 5.00 s on"),
        (((8.0, 9.0), (11.0, 12.0)), "0.00 to 1.00 s and 3.00 to 4.00 s"),  # before the first frame that is left
        (tuple((11.0 + k, 11.5 + k) for k in range(5)),
         "1.00 to 1.50 s, 2.00 to 2.50 s, 3.00 to 3.50 s, 4.00 to 4.50 s and 5.00 to 5.50 s"),
        (tuple((11.0 + k, 11.5 + k) for k in range(6)),
         "1.00 to 1.50 s, 2.00 to 2.50 s, 3.00 to 3.50 s, 4.00 to 4.50 s and 2 more spans"),
    ],
)  # fmt: skip
def test_missing_seconds_count_from_the_first_frame_and_at_most_five_spans_are_listed(spans, words):
    take = replace(a_take(), time=a_take().time - a_take().time[0] + 10.0, missing=spans)
    assert missing_words(take) == words
    assert missing_words(replace(take, missing=()), spans) == words


def test_shares_are_rounded_to_a_tenth_of_a_per_cent():
    """40 and 20 of 60 frames are 66.67 and 33.33 %."""
    take = made()
    held_valid, valid = np.ones((FRAMES, 2), bool), np.ones((FRAMES, 4), bool)
    held_valid[:20, 0], valid[:40, 0] = False, False
    found = summarise(replace(take, held_valid=held_valid, points_valid=valid))
    assert (found["hanger_seen_percent"], found["points"][0]["seen_percent"]) == (66.7, 33.3)


def test_a_take_without_a_file_counts_no_part_as_damaged_or_of_others():
    state = msgspec.to_builtins(state_of_take(a_take()))
    counts = ("missing_frames", "missing_scans", "unread_blocks", "damaged_blocks", "other_blocks", "other_takes")
    assert {state[name] for name in (*counts, "trailing_bytes")} == {0}
