"""Find markers whose labels are exchanged for some frames: each continues the path of another one.

The straight line through the last two positions of a path predicts the next one. So does the last position alone. Some
markers have exchanged labels if each position `z_j` is near another path's prediction, `p_i`, and far from its own two:

    PATH_LEAP |z_j - p_i|  <  |z_j - p_j|,    |z_j - p_j|  >  max(LEAST_LEAP, PATH_UNUSUAL q_j),    i = c(j)

`c` permutes these markers. All `p_i` are of one kind, lines or last positions. `q_j` is the median distance of the
marker's positions from their lines, so labels may be exchanged in one frame of seven. A marker that no three frames in
a row show has no `q_j`, and leaps nowhere. Markers that cross each other go on along their own lines, so honest
positions fulfil the first rule for no permutation.

Behind a gap, all markers are far from their predictions, and among many some are near another one's by chance. So
`q_j` and `LEAST_LEAP` grow with the gap, as constant acceleration leads away from a line. Where frames are lost that
the times do not show, all leap. So each of these markers is also `PATH_UNUSUAL` times as far from its own predictions
as the median of the others.

Noise may hide one end of an exchange. The honest positions beside the other end would then count as exchanged. So a
second search eases the rules for the markers that the first one finds.

Behind an exchange, the paths go on under the other labels until the next one. The name that a label's path has in most
frames counts as right. Positions under another name count as not seen.

Where several markers leap off their lines in nearly all frames, they have no paths, and no exchange is told.
Labels that are exchanged throughout the file leap nowhere, and those that are exchanged while a marker is hidden leap
unseen. `marker_neighbours` compares them with the garment.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats, Integers, Singles
from formats.importers.number_cells import CELL_SHOWN
from formats.plain_text import MOST_LISTED, first_few

PATH_LEAP = 3.0  # times; our choice: no false exchange in 4 real C3D recordings and 3600 drawn motions
LEAST_LEAP = 0.005  # m; our choice: markers of cloth have diameters of 6 mm or more, and their centres are as far apart
PATH_UNUSUAL = 3.0  # times the median; our choice: 8 finds no exchange in motion of 120 m/s^2 at 30 frames a second
# Times, for markers whose labels are exchanged elsewhere in the file. Our choice: at 1 noise of 3 mm hides one return
# in five, and at 2 none of 120 that were drawn.
EASE = 2.0
FEWEST_FRAMES = 5  # our choice: fewer do not show the usual distance
LED_OVER = 12  # frames that a prediction spans; our choice: cloth turns within more at 100 frames a second
PATH_FRAMES_AT_ONCE = 1 << 12  # our choice: bounds memory, and no result depends on it
# Share of the frames. Our choice: three pairs, each exchanged in one frame of twelve, leap in three frames of four.
# Numbers that are no paths leap in all.
MOST_LEAPING_FRAMES = 0.9
MOST_LEAPING = 200  # markers in one frame; our choice: bounds time, and garments have fewer


@dataclass(frozen=True)
class _Change:
    """The label under which each path goes on from a frame on, (paths,): an index among the markers that are seen."""

    frame: int
    label: Integers


def remove_exchanged(time: Floats, positions: Floats, labels: Sequence[str], where: Callable[[int], str]) -> str:
    """Mark as not seen the positions that have another marker's label; return a warning of them, '' without any.

    - `time` [s], (frames,); `positions` [m], (frames, markers, 3), NaN where not seen
    - `labels`: the markers' names; `where`: returns the name of a frame's line or number in the file
    """
    seen = np.flatnonzero(np.isfinite(positions[..., 0]).any(0))
    if len(time) < FEWEST_FRAMES or len(seen) < 2 or not (np.diff(time) > 0).all():
        return ""
    changes = _changes(time, positions, seen, np.ones(len(seen)))
    ease = np.where(np.ptp([change.label for change in changes], axis=0) > 0, EASE, 1.0)
    if (ease > 1.0).any():
        changes = _changes(time, positions, seen, ease)
    frames = [change.frame for change in changes] + [len(time)]
    paths = np.argsort([change.label for change in changes], axis=1)  # the path under each label
    usual = np.array([_usual_path(one, np.diff(frames)) for one in paths.T])
    told = list[str]()
    for part, exchanged in enumerate(paths != usual):
        markers, span = seen[exchanged], slice(frames[part], frames[part + 1])
        if not np.isfinite(positions[span, markers]).any():
            continue
        positions[span, markers] = np.nan
        names = first_few([labels[k].strip()[:CELL_SHOWN] for k in markers[:MOST_LISTED]], len(markers))
        told.append(f"{names} {_span(time, span.start, span.stop - 1, where)}")
    if not told:
        return ""
    return f"labels seem exchanged, so these count as not seen: {'; '.join(told[:MOST_LISTED])}{_more(told)}"


def _usual_path(paths: Integers, frames: Integers) -> int:
    """Return the path that a label has in most frames, the first one in half of them; both arguments (spans,)."""
    often = np.bincount(paths, frames)
    return int(paths[0] if 2 * often[paths[0]] >= frames.sum() else often.argmax())


def _span(time: Floats, first: int, last: int, where: Callable[[int], str]) -> str:
    """Return the name of a span of frames, and its seconds from the first frame on."""
    begin, end = (f"{time[at] - time[0]:.2f}" for at in (first, last))
    if first == last:
        return f"in {where(first)} ({begin} s)"
    return f"from {where(first)} to {where(last)} ({begin} to {end} s)"


def _more(told: list[str]) -> str:
    """Return how many spans are not listed."""
    return f" and {len(told) - MOST_LISTED} more times" if len(told) > MOST_LISTED else ""


def _changes(time: Floats, positions: Floats, seen: Integers, ease: Floats) -> list[_Change]:
    """Return the labels of the paths from the first frame on, and from each frame on in which some are exchanged.

    `ease`, (markers seen,): divides the rules' factors and `LEAST_LEAP` for a label
    """
    off = _beside_lines(time, positions, seen)
    usual = [np.median(one[np.isfinite(one)]) if np.isfinite(one).any() else np.inf for one in off.T]
    least = np.maximum(LEAST_LEAP, PATH_UNUSUAL * np.array(usual)) / ease
    leaping = (off > least)[1:] & ~np.isnan(positions[1:, seen, 0])
    is_beside = np.isfinite(off[1:])  # behind a gap there is no line
    del off
    changes, frames = [_Change(0, np.arange(len(seen)))], np.flatnonzero(leaping.sum(1) > 1) + 1
    are_off = (leaping & is_beside).sum(1) > 1
    if are_off.sum() > MOST_LEAPING_FRAMES * len(time):
        return changes
    for at in frames:
        begin, label = max(int(at) - LED_OVER, 0), changes[-1].label
        paths = _paths(positions, seen, changes, begin, int(at))
        with np.errstate(over="ignore", invalid="ignore"):
            predicted, further = _predicted(time[begin : at + 1], paths)
            after = _exchanged(positions[at, seen[label]], predicted, least[label] * further, ease[label])
        if after is not None:
            changes.append(_Change(int(at), label[after]))
    return changes


def _beside_lines(time: Floats, positions: Floats, seen: Integers) -> Singles:
    """Return how far each position is from the line through the two before [m], (frames, markers), inf without them."""
    off = np.full((len(time), len(seen)), np.inf, np.float32)
    for begin in range(0, len(time) - 2, PATH_FRAMES_AT_ONCE):
        some = slice(begin, begin + PATH_FRAMES_AT_ONCE + 2)
        pace = np.diff(time[some])
        for k, marker in enumerate(seen.tolist()):
            step = np.diff(positions[some, marker], axis=0)
            with np.errstate(over="ignore", invalid="ignore"):  # of damaged numbers
                far = np.linalg.norm(step[1:] - step[:-1] * (pace[1:] / pace[:-1])[:, None], axis=1)
            off[begin + 2 : begin + 2 + len(far), k] = np.where(np.isnan(far), np.inf, far)
    return off


def _paths(positions: Floats, seen: Integers, changes: list[_Change], begin: int, stop: int) -> Floats:
    """Return the paths in the frames from `begin` to before `stop`, (frames, paths, 3)."""
    parts = list[Floats]()
    for change in reversed(changes):
        first = max(change.frame, begin)
        parts.append(positions[first:stop, seen[change.label]])
        stop = first
        if stop == begin:
            break
    return np.concatenate(parts[::-1])


def _predicted(time: Floats, paths: Floats) -> tuple[Floats, Floats]:
    """Return where a straight line leads from each path's last two positions, and the last one, (2, paths, 3).

    A second array, (paths,), states how many times farther from the line than usual cloth may be. Constant acceleration
    leads `t (t + d) / 2` times as far, `t` [usual steps] behind the last position and `d` from the one before to it.

    `time` [s], (frames + 1,): of the frames of `paths`, (frames, paths, 3), and of the prediction
    """
    which, count = np.arange(paths.shape[1]), len(paths)
    are_seen = np.isfinite(paths[..., 0])
    last = count - 1 - are_seen[::-1].argmax(0)
    are_seen[last, which] = False
    earlier = count - 1 - are_seen[::-1].argmax(0)
    step = np.median(np.diff(time))
    ahead, before = (time[-1] - time[last]) / step, (time[last] - time[earlier]) / step
    is_led, places = last > earlier, paths[last, which]
    pace = np.where(is_led, ahead / np.where(is_led, before, 1.0), 0.0)
    further = np.where(is_led, np.maximum(ahead * (ahead + before) / 2, 1.0), 1.0)
    return np.stack([places + np.nan_to_num(places - paths[earlier, which]) * pace[:, None], places]), further


def _exchanged(here: Floats, predicted: Floats, least: Floats, ease: Floats) -> Integers | None:
    """Return which path's label each path has now, (paths,), None if each keeps its own.

    - `here` [m], (paths, 3): positions under each path's label; `predicted` [m], (2, paths, 3)
    - `least` [m], (paths,): a position farther from its own path's predictions leaps
    - `ease`, (paths,): divides the rules' factors
    """
    own = np.linalg.norm(here - predicted, axis=2).min(0)
    leaping = np.flatnonzero(own > least)
    if not 2 <= len(leaping) <= MOST_LEAPING:
        return None
    for one in predicted:
        apart = np.linalg.norm(here[leaping, None] - one[leaping], axis=2)
        nearest = apart.argmin(1)
        eased = ease[leaping] * own[leaping]
        fits, were = PATH_LEAP * apart.min(1) < eased, -1
        while fits.sum() != were:  # each label has one path, and each path one label
            were = fits.sum()
            others = np.delete(own, leaping[fits])
            if np.isfinite(others).any():
                fits &= eased > PATH_UNUSUAL * np.nanmedian(others)
            fits &= fits[nearest]
            fits &= np.bincount(nearest[fits], minlength=len(fits)) == 1
        if fits.any():
            after = np.arange(len(here))
            after[leaping[nearest[fits]]] = leaping[fits]
            return after
    return None
