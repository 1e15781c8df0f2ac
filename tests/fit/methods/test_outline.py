"""The distance of outlines: sliding along the edge is free, and leaving the edge counts."""

from __future__ import annotations

import dataclasses

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.identification.request import Plan
from fit.methods import outline
from fit.methods.outline import OutlineDistance, to_polygon
from fit.recordings.recording import prepare
from formats.garment import TrackedPoint
from tests.fit.scenes import hung, sheet, take_of

CORNERS_OF_4 = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.45), (-0.2, -0.45))  # of `sheet`
SQUARE = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])


def test_points_are_as_far_from_a_polygon_as_from_its_nearest_side_or_corner():
    points = np.array([[[0.5, -0.2], [1.3, 1.4], [0.5, 0.4], [1.0, 0.7]]])
    assert to_polygon(points, SQUARE) == pytest.approx(np.array([[0.2, 0.5, 0.4, 0.0]]))


@pytest.mark.parametrize("at_once", [1, 8, 2_000_000])
def test_every_frame_counts_however_many_fit_into_one_batch(at_once, monkeypatch):
    """One point a frame, 1 to 5 m beside a square that moves up with it: 4 distances a frame, two frames in 8."""
    monkeypatch.setattr(outline, "DISTANCES_AT_ONCE", at_once)
    up = np.arange(5)[:, None, None] * [0.0, 1.0]
    points = np.array([[[2.0, 0.5]]]) + up + np.arange(5)[:, None, None] * [1.0, 0.0]
    assert to_polygon(points, SQUARE + up)[:, 0] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0])


def test_a_polygon_is_closed_within_its_own_frame():
    """Squares that are 100 m apart; the points are half a metre beside the closing side, x = 0."""
    away = np.array([[[0.0, 0.0]], [[100.0, 0.0]], [[0.0, 100.0]]])
    points = np.array([[[-0.5, 0.5]]]) + away
    assert to_polygon(points, SQUARE + away)[:, 0] == pytest.approx([0.5, 0.5, 0.5])


@pytest.mark.parametrize(("at_once", "frames"), [(40, 2), (10, 1), (10_000, 6)])
def test_a_batch_holds_as_many_frames_as_its_limit_of_distances(at_once, frames, monkeypatch):
    """Six frames of five points and four sides: 20 distances a frame, and never less than a frame."""
    held, norm = [], np.linalg.norm
    monkeypatch.setattr(outline, "DISTANCES_AT_ONCE", at_once)
    monkeypatch.setattr(np.linalg, "norm", lambda ways, axis: held.append(ways.shape) or norm(ways, axis=axis))
    to_polygon(np.zeros((6, 5, 2)), np.repeat(SQUARE, 6, axis=0))
    assert held == 6 // frames * [(frames, 5, 4, 2)]


TIME = np.arange(0, 1, 1 / 30)


def recording_of(grid=5):
    garment = sheet(grid=grid)
    return prepare(take_of(garment, TIME, np.zeros((len(TIME), 3)), hung(garment, TIME)))


def outline_of(grid=5):
    return OutlineDistance(recording_of(grid)), hung(sheet(grid=grid), TIME)[None]


def test_only_the_sixteen_points_of_the_edge_count():
    """A 5 x 5 grid: the nine inner points may be anywhere, and depth does not count."""
    objective, points = outline_of()
    moved = points.copy()
    inner = [k for k in range(25) if 0 < k % 5 < 4 and 0 < k // 5 < 4]
    moved[:, :, inner] += 0.3
    moved[..., 1] += 0.2
    assert objective.terms(moved) == pytest.approx(0.0, abs=1e-9)
    assert objective.remark == ""


def test_a_cloth_that_hangs_lower_costs_its_hem_and_its_corners():
    """10 mm lower: seen sides are met but for the top row's 5 points and the hem's 5, and so the other way round.

    The top corners lie 10 mm above the simulated sides' ends, the hem's are on its sides; of 16 points 5 are 10 mm off
    each way, but for hem corners seen that lie on simulated sides: (5 + 3) / 16 and (3 + 5) / 16 of 10 mm.
    """
    objective, points = outline_of()
    lower = points - [0.0, 0.0, 0.01]
    assert objective.terms(lower) == pytest.approx(0.01 * 8 / 16, abs=1e-6)


@pytest.mark.parametrize("is_seen_lower", [False, True])
def test_both_ways_between_outlines_count_half(is_seen_lower):
    """The hem's middle point hangs lower by d, which is the pitch of the points.

    The point is d from the straight hem. The straight hem's middle is d / sqrt(2) from two sides at 45 degrees.
    """
    objective, points = outline_of()
    middle = 22  # of the last of five rows of five
    pitch = float(points[0, 0, 23, 0] - points[0, 0, 22, 0])
    lower = points.copy()
    lower[:, :, middle, 2] -= pitch
    if is_seen_lower:
        objective, lower = OutlineDistance(dataclasses.replace(recording_of(), points=lower[0])), points
    assert objective.terms(lower) == pytest.approx(0.5 * pitch / 16 * (1 + 1 / np.sqrt(2)), rel=1e-6)


def test_it_is_searched_for_without_residuals_of_points_and_needs_an_edge():
    assert Plan(method="si-outline").search == "cma-es"
    with pytest.raises(FitError, match="tracked points are on the garment's edge"):
        outline_of(grid=1)


def test_frames_in_which_a_point_of_the_edge_is_lost_are_left_out_and_all_others_count():
    """The swatch hangs 10 mm lower in the second half; a corner is lost in the first three frames of either."""
    recording, (_, points) = recording_of(), outline_of()
    seen, half = recording.points.copy(), len(TIME) // 2
    seen[:3, 0] = seen[half : half + 3, 0] = np.nan
    lower = points.copy()
    lower[:, half:, :, 2] -= 0.01
    objective = OutlineDistance(dataclasses.replace(recording, points=seen))
    assert objective.terms(lower) == pytest.approx(0.01 * 8 / 16 * (len(TIME) - half - 3) / (len(TIME) - 6), abs=1e-6)


@pytest.mark.parametrize(("places", "is_enough"), [(CORNERS_OF_4, True), (CORNERS_OF_4[:3], False), ((), False)])
def test_an_outline_needs_its_four_corners(places, is_enough):
    """The fifth point, in the middle, is on no edge."""
    points = [TrackedPoint(name=f"p{k}", at_m=place) for k, place in enumerate((*places, (0.0, -0.2)))]
    garment = msgspec.structs.replace(sheet(), points=tuple(points))
    recording = prepare(take_of(garment, TIME, np.zeros((len(TIME), 3)), hung(garment, TIME)))
    if is_enough:
        assert OutlineDistance(recording).terms(hung(garment, TIME)[None]) == pytest.approx(0.0, abs=1e-9)
        return
    with pytest.raises(FitError, match=f"scene: {len(places)} tracked points are on the garment's edge"):
        OutlineDistance(recording)
