"""Simulation of the cloth held at its tracked edge, instead of the edge that the hanger's path gives.

A straight held edge has the ends e_0 and e_1. A point at the share f of the way lies at (1 - f) e_0 + f e_1. Least
squares over the tracked points of the edge give the ends of each frame,

    min_e  sum_p |y_p - (1 - f_p) e_0 - f_p e_1|^2,

A path through the ends is smoothed like the hanger's own (`fit.recordings.recording`), with the cut-off for its noise.
This path drives a model whose fabric is fitted again. The model is then free of every error between hanger and edge, in
the library or not. The error that remains lies in the cloth, the air or the points. The path names no cause: effects
are identified by their laws.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from fit.errors import DriveError
from fit.gap.checkpoint import Checkpoint
from fit.gap.evidence import Evidence
from fit.gap.fitting import Fitted, Task, fit
from fit.gap.hypotheses import Hypothesis, judged
from fit.observer.residuals import Observer
from fit.recordings.hanger_path import check_path
from fit.recordings.held_edge import place_along
from fit.recordings.recording import Recording
from fit.recordings.smoothing import best_cut_off
from formats.take import LONGEST_GAP

# Of the determinant with all edge points: least value of the points seen in a frame that counts. Our choice: an end is
# then at most sqrt(10) times as uncertain as with all points. Half and double were not tried.
LEAST_SPREAD = 0.1


def held_by_edge(observer: Observer, judge: Observer, base: Fitted, kept: Checkpoint) -> Hypothesis | None:
    """Fit and judge the base model held by its tracked edge; return None if the edge gives no path.

    observer, judge: of the takes fitted to and judged on; base: the fit that is begun from
    """
    driven, tested_on = _all_driven(observer.recordings), _all_driven(judge.recordings)
    if driven is None or tested_on is None:
        return None
    there, tested = observer.of(driven), observer.of(tested_on)
    starts = (base.vector, observer.parameterisation.initial)
    tasks = [Task(vector, observer.off) for vector in starts]
    found = kept.recall([f"held-by-edge-{k}" for k in range(len(tasks))], partial(fit, there, tasks))
    best = min(found, key=lambda one: one.cost)
    return judged(tested, [best])[0]


def sentence(evidence: Evidence, found: Hypothesis | None) -> str:
    """Return a sentence on the gap that remains when the tracked edge holds the cloth, or nothing if unknown."""
    closed = evidence.closure_of(found) if found is not None else None
    if found is None or closed is None or closed.interval is None:
        return ""
    left = f" Held where its edge was tracked, it misses by {evidence.error_of(found).value:.1f} mm"
    low, high = closed.interval
    if low <= 0.0:
        return f"{left}: the gap does not lie between hanger and edge."
    share = f"{100 * closed.value:.0f} % of the gap [{100 * low:.0f} to {100 * high:.0f} %]"
    return f"{left}: {share} lies between hanger and edge."


def _all_driven(recordings: list[Recording]) -> list[Recording] | None:
    driven = [found for recording in recordings if (found := driven_by_edge(recording)) is not None]
    return driven if len(driven) == len(recordings) else None


def driven_by_edge(recording: Recording) -> Recording | None:
    """Return a recording whose held ends follow its tracked edge; None if too little of the edge was seen."""
    on_edge = np.flatnonzero(~recording.judged)
    if recording.garment.held != "edge" or len(on_edge) < 2:
        return None
    places = np.array([recording.garment.points[k].at_m for k in on_edge])
    share, _ = place_along(places, np.array(recording.garment.outline_m[:2]))
    design = np.stack([1 - share, share], 1)
    weight = recording.valid[:, on_edge].astype(float)
    normal = np.einsum("fp,pa,pb->fab", weight, design, design)
    seen = np.linalg.det(normal) > LEAST_SPREAD * np.linalg.det(design.T @ design)
    measured = np.nan_to_num(recording.points[seen][:, on_edge])
    ends = np.linalg.solve(normal[seen], np.einsum("fp,pa,fpx->fax", weight[seen], design, measured)).reshape(-1, 6)
    try:
        check_path(recording.take_id, recording.begin + recording.time[seen], ends)
    except DriveError:
        return None
    first, last = recording.time[seen][[0, -1]]
    if max(first, recording.duration - last) > LONGEST_GAP:
        return None
    every = np.full((len(recording.time), 6), np.nan)
    every[seen] = ends
    return replace(recording, held_cut_off=best_cut_off(recording.time[seen], ends)).with_held(every, recording.time)
