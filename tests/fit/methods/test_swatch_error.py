"""The error E of the motion capture method against numbers worked by hand."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from fit.errors import FitError
from fit.methods.distance import total
from fit.methods.swatch_error import SwatchError, _weights, curvature_seen, line_curvature, marker_grid
from fit.recordings.recording import prepare
from formats.swatch import swatch
from tests.fit.scenes import sheet, take_of

GARMENT = swatch(0.05)
TIME = np.arange(240) / 120


def hanging(time=TIME):
    """Markers of a swatch that hangs flat and still, (frames, 81, 3), z up."""
    flat = np.array([[p.at_m[0], 0.0, p.at_m[1]] for p in GARMENT.points])
    return np.broadcast_to(flat, (len(time), 81, 3)).copy()


def error_against(points):
    return SwatchError(prepare(take_of(GARMENT, TIME, np.zeros((len(TIME), 3)), points)))


def test_catmull_rom_curvature_of_a_circle_by_hand():
    """Markers 30 degrees apart on a radius of 0.2 m: (5 + 1/2 - 6 cos 30) / (1/4) = 1.2154 over the radius."""
    angle = np.radians(30) * np.arange(6)
    circle = 0.2 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    curvature = line_curvature(circle)
    assert curvature[2:4] == pytest.approx(1.21539 / 0.2, rel=1e-5)
    assert curvature[[0, 5]] == pytest.approx(0.0)


def test_catmull_rom_curvature_of_a_parabola_is_exact():
    """y = x^2 at x = -1 .. 2: p'' = 2 at both inner knots; at x = 0 kappa = 2, at x = 1 kappa = 2 / 5^1.5 = 0.1789."""
    x = np.array([-1.0, 0.0, 1.0, 2.0])
    assert line_curvature(np.stack([x, x**2, 0 * x], 1)) == pytest.approx([0.0, 2.0, 2 / 5**1.5, 0.0])


def test_a_swatch_10_mm_aside_costs_alpha_times_10_mm():
    terms = error_against(hanging()).terms(hanging()[None] + [0.0, 0.01, 0.0])
    assert terms[0] == pytest.approx([0.01, 0.0, 0.0, 0.0], abs=1e-9)


def test_a_swatch_that_moves_steadily_costs_half_its_speed_and_its_mean_position():
    """0.2 m/s for 2 s: 0.5 x 0.2 for the speed, and the mean position is half way, 0.2 m x 239/240 off."""
    moving = hanging() + 0.2 * TIME[:, None, None] * np.array([0.0, 1.0, 0.0])
    terms = error_against(hanging()).terms(moving[None])
    assert terms[0] == pytest.approx([0.2 * 239 / 240, 0.1, 0.0, 0.0], rel=1e-6, abs=1e-9)


def test_a_swatch_rolled_about_the_vertical_costs_curvature_across_only():
    """Radius 0.5 m, markers 0.125 rad apart: (5 + cos 0.25 - 6 cos 0.125) / sin^2 0.125 = 1.01181 over the radius.

    Two of the nine markers of a row are its ends and have none: 2 x 1.01181 / 0.5 x 7/9 = 3.1479.
    """
    flat = hanging()
    angle = flat[..., 0] / 0.5
    rolled = np.stack([0.5 * np.sin(angle), 0.5 * (1 - np.cos(angle)), flat[..., 2]], -1)
    terms = error_against(flat).terms(rolled[None])[0]
    assert terms[3] == pytest.approx(2 * 1.01181 / 0.5 * 7 / 9, rel=1e-4)
    assert terms[2] == pytest.approx(0.0, abs=1e-6)


def test_curvature_down_the_columns_is_its_own_part():
    flat = hanging()
    angle = flat[..., 2] / 0.5
    rolled = np.stack([flat[..., 0], 0.5 * (1 - np.cos(angle)), 0.5 * np.sin(angle)], -1)
    terms = error_against(flat).terms(rolled[None])[0]
    assert terms[2] == pytest.approx(2 * 1.01181 / 0.5 * 7 / 9, rel=1e-4)
    assert terms[3] == pytest.approx(0.0, abs=1e-6)


def rolled(radius, axis):
    """The swatch at rest, rolled about the vertical (0, across) or about a level line (2, down)."""
    flat = hanging()
    angle = flat[..., axis] / radius
    along, out = radius * np.sin(angle), radius * (1 - np.cos(angle))
    return np.stack([along, out, flat[..., 2]] if axis == 0 else [flat[..., 0], out, along], -1)


@pytest.mark.parametrize(("axis", "part"), [(0, 3), (2, 2)])
def test_curvatures_of_both_sides_are_subtracted(axis, part):
    """Radii of 0.5 and 0.4 m, with factors of 1.01181 and of 1.0185 (0.15625 rad): 0.5226 1/m, twice, at 7 of 9."""
    terms = error_against(rolled(0.5, axis)).terms(rolled(0.4, axis)[None])[0]
    angle = 0.0625 / 0.4
    factor = (5 + np.cos(2 * angle) - 6 * np.cos(angle)) / np.sin(angle) ** 2
    assert terms[part] == pytest.approx(2 * (factor / 0.4 - 1.01181 / 0.5) * 7 / 9, rel=1e-3)


def test_speeds_of_both_sides_are_subtracted():
    """0.2 m/s measured and 0.5 m/s simulated: half of 0.3."""
    steady = TIME[:, None, None] * np.array([0.0, 1.0, 0.0])
    terms = error_against(hanging() + 0.2 * steady).terms((hanging() + 0.5 * steady)[None])[0]
    assert terms[1] == pytest.approx(0.15, rel=1e-3)


def test_a_marker_that_counts_in_one_frame_alone_counts_with_all_its_weight():
    assert _weights(np.array([[True, True, False], [False, True, False]])).tolist() == [
        [1.0, 0.5, 0.0],
        [0.0, 0.5, 0.0],
    ]


def test_a_frame_without_a_marker_counts_for_neither_side():
    """A marker is lost while the simulated one is elsewhere: no error from those frames."""
    seen = hanging()
    seen[100:130, 40] = np.nan
    simulated = hanging()
    simulated[105:125, 40, 1] += 0.5
    with_gap = error_against(seen).terms(simulated[None])[0]
    without = error_against(hanging()).terms(simulated[None])[0]
    assert with_gap[0] < 0.05 * without[0]


def test_a_markers_speed_is_the_mean_of_the_frames_in_which_it_was_seen():
    """0.2 m/s in frames 0 to 119 of 240 and then still, lost from frame 100 on: 0.2 m/s, and not half of this."""
    seen = hanging()
    seen[100:, 40] = np.nan
    simulated = hanging()
    simulated[:, 40, 1] += 0.2 * np.minimum(TIME, TIME[120])
    assert error_against(seen).terms(simulated[None])[0][1] == pytest.approx(0.5 * 0.2 / 81, rel=1e-3)


def test_a_lost_marker_bends_no_line_that_it_is_a_point_of():
    """A flat swatch that swings; where one marker is lost for a second, its bridged position is far off the plane."""
    swung = hanging()
    swung[..., 1] += 0.1 * np.sin(2 * np.pi * 0.9 * TIME)[:, None]
    seen = swung.copy()
    seen[60:180, 40] = np.nan
    terms = error_against(seen).terms(swung[None])[0]
    assert terms[2:] == pytest.approx([0.0, 0.0], abs=0.02)  # what the ends of the marker's own spline leave


@pytest.mark.parametrize(("axis", "part", "left"), [(2, 2, 63 - 4), (0, 3, 63 - 5)])
def test_a_lost_marker_leaves_out_the_curvatures_of_its_own_column_and_row(axis, part, left):
    """Row 2, column 4 is lost in the half in which the simulated swatch bends: rows 1 to 4 or columns 2 to 6 of it."""
    grid = marker_grid(np.array([p.at_m for p in GARMENT.points]), "here")
    seen, simulated = hanging(), hanging()
    seen[120:, grid[2, 4]] = np.nan
    simulated[120:] = rolled(0.4, axis)[120:]
    with_gap, without = (error_against(real).terms(simulated[None])[0] for real in (seen, hanging()))
    assert with_gap[part] / without[part] == pytest.approx(left / 63, abs=0.004)


def test_a_curvature_needs_the_markers_of_both_segments():
    seen = np.ones(8, bool)
    seen[4] = False
    assert curvature_seen(seen).tolist() == [True, True, False, False, False, False, False, True]
    ends = np.ones(8, bool)
    ends[0] = False  # a point of the first segment, so of the curvature at 1 and 2
    assert curvature_seen(ends).tolist() == [False, False, False, True, True, True, True, True]


def test_noise_that_looks_like_more_than_half_of_the_curvature_is_remarked():
    """3 mm at 62.5 mm: sqrt(87) x 3 mm x 0.29 / 62.5^2 mm^2 = 2.1 1/m; 0.29^2 = 0.833 x 6 Hz / 60 Hz passes the filter.

    The mean of such noise is sqrt(pi) / 2 of its root mean square: 1.9 1/m are measured.
    """
    generator = np.random.default_rng(0)
    noisy = hanging() + 3e-3 * generator.standard_normal((240, 81, 3))
    path = np.zeros((240, 3))
    remark = SwatchError(prepare(take_of(GARMENT, TIME, path, noisy, sd=3e-3))).remark
    assert remark.startswith("Warning: scene: the stated noise of its points alone looks like a curvature of 2.1 1/m")
    assert ", 1.9 1/m were measured" in remark
    long = SwatchError(prepare(take_of(GARMENT, TIME, path, noisy, sd=3e-3, name="n" * 3000))).remark
    assert long.startswith(f"Warning: {60 * 'n'} ... {60 * 'n'}: the stated noise")
    angle = hanging()[..., 0] / 0.3
    rolled = np.stack([0.3 * np.sin(angle), 0.3 * (1 - np.cos(angle)), hanging()[..., 2]], -1)
    assert SwatchError(prepare(take_of(GARMENT, TIME, path, rolled, sd=2e-4))).remark == ""


@pytest.mark.parametrize(("stated", "is_said"), [(1.2e-3, False), (1.6e-3, True)])
def test_noise_is_remarked_from_half_of_the_measured_curvature(stated, is_said):
    """As above 3 mm look like 2.1 1/m and 1.9 are measured: stated 1.2 mm like 0.84, or 0.44; 1.6 mm like 0.59."""
    noisy = hanging() + 3e-3 * np.random.default_rng(0).standard_normal((240, 81, 3))
    remark = SwatchError(prepare(take_of(GARMENT, TIME, np.zeros((240, 3)), noisy, sd=stated))).remark
    assert bool(remark) is is_said


def test_the_remark_compares_the_noise_with_the_mean_curvature_of_the_inner_markers():
    """Bent in two directions, each side otherwise, so that every row and column has a curvature of its own."""
    bent = hanging()
    bent[..., 1] = 0.4 * bent[..., 0] ** 3 / 0.25**2 + 0.9 * (bent[..., 2] + 0.5) ** 3
    grid = marker_grid(np.array([p.at_m for p in GARMENT.points]), "here")
    sheet_of = bent[0][grid]
    across = np.array([line_curvature(row)[1:8] for row in sheet_of])[1:8]
    down = np.array([line_curvature(column)[1:8] for column in sheet_of.swapaxes(0, 1)])[1:8]
    measured = (across.mean() + down.mean()) / 2
    remark = SwatchError(prepare(take_of(GARMENT, TIME, np.zeros((240, 3)), bent, sd=0.02))).remark
    said = re.fullmatch(
        r"Warning: scene: the stated noise of its points alone looks like a curvature of ([\d.]+) 1/m, "
        r"([\d.]+) 1/m were measured: E fits noise here\. Use a method that minimises D \(si, kinect-skirt\)\.",
        remark,
    )
    assert said is not None
    # sqrt(87) x 20 mm x 0.29 / 62.5^2 mm^2; the ends of a take pass a little less than its middle.
    assert float(said[1]) == pytest.approx(np.sqrt(87) * 0.02 * 0.29 / 0.0625**2, rel=0.04)
    assert float(said[2]) == pytest.approx(measured, abs=0.05)


def test_a_simulation_that_blew_up_is_infinitely_wrong():
    assert total(error_against(hanging()), np.full((1, 240, 81, 3), np.nan))[0] == np.inf


def test_the_grid_is_found_whatever_the_order_of_the_points():
    order = np.random.default_rng(3).permutation(81)
    grid = marker_grid(np.array([p.at_m for p in GARMENT.points])[order], "here")
    assert (order[grid] == np.arange(81).reshape(9, 9)).all()


def test_points_that_are_no_full_grid_are_refused():
    with pytest.raises(FitError, match="5 points are not a full grid"):
        marker_grid(np.array([p.at_m for p in sheet().points]), "here")
    three, four = (np.stack(np.meshgrid(np.arange(n), np.arange(4)), -1).reshape(-1, 2) / 10 for n in (3, 4))
    assert marker_grid(four, "here").shape == (4, 4)
    with pytest.raises(FitError, match="12 points are not a full grid of 4 x 4 markers or more"):
        marker_grid(three, "here")
    doubled = four.copy()
    doubled[5] = doubled[6]  # still 4 rows, 4 columns and 16 points
    with pytest.raises(FitError, match="here: its 16 points are not a full grid"):
        marker_grid(doubled, "here")
    with pytest.raises(FitError, match="scene: its 5 points are not a full grid"):
        SwatchError(prepare(take_of(sheet(), TIME, np.zeros((240, 3)), hanging()[:, :5])))


def test_fewer_than_100_frames_are_refused():
    take = take_of(GARMENT, TIME[:99], np.zeros((99, 3)), hanging()[:99])
    with pytest.raises(FitError, match="99 frames, mocap-swatch needs 100"):
        SwatchError(prepare(take))
    enough = SwatchError(prepare(take_of(GARMENT, TIME[:100], np.zeros((100, 3)), hanging()[:100])))
    assert enough.terms(hanging()[None, :100])[0] == pytest.approx(np.zeros(4), abs=1e-9)


@pytest.mark.parametrize("seen", [0, 5])
def test_a_marker_that_was_hardly_ever_seen_is_named(seen):
    recording = prepare(take_of(GARMENT, TIME, np.zeros((240, 3)), hanging()))
    valid = recording.valid.copy()
    valid[seen:, 7] = False
    with pytest.raises(FitError, match=f"'row1_column8' was seen in {seen} frames, at least 8"):
        SwatchError(dataclasses.replace(recording, valid=valid))


def test_a_point_whose_place_on_the_cloth_is_beyond_the_silhouette_is_not_called_unseen():
    recording = prepare(take_of(GARMENT, TIME, np.zeros((240, 3)), hanging()))
    valid = recording.valid.copy()
    valid[:, 7] = False
    placed = dataclasses.replace(recording, valid=valid, camera=dataclasses.replace(recording.camera, is_placed=True))
    with pytest.raises(FitError) as refused:
        SwatchError(placed)
    assert "the material position of 'row1_column8' lies within the silhouette in 0 frames" in str(refused.value)
    assert "--method si, or leave the marker's whole row or column out" in str(refused.value)


def test_a_marker_that_was_seen_in_eight_frames_counts():
    recording = prepare(take_of(GARMENT, TIME, np.zeros((240, 3)), hanging()))
    valid = recording.valid.copy()
    valid[8:, 7] = False
    aside = hanging()[None] + [0.0, 0.01, 0.0]
    assert SwatchError(dataclasses.replace(recording, valid=valid)).terms(aside)[0][0] == pytest.approx(0.01, rel=1e-3)


def test_the_lowest_inner_row_counts_as_much_as_the_others_in_the_measured_curvature():
    """A swatch that is flat but for its last two rows, which bend: only the last inner row has a curvature down."""
    bent = hanging()
    grid = marker_grid(np.array([p.at_m for p in GARMENT.points]), "here")
    bent[:, grid[8], 1] += 0.03
    down = np.array([line_curvature(column)[1:8] for column in bent[0][grid].swapaxes(0, 1)])[1:8]
    remark = SwatchError(prepare(take_of(GARMENT, TIME, np.zeros((240, 3)), bent, sd=0.02))).remark
    said = re.search(r", ([\d.]+) 1/m were measured", remark)
    assert float(said[1]) == pytest.approx(down.mean() / 2, abs=0.051)
    assert down[:, -1].mean() / 14 > 0.2
