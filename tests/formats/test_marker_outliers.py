"""A position that jumps away from its marker's trajectory and back counts as not seen; motion of cloth is unchanged."""

from __future__ import annotations

import numpy as np
import pytest

from formats.errors import ImplausibleError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_outliers import remove_jumps
from formats.importers.path_outliers import are_jumps, refuse_jumps
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_broken_numbers import WRITERS, imported, places, vicon

AT = 60
ONE = "{}: {} jumps {} m away and back, so it counts as not seen there"


def swing(frames=120, rate=100.0, markers=2):
    """Times [s] and positions [m] of markers that swing with 0.3 m at 1 Hz, with 0.3 mm of noise."""
    time = np.arange(frames) / rate
    phase = np.arange(3 * markers).reshape(markers, 3)
    noise = np.random.default_rng(0).normal(0, 3e-4, (frames, markers, 3))
    return time, 0.3 * np.sin(2 * np.pi * time[:, None, None] + phase) + 1.0 + noise


def jumps(time, where):
    """Return the sentence, and the frames and markers that were taken out."""
    left = where.copy()
    told = remove_jumps(time, left, ["a", "b"], "frame {}".format)
    return told, np.argwhere(np.isnan(left).all(2) & ~np.isnan(where).all(2)).tolist()


@pytest.mark.parametrize(("far", "shown"), [(0.1, "0.1"), (2.0, "2"), (888.0, "888"), (-41.5, "42")])
def test_a_position_that_jumps_for_one_frame_is_taken_out_and_reported(far, shown):
    time, where = swing()
    where[AT, 1, 2] += far
    assert jumps(time, where) == (ONE.format("frame 60", "b", shown), [[AT, 1]])


def test_two_positions_one_after_the_other_and_two_with_a_good_one_between_jump():
    time, where = swing()
    where[[AT, AT + 1, 80, 82], 0, 0] += 2
    told, gone = jumps(time, where)
    named = "a in frame 60 by 2 m, a in frame 61 by 2 m, a in frame 80 by 2 m and 1 more"
    assert told == f"4 positions jump away from their paths and count as not seen: {named}"
    assert gone == [[AT, 0], [AT + 1, 0], [80, 0], [82, 0]]


@pytest.mark.parametrize("far", [0.2, -900.0])
@pytest.mark.parametrize("frames", [[0], [1], [0, 1], [0, 2], [119], [118], [118, 119], [0, 60, 119]])
def test_positions_at_the_ends_of_a_path_that_jump_are_taken_out(frames, far):
    time, where = swing()
    where[30:50, 1] = np.nan
    where[frames, 1, 0] += far
    told, gone = jumps(time, where)
    assert gone == [[frame, 1] for frame in frames]
    each = [f"b in frame {frame} by " for frame in frames]
    assert all(one in told for one in each) or told.startswith(f"frame {frames[0]}: b jumps ")


def test_a_position_at_an_end_does_not_come_back_and_is_reported_without_that():
    time, where = swing()
    where[0, 1] += 5
    assert jumps(time, where)[0] == "frame 0: b jumps 8.7 m away, so it counts as not seen there"


def test_an_end_jumps_by_twice_as_much_as_the_marker_does_elsewhere():
    """A step of 0.4 m that stays is 0.4 m off the line ahead: 0.8 m and 65 mm is the bound."""
    time = np.arange(120) / 100
    for off, is_reported in ((0.86, False), (0.87, True)):
        where = np.ones((120, 1, 3))
        where[AT:, 0, 0] += 0.4
        where[119, 0, 0] += off
        assert bool(jumps(time, where)[1]) == is_reported


@pytest.mark.parametrize("begin", [3, 4, 5, 6])
def test_steps_that_stay_near_an_end_and_ends_far_from_the_next_positions_are_read(begin):
    """Another marker until then; or one that was seen for two frames, a second before the others, 0.9 m away."""
    time, where = swing()
    for changed in (slice(begin), slice(-begin, None)):
        stepped = where.copy()
        stepped[changed, 0] += 0.5
        assert jumps(time, stepped) == ("", [])
    where[2:90, 0] = np.nan
    where[:2, 0] += 0.5
    assert jumps(time, where) == ("", [])


@pytest.mark.parametrize("rate", [5, 20, 60, 100, 240, 1000])
def test_noise_hard_swings_gaps_impacts_and_steps_that_stay_are_no_jumps(rate):
    time, where = swing(rate=float(rate))
    where[30:37, 0] = np.nan
    where[AT:, 1] += 0.5  # another marker from there on
    where[:, 0] += np.random.default_rng(1).normal(0, 3e-3, where[:, 0].shape)
    held = np.ones_like(where)
    held[:, 1, 2] += 0.5 * 150 * np.minimum(np.maximum(time - time[AT], 0), 0.04) ** 2  # the hardest pull begins
    spike = np.ones_like(where)
    spike[AT] += 0.025
    for motion in (where, held, spike):
        assert jumps(time, motion) == ("", [])


def test_the_jump_that_is_found_grows_with_the_step_of_time():
    """At rest 50 mm and 150 m/s^2 / rate^2."""
    for rate, least in ((1000, 0.05015), (100, 0.065), (20, 0.425)):
        for times, is_reported in ((0.99, False), (1.01, True)):
            where = np.ones((120, 2, 3))
            where[AT, 0, 0] += times * least
            assert bool(jumps(np.arange(120) / rate, where)[1]) == is_reported


def test_a_marker_that_jumps_often_and_times_that_do_not_increase_are_left_to_other_checks():
    time, where = swing()
    where[10:100:12, 0] += 1
    assert jumps(time, where) == ("", [])
    where = swing()[1]
    where[AT] += 1
    assert jumps(time * 0, where) == ("", [])
    assert jumps(time[50:69], where[50:69]) == ("", [])
    assert jumps(time[50:70], where[50:70])[1] == [[10, 0], [10, 1]]
    where[:50, 0] = where[69:, 0] = np.nan
    assert jumps(time, where)[1] == [[AT, 1]]


def test_a_lost_point_in_a_text_is_reported_by_its_line_and_in_c3d_by_its_frame(tmp_path):
    """888.566 became 888566, and one z of metres was moved."""
    lines = vicon(WRITERS["%.3f"], places())
    cells = lines[AT].split(",")
    lines[AT] = ",".join([*cells[:4], cells[4].replace(".", ""), *cells[5:]])
    found = imported(tmp_path, lines)
    far = float(cells[4]) * 0.999
    assert found.warning == ONE.format("line 66", "a", f"{far:.0f}")
    assert np.argwhere(np.isnan(found.positions).any(2)).tolist() == [[AT, 0]]
    where = 1e3 * swing()[1]
    where[AT, 1, 0] += 400
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(where, ["a", "b"]))
    found = read_marker_tracks(tmp_path / "a.c3d")
    assert found.warning == ONE.format("frame 61", "b", "0.4")
    assert np.argwhere(np.isnan(found.positions).any(2)).tolist() == [[AT, 1]]


def test_a_line_without_a_markers_cells_gives_no_marker_the_next_ones_position(tmp_path):
    lines = vicon(WRITERS["%.3f"], places() + np.array([0, 0, 0, 500, 0, 0]))
    cells = lines[AT].split(",")
    lines[AT] = ",".join([*cells[:2], *cells[5:]])
    found = imported(tmp_path, lines)
    assert found.warning.startswith("line 66: a jumps 0.5 m away")
    assert np.isnan(found.positions[AT]).all()


def test_a_position_that_does_not_come_back_is_no_jump():
    """Rounded to 0.1 m, a path turns by steps: off its lines by 71, 141 and 100 mm, between positions 141 mm apart."""
    where = np.ones((120, 2, 3))
    where[AT:, 0] = [0.9, 0.9, 1.0]
    where[AT + 2 :, 0, 2] = 0.9
    assert jumps(np.arange(120) / 100, where) == ("", [])


def test_a_step_after_which_the_held_ends_stay_is_no_jump_away_and_back():
    """Half a metre off the line before and after it, and a metre between its neighbours."""
    time, ends = np.arange(40) / 100, np.zeros((40, 2, 3))
    ends[20:] = [1.0, 0.0, 0.0]
    refuse_jumps(time, ends, "a.npz", one="pose", advice="leave it out")
    ends[30, 0] = 0.0
    with pytest.raises(ImplausibleError, match=r"1 pose jumps .* first number 31 at 0\.30 s, by 1 m"):
        refuse_jumps(time, ends, "a.npz", one="pose", advice="leave it out")


def test_a_steady_path_does_not_jump_where_its_times_are_ten_times_farther_apart():
    """100 m/s throughout: 0.1 m in 1 ms, 1 m in 10 ms."""
    assert not are_jumps(np.array([0.0, 0.001, 0.011]), np.array([[0.0], [0.1], [1.1]])).any()
    assert are_jumps(np.array([0.0, 0.001, 0.011]), np.array([[0.0], [0.1], [1.2]])).all()
