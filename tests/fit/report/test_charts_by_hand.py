"""The charts' bars, maps, axes and packed motion, each place and width by hand."""

from __future__ import annotations

import base64
import math
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from fit.report.charts import (
    Curve,
    _hull,
    _ticks,
    axis_top,
    cloth_map,
    effect_bars,
    error_chart,
    force_map,
    gap_bars,
    where_bars,
)  # fmt: skip
from fit.report.motion import ReportMotion, Run, rms_of
from fit.report.packing import STRIDES, _meshes, _size, _without_meshes, pack, pack_motions
from fit.report.text import duration, instant, interval, number, percent, tenths, tenths_interval, unit_of
from formats.diagnosis_records import Figure, ForceAt, VertexResidual, WhereBin
from tests.fit.report.report_scene import diagnosis, motion
from tests.fit.report.test_shown_figures import GAP, parts_of, words_on

SQUARE = np.array([(-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4)])


def attributes(page, tag):
    """The attributes of each tag of this name."""
    return [dict(re.findall(r'([\w-]+)="([^"]*)"', found)) for found in re.findall(rf"<{tag}\b([^>]*)>", str(page))]


def test_bars_of_places_are_as_long_as_their_share_of_the_largest_error():
    bins = [WhereBin(name=n, value_mm=v, share=0.5) for n, v in (("top", 8.0), ("bottom", 2.0), ("none", math.nan))]
    assert parts_of(where_bars("Where", bins)) == [("plain", 0.0, 100.0), ("plain", 0.0, 25.0), ("plain", 0.0, 0.0)]
    assert str(where_bars("Where", [])) == ""


def test_an_effect_that_makes_it_worse_has_no_removed_part_and_one_without_closure_no_bar():
    """A closure of -0.5 leaves more than the base's 10 mm: the bar is full, and the figure says 12.2 mm."""
    one, other = diagnosis().effects[:2]
    worse = replace_closure(one, -0.5)
    assert parts_of(effect_bars(GAP, [worse], [])) == [("floor", 0.0, 20.0), ("rest", 20.0, 80.0)]
    assert f"{math.sqrt(100 + 0.5 * 96):.1f} mm" in words_on(effect_bars(GAP, [worse], []))
    assert parts_of(effect_bars(GAP, [replace_closure(one, 1.2)], []))[1] == ("gone", 20.0, 80.0)
    assert words_on(effect_bars(GAP, [worse, replace_closure(other, None)], ["air_drag"])).count("closed") == 1
    assert str(effect_bars(GAP, [replace_closure(one, None)], [])) == ""


def replace_closure(effect, value):
    return structs.replace(effect, closure=None if value is None else Figure(value=value, interval=None))


def test_a_gap_below_its_noise_or_without_an_effect_has_no_removed_part():
    below = structs.replace(GAP, base_mm=Figure(value=1.5, interval=None), with_effect_mm=None, held_by_edge_mm=None)
    kinds = [(kind, begin) for kind, begin, _ in parts_of(gap_bars(below, "hem"))]
    assert kinds == [("floor", 0.0), ("floor", 0.0), ("whisker", pytest.approx(1.7 / 1.04 / 2.4 * 100, abs=0.01))]
    assert "removed by" not in words_on(gap_bars(below, "hem"))
    worse = structs.replace(GAP, with_effect_mm=Figure(value=12.0, interval=None))
    assert "gone" not in {kind for kind, _, _ in parts_of(gap_bars(worse, "hem"))}


def test_a_map_of_force_has_discs_and_bars_to_one_scale_inside_its_box():
    """Of two places on 0.4 m: a reach of 0.08 x 0.4 m for the largest, 2 m/s^2, and 1.6 reaches of margin."""
    places = [ForceAt(at_m=(0.1, -0.1), normal=1.0, in_plane=0.5), ForceAt(at_m=(-0.1, -0.3), normal=0.25, in_plane=2)]
    page = force_map(places, SQUARE)
    discs, bars, (svg,) = attributes(page, "circle"), attributes(page, "line"), attributes(page, "svg")
    assert [float(disc["r"]) for disc in discs] == pytest.approx([0.016, 0.004])
    ends = [[float(bar[key]) for key in ("x1", "x2", "y1", "y2")] for bar in bars]
    assert np.array(ends) == pytest.approx(np.array([[0.092, 0.108, 0.1, 0.1], [-0.132, -0.068, 0.3, 0.3]]))
    assert float(bars[0]["stroke-width"]) == pytest.approx(0.032 / 6, abs=1e-4)
    assert [float(one) for one in svg["viewBox"].split()] == pytest.approx([-0.2512, -0.0512, 0.5024, 0.5024], abs=1e-4)
    assert "0.25 m/s² along the normal, 2.00 m/s² in the plane" in page
    assert "The largest is 2 m/s²" in page
    many = [ForceAt(at_m=(0.01 * k, -0.1), normal=2.0, in_plane=0.0) for k in range(100)]
    assert float(attributes(force_map(many, SQUARE), "circle")[0]["r"]) == pytest.approx(0.4 * 0.055)
    assert str(force_map(places[:1], SQUARE)) == ""


def test_spots_of_errors_have_labels_beside_them_while_they_are_few():
    """Of 12 places a spot is 0.06 x 0.4 m, labelled 1.4 spots to the right and 0.45 up; of 13 no place is."""
    for count in (12, 13):
        vertices = [VertexResidual(at_m=(0.03 * k - 0.18, -0.2), value_mm=1.0 + k) for k in range(count)]
        page = cloth_map(vertices, SQUARE)
        spots, labels, (svg,) = attributes(page, "circle"), attributes(page, "text"), attributes(page, "svg")
        assert len(spots) == count
        assert {float(spot["r"]) for spot in spots} == {0.024}
        wide = 0.4 + 3 * 0.024 + (7 * 0.024 if count == 12 else 0.0)
        assert [float(one) for one in svg["viewBox"].split()] == pytest.approx([-0.236, -0.036, wide, 0.472], abs=1e-4)
        assert len(labels) == (count if count == 12 else 0)
        assert words_on(page).endswith(f"1.0 mm {count}.0 mm")
        if labels:
            first = labels[0]
            assert [float(first[key]) for key in ("x", "y", "font-size")] == pytest.approx(
                [-0.18 + 1.4 * 0.024, 0.2 - 0.45 * 0.024, 0.03], abs=1e-4
            )
    unknown = [VertexResidual(at_m=(0.0, -0.1), value_mm=math.nan), VertexResidual(at_m=(math.nan, 0.0), value_mm=1.0)]
    assert str(cloth_map(unknown, SQUARE)) == ""
    hundred = [VertexResidual(at_m=(0.001 * k, -0.2), value_mm=1.0) for k in range(100)]
    (share,) = {re.search(r"(\d+)%", spot["style"])[1] for spot in attributes(cloth_map(hundred, SQUARE), "circle")}
    assert share == "0"  # of equal errors none is large
    assert attributes(cloth_map(hundred, SQUARE), "circle")[0]["r"] == "0.0200"


def test_the_hull_of_points_holds_their_corners_once_and_no_point_within_or_between():
    places = np.array([(0, 0), (2, 0), (1, 0), (2, 2), (1, 1), (0, 2), (0, 0), (0, 1), (1.5, 0.5)], float)
    assert _hull(places) == [(0, 0), (2, 0), (2, 2), (0, 2)]


@pytest.mark.parametrize(
    ("largest", "top", "steps"),
    [(8.0, 8.0, 4), (8.1, 10.0, 4), (9.0, 10.0, 4), (0.0, 1.0, 2), (math.nan, 1.0, 2)],
)
def test_an_axis_ends_at_a_round_step_above_the_largest_value(largest, top, steps):
    assert axis_top(largest) == (pytest.approx(top), steps)


@pytest.mark.parametrize(
    ("start", "end", "ticks"),
    [(0, 6, [0, 1, 2, 3, 4, 5, 6]), (0, 7, [0, 2, 4, 6]), (9.9, 12.1, [10, 10.5, 11, 11.5, 12]),
     (0, 0.6, [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), (0, 35, [0, 10, 20, 30])],
)  # fmt: skip
def test_an_axis_of_time_has_seven_round_ticks_at_most(start, end, ticks):
    assert _ticks(start, end) == pytest.approx(ticks)


def test_a_chart_draws_each_run_in_its_style_with_its_largest_error_and_a_gap_where_nothing_was_seen():
    time = np.linspace(0.0, 4.0, 5)
    first = Curve("before", np.array([4.0, 8.0, np.nan, 8.0, 4.0]) * 1e-3, np.full(5, 0.016), "before the fit")
    second = Curve("fit", np.full(5, 0.002), None, "the fit", ("rms", 0.002))
    page = error_chart("take", time, [first, second, Curve("after", np.full(5, np.nan))], motion=3)
    top, _ = axis_top(16.0)
    at = {value: f"{100 * (1 - value / top):.2f}" for value in (2.0, 4.0, 8.0, 16.0)}
    lines = {path["class"]: path["d"] for path in attributes(page, "path")}
    assert lines == {
        "largest is-before": "".join(f"{'L' if k else 'M'}{25 * k:.2f} {at[16.0]}" for k in range(5)),
        "is-before": f"M0.00 {at[4.0]}L25.00 {at[8.0]}M75.00 {at[8.0]}L100.00 {at[4.0]}",
        "is-fit": "".join(f"{'L' if k else 'M'}{25 * k:.2f} {at[2.0]}" for k in range(5)),
        "mean is-fit": f"M0 {at[2.0]}H100",
    }
    assert re.findall(r'<li class="([^"]*)" style="--swatch:([^"]*)">([^<]*)<', str(page)) == [
        ("is-line", "var(--before)", "before the fit"),
        ("is-line is-dotted", "var(--fit)", "the fit: rms 2.0\u00a0mm, worst frame 2.0\u00a0mm"),
    ]
    assert 'data-motion="3" data-start="0.0000" data-end="4.0000"' in str(page)
    assert "data-motion" not in str(error_chart("take", time, [second]))
    assert str(error_chart("take", time[:1], [second])) == ""
    assert str(error_chart("take", time, [])) == ""


def test_numbers_change_to_powers_of_ten_below_a_thousandth_and_from_a_million_on():
    shown = [number(value) for value in (0.001, 0.000999, 0.00001, 999_999.0, 1e6, -0.5, 1000.0, 0.1)]
    assert shown == ["0.001", "9.99 × 10⁻⁴", "1 × 10⁻⁵", "999999", "1 × 10⁶", "−0.5", "1000", "0.1"]
    assert number(1.23456, 2) == "1.2"
    assert number(math.inf) == "–"
    assert [tenths(value) for value in (-1.25, None, math.nan)] == ["−1.2 mm", "–", "–"]
    assert tenths(2.0, "%") == "2.0 %"
    assert tenths_interval((1.0, 2.55), "m") == "1.0 to 2.5 m"
    assert tenths_interval((1.0, math.nan)) == tenths_interval(None) == interval(None) == ""
    assert interval((0.1, 0.25), 100, 2) == "10 to 25"
    assert (percent(None), percent(math.nan)) == ("–", "–")
    assert (str(unit_of("1")), str(unit_of("")), str(unit_of("m"))) == ("", "", "&#8239;m")
    assert (duration(89.9), duration(90.0), duration(math.inf)) == ("89.9 s", "1.5 min", "–")
    assert instant("2026-03-01T12:00:00") == "2026-03-01T12:00:00"  # of no known zone


def unpacked(packed, frames):
    """The positions behind a packed track, by the format that the module describes."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), np.uint8)
    low, high = np.split(planes.astype(np.int32), 2)
    zigzag = low + 256 * high
    change = np.where(zigzag & 1, -(zigzag >> 1) - 1, zigzag >> 1).reshape(frames, -1)
    whole = np.cumsum(change, axis=0).astype(np.int64)
    whole = ((whole + 2**15) % 2**16 - 2**15).reshape(frames, packed["count"], 3)
    return np.where(whole == -32768, np.nan, whole * packed["step"] + np.array(packed["centre"]))


def test_packed_positions_come_back_to_half_a_step_and_unseen_ones_as_nothing():
    """An outlier of 10 m is cut at 32767 steps of 0.1 mm from the median, and moves no other point."""
    rng = np.random.default_rng(0)
    track = rng.normal(0, 0.3, (9, 4, 3)) + np.array([1.0, 2.0, 3.0])
    track[3, 1], track[4, 2] = np.nan, [11.0, 2.0, 3.0]
    packed = pack(track, 1e-4)
    found = unpacked(packed, 9)
    rest = np.ones((9, 4), bool)
    rest[3, 1] = rest[4, 2] = False
    assert np.abs(found - track)[rest].max() <= 0.5e-4 + 1e-9
    assert np.isnan(found[3, 1]).all()
    assert found[4, 2, 0] == pytest.approx(packed["centre"][0] + 3.2767)
    known = track[np.isfinite(track).all(-1)]
    assert packed["centre"] == pytest.approx(np.round(np.median(known, axis=0), 3))
    third = pack(track, 1e-3, 4)
    assert (third["every"], third["step"], third["count"]) == (4, 1e-3, 4)
    assert unpacked(third, 3) == pytest.approx(track[::4], abs=0.5e-3 + 1e-9, nan_ok=True)
    assert pack(None, 1e-4) is None
    assert pack(np.full((2, 1, 3), np.nan), 1e-4)["centre"] == [0.0, 0.0, 0.0]


def test_meshes_get_fewer_frames_then_leave_the_last_takes_then_whole_takes_go():
    made = [motion(f"take-{k}", seconds=2.0) for k in range(3)]
    whole, note = pack_motions(made, 10**9)
    assert note == ""
    assert {mesh["every"] for one in whole for mesh in one["meshes"].values()} == {1}

    full = sum(len(mesh["data"]) for one in whole for mesh in one["meshes"].values())
    fewer, note = pack_motions(made, int(0.75 * full))
    assert note == ""
    (every,) = {mesh["every"] for one in fewer for mesh in one["meshes"].values()}
    assert every in STRIDES[1:-1]
    assert all(all(one["meshes"].values()) for one in fewer)
    points, coarse = _size(_without_meshes(made[0])), _size(_meshes(made[0], STRIDES[-1]))
    first, note = pack_motions(made, int(3 * points + 1.5 * coarse))
    assert note == "The cloth between the points is shown for the first takes only."
    assert [all(one["meshes"].values()) for one in first] == [True, False, False]
    assert [bool(one["triangles"]) for one in first] == [True, False, False]
    some, note = pack_motions(made, int(1.5 * points))
    assert [one["take_id"] for one in some] == ["take-0"]
    assert note == (
        "2 of 3 takes are left out here to keep this file small. "
        "The cloth between the points is shown for the first takes only."
    )
    assert pack_motions(made, 0) == ([], "3 of 3 takes are left out here to keep this file small.")


def test_the_worst_frame_is_one_in_which_half_of_the_points_or_more_are_seen():
    """Of four points: a frame with two of them counts, one with a single point does not, however far off it is."""
    real = np.zeros((4, 4, 3))
    real[1, 1:], real[2, 2:] = np.nan, np.nan
    off = np.zeros((4, 4, 3))
    off[:, :, 0] = np.array([0.01, 0.09, 0.03, 0.02])[:, None]
    made = ReportMotion(
        take_id="a", is_held_out=False, time=np.arange(4.0), real=real, point_names=tuple("abcd"),
        runs={"before": Run(points=off)},
    )  # fmt: skip
    assert made.worst_frame == 2
    assert made.rms("before") == pytest.approx([0.01, 0.09, 0.03, 0.02])
    assert rms_of([made], "after") is None
    assert rms_of([made], "before") == pytest.approx(np.sqrt((4 * 0.01**2 + 0.09**2 + 2 * 0.03**2 + 4 * 0.02**2) / 11))
    assert replace(made, runs={}).worst_frame == 0
    assert replace(made, real=np.full((4, 4, 3), np.nan)).worst_frame == 0


def test_points_beside_the_cloth_are_compared_without_their_mean_offset_over_the_frames_in_which_they_count():
    """5 mm off in two frames, and 8 mm in a third: 6 mm of it is no error; points that are held do not count."""
    real = np.zeros((4, 2, 3))
    real[3, 0] = np.nan
    points = np.zeros((4, 2, 3))
    points[:3, 0, 1] = [0.005, 0.005, 0.008]
    made = ReportMotion(
        take_id="a", is_held_out=False, time=np.arange(4.0), real=real, point_names=("a", "b"),
        runs={"after": Run(points=points)}, free=np.array([True, False]), is_material=False,
    )  # fmt: skip
    assert made.offset("after")[0] == pytest.approx([0, -0.006, 0])
    assert made.errors("after")[:, 0] == pytest.approx([0.001, 0.001, 0.002, np.nan], nan_ok=True)
    assert np.isnan(made.errors("after")[:, 1]).all()
    assert made.compared("after")[0, 0] == pytest.approx([0, -0.001, 0])
