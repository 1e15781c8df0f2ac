"""The cloth held at its tracked edge: the estimated path, and the gap between hanger and edge."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.effects import LIBRARY, find_effects
from fit.gap.diagnosis import diagnose
from fit.gap.edge_driven import driven_by_edge, sentence
from fit.gap.findings import LISTED_EFFECTS
from fit.recordings.recording import prepare
from fit.report import answer, charts
from tests.fit.gap.verdict_scene import evidence_of, hypothesis
from tests.fit.report.report_scene import diagnosis
from tests.fit.scenes import hung, material, sheet, simulate_take, swing, take_of

TIME = np.arange(0, 3, 1 / 30)


def astray(time):
    return np.stack([0.02 * np.sin(2 * time), 0.015 * np.cos(3.1 * time), -0.01 * np.sin(time + 1)], 1)


ASTRAY = astray(TIME)


def a_take(*, grid=5, change=lambda points: points, noise=0.0, time=TIME):
    """A flat sheet whose edge, with everything else, moves beside the hanger, its right end 5 mm higher."""
    garment, path = sheet(grid=grid), swing(time)
    share = np.array([p.at_m[0] for p in garment.points]) / np.ptp([x for x, _ in garment.outline_m])
    points = hung(garment, time) + (path + astray(time))[:, None]
    points[..., 2] += 0.005 * (share + 0.5)
    points = points + np.random.default_rng(0).normal(0, noise, points.shape) if noise else points
    return take_of(garment, time, path, change(points))


def test_the_held_ends_are_where_the_tracked_edge_says():
    recording = prepare(a_take(noise=0.001))
    driven = driven_by_edge(recording)
    apart = (driven.held(TIME) - recording.held(TIME)).reshape(-1, 2, 3)
    expected = np.stack([ASTRAY, ASTRAY + np.array([0.0, 0.0, 0.005])], 1)
    # Five points of 1 mm tell an end to 0.77 mm in a frame; the path is smooth.
    assert np.sqrt(((apart - expected) ** 2).mean()) < 0.0006
    assert driven.points is recording.points


def test_frames_that_show_too_little_of_the_edge_are_bridged():
    def hide(points):
        points[20:26, 1:5] = np.nan  # one point of the edge is left
        points[40:50, :5] = np.nan
        return points

    recording = prepare(a_take(change=hide))
    apart = (driven_by_edge(recording).held(TIME) - recording.held(TIME)).reshape(-1, 2, 3)[:, 0]
    assert np.abs(apart - ASTRAY).max() < 0.002


@pytest.mark.parametrize(("left", "is_bridged"), [((1, 2, 3), True), ((1, 3), False), ((1, 4), True)])
def test_a_frame_counts_from_a_tenth_of_what_the_whole_edge_tells_of_its_ends(left, is_bridged):
    """The sum of (s_j - s_i)^2 over pairs of points, 25 / 8 for five: 0.12 of it, 0.08 and 0.18 for 20 frames."""

    def hide(points):
        points[30:50, [k for k in range(5) if k not in left]] = np.nan
        return points

    assert (driven_by_edge(prepare(a_take(change=hide))) is not None) is is_bridged


@pytest.mark.parametrize("gone", [slice(30, 50), slice(10, 90), slice(0, 20), slice(70, 90)])
def test_an_edge_that_is_lost_for_long_gives_no_path(gone):
    def hide(points):
        points[gone, :5] = np.nan
        return points

    assert driven_by_edge(prepare(a_take(change=hide))) is None


@pytest.mark.parametrize(("frames", "is_bridged"), [(16, True), (17, False)])
@pytest.mark.parametrize("at_end", [True, False])
def test_the_path_goes_on_for_half_a_second_beyond_the_sights_of_the_edge(frames, is_bridged, at_end):
    """At 32 frames a second 16 are half a second."""

    def hide(points):
        points[slice(-frames, None) if at_end else slice(frames), :5] = np.nan
        return points

    driven = driven_by_edge(prepare(a_take(change=hide, time=np.arange(96) / 32)))
    assert (driven is not None) is is_bridged


def test_two_points_of_the_edge_give_its_ends_and_one_gives_no_path():
    recording = dataclasses.replace(prepare(a_take(grid=2)), judged=np.array([False, False, True, True]))
    apart = driven_by_edge(recording).held(TIME) - recording.held(TIME)
    assert np.abs(apart.reshape(-1, 2, 3)[:, 0] - ASTRAY).max() < 0.001
    assert driven_by_edge(dataclasses.replace(recording, judged=np.array([True, False, True, True]))) is None


def test_a_path_from_the_edge_is_on_the_clock_of_the_points_whatever_clock_the_hanger_had():
    recording = prepare(a_take())
    often = dataclasses.replace(recording, held_time=np.arange(0, 3, 1 / 60))
    driven = driven_by_edge(often)
    assert np.array_equal(driven.held_time, recording.time)
    assert np.array_equal(driven.held(TIME), driven_by_edge(recording).held(TIME))


def test_cloth_that_two_clips_hold_has_no_edge_to_be_driven_by():
    take = a_take()
    clipped = msgspec.structs.replace(take.garment, held="corners")
    assert driven_by_edge(prepare(dataclasses.replace(take, garment=clipped))) is None


def a_swung_take(name, astray, hz):
    """A take simulated by our own cloth, whose hanger's recorded path differs from the true path."""
    garment = sheet(grid=5)
    row = material(garment, velocity_damping=1.5, bending_stiffness=3e-5, shear_stiffness=40.0)
    true = swing(TIME, amplitude=0.05, hz=hz, stop=2.0)
    take = simulate_take(garment, TIME, true + astray, row, noise=0.0005, resolution=Resolution(spacing=0.1), name=name)
    return dataclasses.replace(take, held=take.held - astray[:, None])


@pytest.mark.slow
def test_a_hanger_stated_at_a_wrong_position_is_reported_as_such():
    takes = [a_swung_take(f"take{k}", ASTRAY * (1 - 2 * k), 0.7 + 0.3 * k) for k in range(2)]
    options = {"effects": find_effects(["hem", "air_drag"]), "resolution": Resolution(spacing=0.1)}
    shares = []
    found = diagnose(takes[:1], takes[1:], progress=lambda stage, share: shares.append(share), **options).diagnosis
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert found.verdict == "unknown"
    assert found.gap.base_mm.value > 10.0
    assert found.gap.held_by_edge_mm.value < 3.0
    assert found.gap.closure_held_by_edge.value > 0.95
    assert "of the gap [" in found.sentence
    assert "lies between hanger and edge. Not looked for, as asked: shear stiffness, " in found.sentence
    assert f" and {len(LIBRARY) - 2 - LISTED_EFFECTS} more." in found.sentence


@pytest.mark.parametrize(("left", "said"), [
    (7.0, "7.0 mm: 80 % of the gap [78 to 82 %] lies between hanger and edge."),
    (12.0, "12.0 mm: the gap does not lie between hanger and edge."),
])  # fmt: skip
def test_the_sentence_says_how_much_of_the_gap_lies_between_hanger_and_edge(left, said):
    """144 - 49 of 144 - 25 mm^2."""
    assert sentence(evidence_of({}), hypothesis((), left)) == f" Held where its edge was tracked, it misses by {said}"
    assert sentence(evidence_of({}), None) == ""
    assert sentence(evidence_of({}, base=5.0), hypothesis((), left)) == ""  # hardly a gap


def test_the_report_shows_the_figure_beside_the_gap():
    made_up = diagnosis()
    figure = msgspec.structs.replace(made_up.gap.base_mm, value=7.0)
    share = msgspec.structs.replace(made_up.gap.base_mm, value=0.8)
    gap = msgspec.structs.replace(made_up.gap, held_by_edge_mm=figure, closure_held_by_edge=share)
    assert "held where its edge was tracked" not in answer.verdict(None, made_up)
    page = answer.verdict(None, msgspec.structs.replace(made_up, gap=gap))
    assert "held where its edge was tracked" in page
    assert "7.0\N{NO-BREAK SPACE}mm" in page
    assert "80\N{NO-BREAK SPACE}% of the gap closed" in page
    assert "held by its tracked edge" not in charts.gap_bars(made_up.gap, "x")
    assert "held by its tracked edge</span>" in charts.gap_bars(gap, "x")
