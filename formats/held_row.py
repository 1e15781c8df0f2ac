"""Judge whether the hanger holds the cloth: the tracked held row must follow the hanger's path.

The middle y of the points on the held edge, at times t_f, is compared with the middle m of the held ends:

    r_f = y_f - m(t_f + d) - mean,   explained = 1 - sum_f |r_f|^2 / sum_f |y_f - mean|^2

A hanger may have its own clock, so d is the clock offset that explains most. Frames farther off than three times the
median are left out. `fit.recordings.timing` applies the same rule along the hanger's axes.
On sixteen real takes their own path explains 0.91 to 0.99, with a residual of 13 to 27 mm.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats
from formats.findings import FEWEST_SEEN, Finding, ends_of
from formats.sights import LARGEST_SHIFT, MOST_SHIFTED, Sights, on_held_edge, shifts_of, spread
from formats.take import Take
from formats.two_clocks import at_times

LEAST_EXPLAINED = 0.7  # of the squared motion: held rows have 0.87 to 0.99, silhouettes of the sensor 0.91 to 0.99
# Times the median distance. Our choice: normal noise exceeds it in 1e-4 of the frames. At half in 15 %, which would
# leave out sound frames; double was not tried.
OUTLIER = 3.0
HALF_SWING = 0.5  # s, half a swing, in which errors are correlated
FEWEST_BLOCKS = 5  # half swings: a shorter motion fits many paths
MOST_APART = 0.04  # m, root mean square distance of row and path: 13 to 27 mm on sixteen real takes


def held_row_findings(take: Take, sights: Sights) -> list[Finding]:
    """Return the finding on a held row that does not follow the hanger; none where it does, or was not seen."""
    on_edge = on_held_edge(take.garment)
    if not on_edge.any():
        return []
    frames = spread(np.flatnonzero(sights.is_known & take.points_valid[:, on_edge].all(1)), MOST_SHIFTED)
    row = take.points[frames][:, on_edge].mean(1)
    shifts = shifts_of(take)
    ends = [at_times(take.time[frames] + shift, take.time[sights.held], take.held[sights.held]) for shift in shifts]
    explained, apart = max(_compared(row, both.mean(1)) for both in ends)
    if explained >= LEAST_EXPLAINED or apart <= MOST_APART:
        return []
    within = f", at no shift of its clock within {LARGEST_SHIFT:g} s" if len(shifts) > 1 else ""
    words = f"the cloth's held row does not go with the {ends_of(take)}{within}: both are {1e3 * apart:.0f} mm apart"
    advice = "check that hanger and points are of one take, and that the hanger holds the garment"
    return [Finding(name="row_apart", words=words, advice=advice)]


def _compared(row: Floats, middle: Floats) -> tuple[float, float]:
    """Return the share of a row's squared motion that a path explains, and their root mean square distance [m].

    row, middle [m], (frames, 3); NaN outside the path
    """
    there = np.isfinite(middle).all(1)
    if there.sum() < FEWEST_SEEN:
        return -np.inf, 0.0
    row, off = row[there], row[there] - middle[there]
    away = np.linalg.norm(off - np.median(off, axis=0), axis=1)
    kept = away <= OUTLIER * np.median(away)
    left, motion = float(off[kept].var(0).sum()), float(row[kept].var(0).sum())
    return 1.0 - left / max(motion, 1e-12), float(np.sqrt(left))
