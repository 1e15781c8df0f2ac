"""The error of a held row and the lean of cloth at rest, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fit.recordings.grids import grid_of
from fit.recordings.row_and_rest import find_lean, row_off
from tests.fit.recordings.silhouettes import silhouette_sheet

SHEET = silhouette_sheet()
GRID = grid_of(SHEET)


def hanging(out, angle=0.0):
    """Frames of a flat sheet [m], its points and held ends, so far out, (frames,) [m], and leaning [rad]."""
    places = np.array([p.at_m for p in SHEET.points])
    points = np.stack([places[:, 0], -places[:, 1] * np.sin(angle), places[:, 1] * np.cos(angle)], 1)
    points = points + np.asarray(out, float)[:, None, None] * [0.0, 1.0, 0.0]
    ends = np.concatenate([np.append(corner, 0.0)[[0, 2, 1]] for corner in np.asarray(SHEET.outline_m[:2], float)])
    return points, np.tile(ends, (len(points), 1))


@pytest.mark.parametrize(("last", "counts"), [(9.9, True), (10.1, False), (np.nan, False)])
def test_the_row_is_off_by_the_rms_about_its_middle_without_frames_five_times_as_far(last, counts):
    """About 4 mm lie -3 to 3 mm, 2 in the median: up to 10 mm counts. A row that is not seen does not count."""
    away = np.array([-3.0, -1.0, -2.0, 0.0, 1.0, 2.0, last]) * 1e-3
    points, ends = hanging(0.004 + away)
    if np.isnan(last):  # the median of six is half a millimetre lower
        away = away + 0.0005
    assert row_off(points, ends, GRID) == pytest.approx(np.sqrt((away[: 6 + counts] ** 2).mean()))


def test_a_row_that_is_never_seen_is_off_by_nothing_known():
    points, ends = hanging(np.zeros(5))
    points[:, GRID.at[0]] = np.nan
    assert row_off(points, ends, GRID) == 0.0


@pytest.mark.parametrize("degrees", [5.0, -5.0])
def test_a_tilt_is_that_of_the_sheet_where_three_half_seconds_show_it(degrees):
    """Along z x bar, which is y."""
    points, ends = hanging(np.zeros(6), np.radians(degrees))
    half_seconds = np.array([0.1, 0.3, 0.6, 0.8, 1.1, 1.3])
    lean = find_lean(half_seconds, points, ends, GRID)
    assert lean.angle == pytest.approx(np.radians(degrees))
    assert lean.interval == pytest.approx((lean.angle, lean.angle))
    assert find_lean(half_seconds[:4], points[:4], ends[:4], GRID) is None
    points[:2] = np.nan
    assert find_lean(half_seconds, points, ends, GRID) is None
    assert find_lean(half_seconds, np.full(points.shape, np.nan), ends, GRID) is None
