"""Bad input: each kind has its bit in the take, its sentence for people, and never a crash."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import msgspec
import numpy as np
import pytest

from capture.errors import HangerGapError, NoMarkersError, UnfitTakeError
from capture.hanger.fiducial_tracker import MarkerTracker
from capture.recording.condition import Condition, ConditionWatch, Lamp, condition_of
from capture.recording.frame_faults import HangerWatch, is_garment_covered, view_faults
from capture.recording.session import record
from firmware_host.errors import SensorStalledError
from formats.archive import read_take
from formats.summary import STATE_NAMES
from formats.take import FrameState
from tests.capture.garment.towel import GARMENT, HANGER
from tests.capture.garment.towel_scenes import BODY, LEGS, RIG, hung, nothing, scenes
from tests.capture.stage import CAMERA, StageSensor


class Spoilt(StageSensor):
    """Frames with other fields, or an error in the place of one."""

    def __init__(self, frames, changes=None):
        super().__init__(frames)
        self._changes = changes or {}

    def read(self, timeout_s=1.0):
        number = self._next
        frame = super().read(timeout_s)
        change = self._changes.get(number, {})
        if isinstance(change, Exception):
            raise change
        return frame if frame is None else dataclasses.replace(frame, **change)


def recorded(tmp_path, frames, changes=None, **options):
    report = record(
        Spoilt(frames, changes), RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now", **options
    )  # fmt: skip
    return report, read_take(tmp_path / "t.mcap")


def unseen(good):
    """A frame without a colour picture, in which the hanger is not searched."""
    return [(good[0][0], None)]


def test_twelve_good_frames_have_no_bits(good, tmp_path):
    report, take = recorded(tmp_path, good * 4)
    assert (take.state == 0).all()
    assert report.conditions == {Condition.GOOD: 12}


def test_a_take_in_which_the_hanger_is_hardly_ever_seen_is_kept_and_reported(good, tmp_path):
    """12 frames of 132 are one in eleven; 33 of 60 are enough. Most of the others are of a bare wall."""
    report, take = recorded(tmp_path, [*good * 4, *unseen(good) * 59, *nothing() * 30, nothing()[0]])
    assert take.is_complete
    assert len(take.time) == 132
    assert "in 12 of 132 frames; the take was kept" in str(report.doubt)
    assert "record it again: show both markers to the sensor" in str(report.doubt)
    assert recorded(tmp_path, [*good * 11, *unseen(good) * 27])[0].doubt is None


def test_a_take_of_nineteen_frames_with_the_hanger_is_kept_and_no_fit_can_use_it(good, tmp_path):
    report, take = recorded(tmp_path, [*good * 6, good[0], *unseen(good)])
    assert len(take.time) == 20
    assert isinstance(report.doubt, UnfitTakeError)
    words = "were seen together in 19 frames, and a fit needs 20; the take was kept, but nothing can be fitted to it"
    assert words in str(report.doubt)


def test_a_hanger_that_is_out_of_view_for_over_half_a_second_in_between_is_reported(good, tmp_path):
    """Thirty frames a second: from one sight to the next 20 frames later are 0.67 s, 14 frames later 0.47 s."""
    empty = unseen(good)
    report, take = recorded(tmp_path, [*good, *empty * 19, *good * 6, *empty * 16, *good])
    assert take.is_complete
    assert isinstance(report.doubt, HangerGapError)
    assert "not seen together for 0.7 s from 0.1 s on, in all 2 times for over 0.5 s; the take was kept" in str(
        report.doubt
    )
    assert recorded(tmp_path, [*good * 4, *empty * 13, *good * 4])[0].doubt is None


def test_a_hanger_that_comes_late_and_leaves_early_is_no_doubt(good, tmp_path):
    empty = unseen(good) * 20
    assert recorded(tmp_path, [*empty, *good * 11, *empty])[0].doubt is None


@pytest.mark.parametrize(
    ("bad", "bits"),
    [
        pytest.param(lambda: scenes(), FrameState.MARKER_LOST, id="no markers", marks=pytest.mark.slow),
        pytest.param(
            lambda: scenes(*hung(markers=(1,))), FrameState.MARKER_LOST | FrameState.ONE_MARKER, id="one marker"
        ),
        pytest.param(
            lambda: scenes(*hung(), BODY),
            FrameState.MARKER_LOST | FrameState.VIEW_BLOCKED,
            id="person in front",
            marks=pytest.mark.slow,
        ),
        pytest.param(lambda: scenes(*hung(), LEGS), FrameState.VIEW_BLOCKED, id="garment covered"),
        pytest.param(lambda: scenes(*hung((0, -0.1, 0.7))), FrameState.TOO_NEAR, id="too near", marks=pytest.mark.slow),
        pytest.param(
            lambda: [(np.where(d < 700, 0, d).astype(np.uint16), c) for d, c in scenes(*hung((0, -0.1, 0.5)))],
            FrameState.TOO_NEAR | FrameState.MARKER_LOST,
            id="too near for depth",
        ),
    ],
)
def test_each_bad_view_has_its_bits_and_the_take_goes_on(good, tmp_path, bad, bits):
    """Twelve good frames; a second later two bad ones; a second later a good one."""
    times = {12: {"time_s": 1.4}, 13: {"time_s": 1.43}, 14: {"time_s": 2.4}}
    _, take = recorded(tmp_path, [*good * 4, *bad(), good[0]], times)
    assert (take.state[:12] == 0).all()
    without_garment = take.state[12:14] & ~np.uint16(FrameState.GARMENT_LOST)
    assert without_garment.tolist() == [bits, bits]
    assert take.held_valid[14].all()


def test_a_hanger_with_a_marker_of_eleven_pixels_is_too_far():
    """60 mm at 2.5 m are 13.8 px, which is enough."""
    depth, colour = scenes(*hung((0, -0.3, 2.5)))[0]
    sight = MarkerTracker(RIG).track(colour, depth, 0.0)
    assert sight.sides[0] == pytest.approx(575.8 * 0.06 / 2.5, abs=0.8)
    small = dataclasses.replace(sight, sides=np.array([11.0, 13.0]))
    assert HangerWatch(HANGER).faults(sight, depth, 0.0) == 0
    assert HangerWatch(HANGER).faults(small, depth, 0.0) == FrameState.TOO_FAR


def test_a_view_without_markers_is_judged_by_its_depth():
    assert view_faults(np.full((480, 640), 700, np.uint16)) == FrameState.TOO_NEAR
    assert view_faults(np.full((480, 640), 3600, np.uint16)) == FrameState.TOO_FAR
    assert view_faults(np.full((480, 640), 2000, np.uint16)) == 0
    assert view_faults(np.zeros((480, 640), np.uint16)) == 0


def test_a_garment_is_covered_by_surfaces_half_a_metre_nearer_over_a_quarter_of_it():
    held = np.array([[-0.2, -0.1, 1.6], [0.2, -0.1, 1.6]])  # 144 px wide, from row 203 on
    depth = np.full((480, 640), 1600, np.uint16)
    depth[203:240, 240:400] = 1000
    assert is_garment_covered(depth, held, CAMERA)  # 37 of 145 rows
    depth[203:240, 240:400] = 1200
    assert not is_garment_covered(depth, held, CAMERA)


def test_lost_depth_lost_colour_and_another_size_are_reported_frame_by_frame(good, tmp_path):
    changes = {
        12: {"depth": np.zeros_like(good[0][0])},
        13: {"colour": None},
        14: {"depth": good[0][0][::2, ::2], "colour": good[0][1][::2, ::2]},
        15: {"colour": good[0][1][::2, ::2]},
        16: {"dropped_before": 3},
    }
    report, take = recorded(tmp_path, good * 6, changes)
    lost = FrameState.MARKER_LOST | FrameState.GARMENT_LOST
    assert take.state[12:17].tolist() == [
        lost | FrameState.DEPTH_MISSING, lost | FrameState.COLOUR_MISSING, lost | FrameState.WRONG_SIZE,
        lost | FrameState.WRONG_SIZE, FrameState.FRAMES_DROPPED_BEFORE,
    ]  # fmt: skip
    assert report.conditions[Condition.WRONG_SIZE] == 2


@pytest.mark.parametrize(
    "leap", [pytest.param(-3600.0, id="an hour back"), pytest.param(3600.0, id="an hour forward"),
             pytest.param(-(2.0**32) / 1e6, id="a counter of 32 bits wraps around")],
)  # fmt: skip
def test_a_clock_that_was_set_goes_on_after_three_frames(good, tmp_path, leap):
    """Frames 12 to 29 are off by an hour: 12 and 13 are left out, 14 is frame 11 and three intervals later."""
    changes = {number: {"time_s": 5000.0 + (number + 1) / 30 + (leap if number >= 12 else 0.0)} for number in range(30)}
    report, take = recorded(tmp_path, good * 10, changes)
    assert take.is_complete
    assert len(take.time) == 30 - 2
    assert take.time[12] - take.time[11] == pytest.approx(3 / 30, abs=1e-5)
    assert take.time[-1] - take.time[12] == pytest.approx(15 / 30, abs=1e-5)
    assert np.flatnonzero(take.state & FrameState.CLOCK_JUMPED).tolist() == [12]
    assert (np.diff(take.time) > 0).all()
    assert report.conditions == {Condition.GOOD: 28, Condition.CLOCK: 2}


class Live(Spoilt):
    """A sensor that says it is live, so that its `host_time_s` is the time of the frame."""

    @property
    def info(self):
        return dataclasses.replace(super().info, is_live=True)


@pytest.mark.parametrize(
    ("kind", "dropped", "bit"),
    [(Spoilt, 300, FrameState.FRAMES_DROPPED_BEFORE), (Live, 300, FrameState.FRAMES_DROPPED_BEFORE), (Live, 0, 0)],
)
def test_a_pause_of_ten_seconds_is_a_gap_and_reported_and_not_a_clock_that_was_set(good, tmp_path, kind, dropped, bit):
    """Frame 3 comes 10 s late, after 300 that were dropped; where none were counted, the host's clock says so."""
    changes = {number: {"time_s": (number + 1) / 30 + 10.0} for number in range(3, 24)}
    for number in changes:
        changes[number]["host_time_s"] = changes[number]["time_s"]
    changes[3]["dropped_before"] = dropped
    sensor = kind(good * 8, changes)
    report = record(sensor, RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")
    take = read_take(tmp_path / "t.mcap")
    assert len(take.time) == 24
    assert take.time[3] - take.time[2] == pytest.approx(10.0 + 1 / 30, abs=1e-5)
    assert take.state.tolist() == [0] * 3 + [bit] + [0] * 20
    assert isinstance(report.doubt, HangerGapError)
    assert "not seen together for 10.0 s from 0.1 s on" in str(report.doubt)


def test_the_hosts_clock_says_when_a_recording_is_played_and_nothing_about_when_it_was_made(good, tmp_path):
    """Both jump by 10 s, and no frame was dropped: the clock was set."""
    later = [(number, (number + 1) / 30 + 10.0) for number in range(12, 24)]
    changes = {number: {"time_s": time, "host_time_s": time} for number, time in later}
    _, take = recorded(tmp_path, good * 8, changes)
    assert take.time[12] - take.time[11] == pytest.approx(3 / 30, abs=1e-5)
    assert take.state[12] == FrameState.CLOCK_JUMPED


def test_drops_before_a_frame_that_is_left_out_are_reported_with_the_next_one(good, tmp_path):
    """Frame 12 has a time of before; 13 is placed."""
    _, take = recorded(tmp_path, good * 5, {12: {"time_s": 0.1, "dropped_before": 2}})
    assert take.state.tolist() == [0] * 12 + [FrameState.FRAMES_DROPPED_BEFORE | FrameState.CLOCK_JUMPED, 0]


def test_a_clock_that_runs_backwards_is_announced_and_ends_with_the_time_that_was_asked_for(good, tmp_path):
    """Frame 11 is the last good one. The message comes 0.4 s later. --seconds ends the take without further frames."""
    changes = {number: {"time_s": (12 - number) / 30} for number in range(12, 200)}
    said = []
    report, take = recorded(
        tmp_path, good * 60, changes, seconds=2.0, announce=lambda time, condition: said.append((time, condition))
    )
    assert len(take.time) == report.frames == 12
    assert [condition for _, condition in said] == [Condition.GOOD, Condition.CLOCK]
    assert said[1][0] == pytest.approx(11 / 30 + 1 / 30 + 0.4, abs=1.5 / 30)
    assert report.conditions[Condition.CLOCK] == pytest.approx(2.0 * 30 - 12, abs=2)


@pytest.mark.parametrize("wrong", [{"marker_distance_m": 0.4}, {"marker_size_m": 0.1}])
def test_a_rig_with_other_marker_sizes_is_distinguished_from_markers_that_are_not_seen(good, tmp_path, wrong):
    """60 mm and 0.3 m apart in the picture."""
    hanger = msgspec.structs.replace(HANGER, **wrong)
    said = []
    with pytest.raises(
        NoMarkersError, match=rf"depth shows markers of 6[01] mm .* measure hanger.{next(iter(wrong))} again$"
    ):
        record(
            StageSensor(good * 4), msgspec.structs.replace(RIG, hanger=hanger), GARMENT, tmp_path / "t.mcap",
            take_id="t", created="now", announce=lambda time, condition: said.append(condition),
        )  # fmt: skip
    assert said == [Condition.MISFIT]
    assert "check that depth comes in millimetres" in said[0].value.advice


@pytest.mark.parametrize(
    ("seen", "hint"),
    [
        (lambda picture: picture[:, ::-1], "mirror image: switch the sensor's mirror off"),
        (lambda picture: 255 - picture, "white on black: print them black on white"),
        (lambda picture: np.full_like(picture, 90), "apart)"),
    ],
)
def test_markers_that_are_never_seen_are_sought_in_other_ways(good, tmp_path, seen, hint):
    otherwise = [(depth, np.ascontiguousarray(seen(colour))) for depth, colour in good * 2]
    with pytest.raises(NoMarkersError) as caught:
        record(StageSensor(otherwise), RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")
    assert str(caught.value).endswith(hint)


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        ({"dictionary": "DICT_6X6_50"}, "markers 0 and 1 of DICT_4X4_50 are seen: set the rig's hanger.dictionary"),
        ({"ids": (7, 8)}, "markers 0 and 1 are seen: set the rig's hanger.ids"),
    ],
)
def test_markers_that_the_rig_does_not_describe_are_named(good, tmp_path, wrong, hint):
    rig = msgspec.structs.replace(RIG, hanger=msgspec.structs.replace(HANGER, **wrong))
    with pytest.raises(NoMarkersError, match=f"mm apart; {hint}$"):
        record(StageSensor(good * 2), rig, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")


def test_a_recording_of_a_bad_view_says_why_there_is_no_take(good, tmp_path):
    near = scenes(*hung((0, -0.1, 0.5))) * 3
    sensor = Spoilt(near, {number: {"depth": np.where(near[0][0] < 700, 0, near[0][0])} for number in range(6)})
    with pytest.raises(NoMarkersError, match=r"in 0 of 6 frames.*mostly because: too near; go back until"):
        record(sensor, RIG, GARMENT, tmp_path / "t.mcap", take_id="t", created="now")
    assert list(tmp_path.iterdir()) == []


def test_a_sensor_that_fails_after_twelve_frames_leaves_a_finished_take(good, tmp_path):
    report, take = recorded(
        tmp_path, good * 6, {12: SensorStalledError("no frame for 5 s", where="sensor", advice="replug it")}
    )
    assert take.is_complete
    assert len(take.time) == 12
    assert report.failure.what == "no frame for 5 s"


def test_a_sensor_that_fails_at_once_is_what_is_reported(good, tmp_path):
    with pytest.raises(SensorStalledError):
        recorded(tmp_path, good, {2: SensorStalledError("no frame for 5 s", where="sensor", advice="replug it")})
    assert list(tmp_path.iterdir()) == []


def test_the_most_basic_fault_is_the_one_that_is_said():
    state = FrameState.MARKER_LOST | FrameState.GARMENT_LOST
    assert condition_of(state) is Condition.NO_MARKERS
    assert condition_of(state | FrameState.ONE_MARKER) is Condition.ONE_MARKER
    assert condition_of(state | FrameState.VIEW_BLOCKED | FrameState.TOO_NEAR) is Condition.BLOCKED
    assert condition_of(state | FrameState.COLOUR_MISSING) is Condition.NO_COLOUR
    assert condition_of(FrameState.FRAMES_DROPPED_BEFORE | FrameState.CLOCK_JUMPED) is Condition.GOOD


def test_a_condition_is_announced_when_it_has_lasted_and_not_when_it_flickers():
    watch = ConditionWatch()
    states = [Condition.GOOD] * 10 + [Condition.ONE_MARKER] * 5 + [Condition.GOOD] * 5 + [Condition.BLOCKED] * 20
    said = [(number, watch.add(number / 30, condition)) for number, condition in enumerate(states)]
    # 0.4 s are 12 frames: the blocked view is announced at frame 20 + 12.
    assert [entry for entry in said if entry[1]] == [(0, Condition.GOOD), (32, Condition.BLOCKED)]
    assert watch.worst is Condition.BLOCKED


def told(conditions):
    """What is announced of conditions 32 times a second (times without rounding): frame and condition."""
    watch = ConditionWatch()
    said = [(number, watch.add(number / 32, condition)) for number, condition in enumerate(conditions)]
    return [entry for entry in said if entry[1]]


def test_of_alternating_faults_the_one_of_most_frames_is_reported_and_the_lamp_keeps_its_rhythm():
    """Good frames, then not one for ten seconds: 13 frames are over 0.4 s. As many of both: the more basic one."""
    one, none, cloth = Condition.ONE_MARKER, Condition.NO_MARKERS, Condition.NO_GARMENT
    begin = (0, Condition.GOOD)
    assert told([Condition.GOOD] * 30 + [none, one] * 160) == [begin, (43, one)]
    assert told([Condition.GOOD] * 30 + [none, none, one] * 100) == [begin, (43, none)]
    assert told([Condition.GOOD] * 30 + [cloth, one, none, cloth] * 80) == [begin, (43, cloth)]
    assert one.value.lamp is none.value.lamp is cloth.value.lamp is Lamp.SLOW


def test_all_is_well_again_when_most_frames_are_good_though_others_come_between():
    """Of the 14 frames from 30 to 43 three of four are good, or half of them."""
    start = [Condition.ONE_MARKER] * 30
    mostly, equally = [Condition.GOOD] * 3 + [Condition.NO_GARMENT], [Condition.GOOD, Condition.NO_GARMENT]
    assert told([*start, *mostly * 30]) == [(0, Condition.ONE_MARKER), (43, Condition.GOOD)]
    assert told([*start, *equally * 60]) == [(0, Condition.ONE_MARKER), (43, Condition.NO_GARMENT)]


def test_a_lamp_changes_at_most_every_four_tenths_of_a_second():
    """Two minutes of conditions by lot, each for up to a second."""
    rng = np.random.default_rng(1)
    kinds = [Condition.GOOD, Condition.NO_DEPTH, Condition.ONE_MARKER, Condition.NO_MARKERS, Condition.NO_GARMENT]
    runs = zip(rng.integers(0, 5, 240), rng.integers(1, 32, 240), strict=True)
    said = told([kinds[kind] for kind, length in runs for _ in range(length)])
    assert len(said) > 50
    assert min(np.diff([number for number, _ in said])) >= 13


def test_every_bad_condition_says_what_to_do_and_shows_on_the_lamp():
    for condition in Condition:
        assert (condition.value.lamp is Lamp.STEADY) == (condition is Condition.GOOD)
        assert bool(condition.value.advice) == (condition is not Condition.GOOD)


def test_every_bit_has_a_name_and_a_line_in_the_specification():
    bits = {value for name, value in vars(FrameState).items() if not name.startswith("_")}
    assert bits == set(STATE_NAMES) == {1 << k for k in range(13)}
    text = (Path(__file__).parents[3] / "formats/SPEC.md").read_text()
    assert all(f"| {bit} |" in text for bit in bits)


def test_a_held_edge_that_is_nowhere_is_not_covered():
    """Gravity along the hanger leaves no direction in which the cloth hangs."""
    assert not is_garment_covered(np.full((480, 640), 500, np.uint16), np.full((2, 3), np.nan), CAMERA)
