"""Findings on a camera's faults from made-up values, and robust lines by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import t as student

from fit.recordings import camera_findings as module
from fit.recordings import point_kind
from fit.recordings.camera_findings import _together, camera_clause, describe_camera, foreign_clock
from fit.recordings.point_kind import common_change, neighbours
from fit.recordings.robust_line import interval_of, robust_line, seconds_apart
from formats.fit_records import CameraFinding
from formats.held_row import LEAST_EXPLAINED

EMPTY = {
    "timing": None, "is_retimed": False, "skewed": 0, "frames": 100, "edge": None, "offsets": None,
    "is_placed": False, "outline": None, "lean": None,
}  # fmt: skip


def timing(**changes):
    given = {
        "is_of_hanger": True, "explained": 0.9, "latency": 0.0, "latency_interval": (-0.01, 0.01), "share": None,
        "share_interval": None, "deviation": 0.0, "scale": 0.0, "scale_interval": None,
    }  # fmt: skip
    return SimpleNamespace(**(given | changes))


def recording(name="a", *, gaps=(), begin=0.0, **camera):
    return SimpleNamespace(
        take_id=name,
        gaps=list(gaps),
        begin=begin,
        camera=SimpleNamespace(**(EMPTY | camera)),
        garment=None,
        point_sd=np.zeros(4),
    )


@pytest.fixture(autouse=True)
def no_kind(monkeypatch):
    """Say nothing of the kind of points unless a test does."""
    for name in ("describe_contradiction", "describe_steady"):
        monkeypatch.setattr(module, name, lambda garment, recordings: "")


def found(*recordings):
    return describe_camera(list(recordings))


def test_a_camera_without_faults_has_no_findings():
    assert found(recording(), recording("b", timing=timing())) == []
    assert camera_clause([]) == ""


def test_gaps_of_the_hanger_are_named_take_by_take():
    one, two = found(
        recording(gaps=[(1.0, 1.5)]), recording("b"), recording("c", gaps=[(3.0, 3.2), (2.0, 2.75)], begin=0.5)
    )
    assert (one.name, one.take_ids, one.figure, one.unit) == ("hanger_gap", ["a"], 0.5, "s")
    assert one.sentence.startswith("In a the hanger's path is lost once, up to 0.50 s, first at 1.00 s. ")
    assert (two.take_ids, two.figure) == (["c"], 0.75)
    assert two.sentence.startswith("In c the hanger's path is lost 2 times, up to 0.75 s, first at 2.50 s. ")


def test_long_names_of_takes_are_shown_in_part(monkeypatch):
    name, part = "n" * 3000, f"{60 * 'n'} ... {60 * 'n'}"
    lost = recording(name, gaps=[(1.0, 1.5)], timing=timing(is_of_hanger=False, explained=-0.4))
    told = [one.sentence for one in found(lost)]
    assert [(name in sentence, part in sentence) for sentence in told] == 2 * [(False, True)]
    assert told[1].count(part) == 2
    monkeypatch.setattr(point_kind, "kind_shown", lambda recording: ("silhouette", 0.05))
    garment, take = SimpleNamespace(point_kind="material", points_are=None), SimpleNamespace(take_id=name)
    take.is_imported = True
    assert f"in the take {part} the" in point_kind.describe_contradiction(garment, [take])


def test_a_foreign_clock_is_a_fault_reported_for_the_take_that_explains_least_and_ends_what_follows():
    lost = [recording(n, timing=timing(is_of_hanger=False, explained=e), skewed=0, lean=leaning(0.1))
            for n, e in (("a", 0.66), ("b", 0.64))]  # fmt: skip
    clock = foreign_clock(lost)
    assert (clock.name, clock.take_ids, clock.figure, clock.is_fault) == ("clocks", ["a", "b"], 0.64, True)
    assert "hanger's in 2 takes. " in clock.sentence
    told = f"does the hanger's path explain {100 * LEAST_EXPLAINED:.0f} % of the held row's motion (best: 64 %). "
    assert f". In b at no shift within 0.5 s {told}Check that path" in clock.sentence
    alone = foreign_clock([recording("c", timing=timing(is_of_hanger=False, explained=-0.4)), recording("d")])
    assert "hanger's in c. " in alone.sentence
    assert "motion (best: 0 %)" in alone.sentence
    assert foreign_clock([recording(), recording("b", timing=timing())]) is None
    assert [one.name for one in found(*lost)] == ["clocks"]
    assert [one.name for one in found(lost[0], recording("e", lean=leaning(0.1)))] == ["clocks", "lean"]


def leaning(angle, half=0.01):
    return SimpleNamespace(angle=angle, interval=(angle - half, angle + half))


def late(seconds, half=0.01, *, is_retimed=True, name="a", **more):
    own = timing(latency=seconds, latency_interval=(seconds - half, seconds + half), **more)
    return recording(name, timing=own, is_retimed=is_retimed)


def test_a_latency_that_was_taken_out_is_reported_with_its_interval_and_in_the_clause():
    (one,) = found(late(0.05))
    assert (one.name, one.figure, one.unit, one.is_left) == ("latency", pytest.approx(0.05), "s", False)
    assert one.interval == pytest.approx((0.04, 0.06))
    assert "are 0.050 s late [0.040 to 0.060 s] in a" in one.sentence
    assert "are 0.050 s early" in found(late(-0.05))[0].sentence
    assert found(late(0.005)) == []
    clause = camera_clause([one])
    assert clause == " Corrected before anything was fitted: stamps 0.050 s late [0.040 to 0.060 s]."


@pytest.mark.parametrize(
    ("seconds", "half", "is_told"), [(0.021, 0.01, True), (0.019, 0.01, False), (0.03, 0.04, False)]
)
def test_a_latency_that_was_left_in_is_reported_from_twenty_milliseconds_on(seconds, half, is_told):
    told = found(late(seconds, half, is_retimed=False))
    assert [one.name for one in told] == ["latency"] * is_told
    assert all(one.is_left and camera_clause([one]) == "" for one in told)


def test_stamps_of_publishing_and_shifts_of_frames_are_reported_for_what_was_retimed():
    one, two = late(0.0, share=0.8, share_interval=(0.7, 0.9), deviation=0.03), late(0.0, deviation=0.04, name="b")
    publish, shifts = found(one, two)
    assert (publish.name, publish.take_ids, publish.figure) == ("publish_time", ["a"], pytest.approx(0.8))
    assert "0.80 [0.70 to 0.90]" in publish.sentence
    assert (shifts.name, shifts.take_ids, shifts.is_left) == ("frame_shifts", ["a", "b"], True)
    assert shifts.figure == pytest.approx(np.sqrt((0.03**2 + 0.04**2) / 2))
    assert "by another 35 ms rms" in shifts.sentence
    assert found(late(0.0, is_retimed=False, share=0.8, share_interval=(0.7, 0.9), deviation=0.03)) == []
    assert found(late(0.0, share=0.1, share_interval=(-0.1, 0.3))) == []
    assert "late by 0.80 of the excess of the frame interval" in camera_clause([publish])


def test_skewed_grids_are_reported_as_a_share_of_all_frames():
    (one,) = found(recording(skewed=10), recording("b"), recording("c", skewed=5, frames=300))
    assert (one.name, one.take_ids, one.figure) == ("skewed_grids", ["a", "c"], pytest.approx(15 / 500))
    assert one.sentence.startswith("15 of 500 grids (3 %) lie askew")
    assert "3 % skewed grids" in camera_clause([one])


@pytest.mark.parametrize(
    ("down", "out", "words"),
    [(0.004, -0.003, "4 mm lower and 3 mm further in"), (-0.004, 0.003, "4 mm higher and 3 mm further out"),
     (0.001, 0.001, None), (0.0, 0.0021, "0 mm lower and 2 mm further out")],
)  # fmt: skip
def test_a_held_edge_is_reported_where_it_was_moved_to(down, out, words):
    """The mean of two takes of 0.5 and 1.5 times it."""
    edges = [SimpleNamespace(down=k * down, out=k * out) for k in (0.5, 1.5)]
    told = found(*(recording(n, edge=e) for n, e in zip("ab", edges, strict=True)), recording("c"))
    assert len(told) == (words is not None)
    for one in told:
        assert words in one.sentence
        assert (one.figure, one.take_ids) == (pytest.approx(np.hypot(down, out)), ["a", "b"])


def test_offsets_of_frames_are_a_root_mean_square_over_takes():
    (one,) = found(*(recording(n, offsets=SimpleNamespace(rms=r)) for n, r in (("a", 0.003), ("b", 0.009))))
    assert (one.name, one.unit, one.figure) == ("frame_offsets", "m", pytest.approx(np.sqrt(45e-6)))
    assert "by 7 mm rms" in one.sentence


def test_points_slide_by_what_is_beyond_their_noise():
    """Moved by 5 mm, of which noise along two directions of 1.5 mm each; half of them seen."""
    one = recording(is_placed=True)
    one.seen_points = np.zeros((10, 4, 3))
    one.points = one.seen_points + np.array([0.003, 0.0, 0.004])
    one.points[::2] = np.nan
    one.valid, one.point_sd = np.isfinite(one.points).all(2), np.full(4, 0.0015)
    (told,) = found(one)
    assert told.figure == pytest.approx(np.sqrt(25e-6 - 2 * 2.25e-6))
    assert "by 5 mm rms" in told.sentence
    assert "50 % of these positions" in told.sentence
    one.point_sd = np.full(4, 0.003)
    assert found(one) == []  # 2.6 mm
    one.points[:] = np.nan
    assert found(one) == []


def outline(bottom=0.01, side=0.004, by_pose=None, half=0.001):
    span = None if by_pose is None else (by_pose - half, by_pose + half)
    return SimpleNamespace(
        bottom=bottom, bottom_interval=(bottom - half, bottom + half), side=side,
        side_interval=(side - half, side + half), by_pose=by_pose, by_pose_interval=span,
    )  # fmt: skip


def test_an_eroded_border_is_the_mean_of_its_three_sides():
    (one,) = found(recording(outline=outline()))
    assert one.figure == pytest.approx(0.006)
    assert one.interval == pytest.approx((0.006 - np.hypot(1, 2) / 3e3, 0.006 + np.hypot(1, 2) / 3e3))
    assert "by 10.0 mm [9.0 to 11.0] at the bottom and 4.0 mm [3.0 to 5.0] at each side" in one.sentence
    assert found(recording(outline=outline(0.002, 0.0019))) == []
    assert found(recording(outline=outline(half=0.01))) == []
    assert "a border eroded by 6.0 mm, the mean of its three sides" in camera_clause([one])


@pytest.mark.parametrize(("by_pose", "words"), [(0.03, "loses 30 mm"), (-0.03, "gains 30 mm"), (0.009, None)])
def test_an_outline_that_depends_on_pose_is_reported_with_its_sign(by_pose, words):
    told = found(recording(outline=outline(0.0, 0.0, by_pose, 0.002)), recording("b", outline=outline(0.0, 0.0)))
    assert len(told) == (words is not None)
    for one in told:
        assert one.take_ids == ["a"]
        assert f"the silhouette {words} per unit of lean [28 to 32]" in one.sentence
        assert "by 30 mm per unit of lean" in camera_clause([one])
    assert found(recording(outline=outline(0.0, 0.0, 0.03, 0.04))) == []


@pytest.mark.parametrize(("scale", "words"), [(0.02, "2.0 % [1.5 to 2.5] farther"), (-0.02, "less far"), (0.002, None)])
def test_a_scale_of_depth_is_reported_and_left_in(scale, words):
    half = 0.005 if words else 0.001
    told = found(recording(timing=timing(scale=scale, scale_interval=(scale - half, scale + half))), recording("b"))
    assert len(told) == (words is not None)
    for one in told:
        assert words in one.sentence
        assert (one.name, one.is_left, one.take_ids) == ("depth_scale", True, ["a"])


@pytest.mark.parametrize(("angle", "half", "is_told"), [(0.02, 0.01, True), (-0.02, 0.01, True), (0.02, 0.03, False),
                                                       (0.0049, 0.001, False)])  # fmt: skip
def test_a_tilt_at_rest_is_reported_in_degrees(angle, half, is_told):
    told = found(recording(lean=leaning(angle, half)))
    assert len(told) == is_told
    for one in told:
        low, middle, high = np.degrees([angle - half, angle, angle + half])
        assert f"by {middle:.1f} degrees [{low:.1f} to {high:.1f}]" in one.sentence
        assert (one.unit, one.is_left) == ("rad", True)


def test_the_kind_of_points_is_a_fault_where_it_contradicts_and_a_hint_where_it_is_steady(monkeypatch):
    monkeypatch.setattr(module, "describe_contradiction", lambda garment, recordings: "They slide.")
    monkeypatch.setattr(module, "describe_steady", lambda garment, recordings: "They stay.")
    fault, hint = found(recording(), recording("b"))
    assert (fault.sentence, fault.is_fault, fault.take_ids) == ("They slide.", True, ["a", "b"])
    assert (hint.sentence, hint.is_fault) == ("They stay.", False)
    assert camera_clause([fault, hint]) == " They slide."
    assert camera_clause([fault, hint], "No diagnosis: They slide. 3 mm.") == ""


def test_every_finding_has_its_unit_its_takes_and_its_interval(monkeypatch):
    monkeypatch.setattr(module, "describe_steady", lambda garment, recordings: "They stay.")
    shown = timing(
        latency=0.05, latency_interval=(0.04, 0.06), share=0.8, share_interval=(0.7, 0.9), deviation=0.03,
        scale=0.02, scale_interval=(0.015, 0.025),
    )  # fmt: skip
    one = recording(
        gaps=[(1.0, 1.5)], timing=shown, is_retimed=True, skewed=10, edge=SimpleNamespace(down=0.003, out=0.004),
        offsets=SimpleNamespace(rms=0.007), is_placed=True, outline=outline(by_pose=0.03, half=0.002),
        lean=leaning(0.02),
    )  # fmt: skip
    one.seen_points, one.points = np.zeros((2, 4, 3)), np.full((2, 4, 3), 0.01)
    one.valid = np.ones((2, 4), bool)
    border = 0.002 * np.hypot(1, 2) / 3
    expected = [
        ("hanger_gap", "s", False, None), ("latency", "s", False, (0.04, 0.06)),
        ("publish_time", "1", False, (0.7, 0.9)), ("frame_shifts", "s", True, None),
        ("skewed_grids", "1", False, None), ("held_edge", "m", False, None), ("frame_offsets", "m", False, None),
        ("sliding_points", "m", False, None), ("eaten_border", "m", False, (0.006 - border, 0.006 + border)),
        ("eaten_by_pose", "m", False, (0.028, 0.032)), ("depth_scale", "1", True, (0.015, 0.025)),
        ("lean", "rad", True, (0.01, 0.03)), ("points_are", "1", False, None),
    ]  # fmt: skip
    told = found(one)
    assert [(f.name, f.unit, f.is_left) for f in told] == [given[:3] for given in expected]
    for one, (*_, interval) in zip(told, expected, strict=True):
        assert one.interval == (interval and pytest.approx(interval)), one.name
        assert (one.take_ids, one.is_fault) == (["a"], False)
    left, other = late(0.03, is_retimed=False), recording("b", timing=timing(is_of_hanger=False, explained=0.2))
    assert [(f.name, f.unit, f.is_left, f.take_ids) for f in found(left, other)[:2]] == [
        ("clocks", "1", False, ["b"]), ("latency", "s", True, ["a"]),
    ]  # fmt: skip


def test_what_was_left_or_has_no_figure_is_not_in_the_clause():
    given = {"name": "frame_offsets", "take_ids": ["a"], "unit": "m", "sentence": "."}
    assert camera_clause([CameraFinding(**given, figure=None), CameraFinding(**given, figure=0.1, is_left=True)]) == ""
    two = [CameraFinding(**given, figure=0.1), CameraFinding(**(given | {"name": "held_edge"}), figure=0.02)]
    words = "whole frames that are off by 100 mm rms; a held edge 20 mm from where the path has it"
    assert camera_clause(two) == f" Corrected before anything was fitted: {words}."


def test_figures_of_takes_go_together_by_their_certainty():
    """One keeps its interval; of two that are as certain the larger of both kinds of spread counts."""
    assert _together([]) == (0.0, (0.0, 0.0))
    assert _together([(2.0, (1.0, 3.0))]) == (2.0, (1.0, 3.0))
    mean, (low, high) = _together([(2.0, (1.0, 3.0)), (2.0, (1.0, 3.0))])
    assert (mean, low, high) == pytest.approx((2.0, 2 - np.sqrt(0.5), 2 + np.sqrt(0.5)))
    mean, (low, high) = _together([(1.0, (0.99, 1.01)), (3.0, (2.99, 3.01))])
    # The mean's deviation is half the difference, 1, with one degree of freedom.
    assert mean == pytest.approx(2.0)
    assert (high - low) / 2 == pytest.approx(student.ppf(0.95, 1) * np.sqrt(2) / np.sqrt(2))
    # Halves of 2, 2 and 6 weigh 1/8, 1/8 and 1/40: the median's square is added to each.
    mean, _ = _together([(0.0, (-2.0, 2.0)), (0.0, (-2.0, 2.0)), (11.0, (5.0, 17.0))])
    assert mean == pytest.approx(1.0)


def test_a_line_and_its_interval_are_those_of_least_squares_where_nothing_is_far_off():
    """Values of which none is outlying: the coefficients are least squares', the interval a jackknife over blocks."""
    time = np.arange(60) * 0.1 + 3.0
    block = seconds_apart(time + 1e-9)
    assert block.tolist() == [k // 5 for k in range(60)]
    design = np.column_stack([np.ones(60), time])
    values = design @ [1.0, -2.0] + 0.01 * np.tile([1.0, -0.9, 0.9, -1.0], 15)
    found_line, half = robust_line(design, values, block)
    assert found_line == pytest.approx(np.linalg.lstsq(design, values, rcond=None)[0], abs=1e-9)
    without = np.stack([np.linalg.lstsq(design[block != b], values[block != b], rcond=None)[0] for b in range(12)])
    sd = np.sqrt(11 / 12 * ((without - without.mean(0)) ** 2).sum(0))
    assert half == pytest.approx(student.ppf(0.95, 11) * sd, rel=1e-6)
    assert interval_of(2.0, 0.5) == (1.5, 2.5)


def test_frames_far_off_pull_a_line_by_their_share_only():
    values = np.zeros(100)
    values[::10] = 1e6
    (middle,), _ = robust_line(np.ones((100, 1)), values + 1e-3 * np.sin(np.arange(100)), np.arange(100) // 5)
    assert abs(middle) < 1e-3


def grid():
    x, y = np.meshgrid(np.arange(6) * 0.1, -np.arange(6) * 0.1)
    return np.column_stack([x.ravel(), y.ravel()])


def test_neighbours_are_the_nearest_ahead_along_an_axis():
    pairs, flat = neighbours(grid(), 0)
    assert pairs.tolist() == [[k, k + 1] for k in range(36) if k % 6 < 5]
    assert flat == pytest.approx(np.full(30, 0.1))
    assert neighbours(grid(), 1)[0].tolist() == [[k, k - 6] for k in range(6, 36)]
    far = np.array([[0.0, 0.0], [0.3, 0.0], [1.0, 0.0]])
    assert neighbours(far, 0)[0].tolist() == []  # a quarter of the extent at most
    askew = grid() @ np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
    assert len(neighbours(askew, 0)[0]) == 0  # 23 degrees


def test_a_common_change_is_the_spread_of_the_median_length_less_the_noise_in_it():
    """A sheet that stretches by 2 % along x in every second frame: half of it by the median absolute deviation."""
    places, frames = grid(), 40
    still = np.column_stack([places, np.zeros(36)])
    points = np.repeat(still[None], frames, axis=0)
    points[::2, :, 0] *= 1.02
    valid = np.ones((frames, 36), bool)
    assert common_change(points, valid, places, 0.0) == pytest.approx(1.4826 * 0.01)
    noise = np.pi * 0.003**2 / (0.1**2 * 30)
    assert common_change(points, valid, places, 0.003) == pytest.approx(np.sqrt((1.4826 * 0.01) ** 2 - noise))
    assert common_change(points, valid, places, 0.1) == 0.0
    assert common_change(points[:19], valid[:19], places, 0.0) is None
    assert common_change(points[:20], valid[:20], places, 0.0) is not None
    few = valid.copy()
    few[:, 12:] = False  # eleven pairs and fewer are left
    assert common_change(points, few, places, 0.0) is None
    assert common_change(points[:, :9], valid[:, :9], places[:9], 0.0) is None
