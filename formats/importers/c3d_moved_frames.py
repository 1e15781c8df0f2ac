"""Find whole frames that were lost or inserted within the frames of a C3D file, which has no times of its own.

Markers that move show it: behind a lost frame, all of them move two steps at once. Around an inserted frame, all of
them move one step in two frames. The step `s` from one frame to another, `g` frames later, is compared with `d`:

    | s . d / d . d - n |  <  STEP_FITS,    | s_j - n d_j |  <  | s_j - g d_j |  for nearly all markers j

`d` is the mean of the step before and the step behind, so that a steady acceleration cancels. The products sum over the
markers, so that noise cancels. Where `n - 1` frames were lost, `g` is 1 and `n` is 2 or more. Where `g - 1` frames were
inserted, `g` is 2 or more and `n` is 1, whatever they hold.

Undamaged motion is not found for four reasons. Along `d`, the two steps before and the two behind must equal it within
`STEADY`, as on no impact and no start. `|d|` must be `STEP_SHOWS` times what most steps differ along it, so noise and a
still hanger show nothing. It must be several times the resolution of the file. A program that changes the frame rate
repeats or leaves out frames throughout, so many places are no damage.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats, Integers
from formats.plain_text import counted, first_few

STEP_FITS = 0.1  # of a step; our choice: what frames of 5 real recordings miss in 9 of 10 cases
STEADY = 0.25  # of a step; our choice: a swing of 1 Hz changes by a fifth in five frames at 30 a second
STEP_SHOWS = 4.0  # times the usual difference; our choice: impacts differ by a few times the usual
STEPS_ALIKE = 0.95  # of the steps; our choice: leaves out the steps at MOST_PLACES
MOST_MARKERS = 0.9  # of the markers; our choice: one of them may be exchanged or rest
FEWEST_STEPPING = 3  # seen throughout; our choice: fewer may turn into any direction
MOST_FRAMES = 3  # lost or inserted at one place; our choice: the motion across more is not steady
MOST_PLACES = 0.01  # of the frames, and at least FEW_PLACES: more are a changed frame rate
FEW_PLACES = 3  # places; our choice: files of a few hundred frames
MARKERS_STEPPING = 12  # markers, evenly spread; our choice: bounds time, and a lost frame moves all of them
FEWEST_UNITS = 5.0  # of the file's resolution in a step; our choice: rounding changes a step by one at most
FINEST_SHARE = 0.01  # of the differences that are not 0: the smallest of few may be a position of other origin
STEPS_AT_ONCE = 1 << 12  # frames; our choice: bounds memory, and no result depends on it
AROUND = 2  # frames before, and behind, that show the steps


@dataclass(frozen=True)
class _Place:
    """A frame behind which `lost` frames are missing, below 0 if they are too many; the misfit, and the step [m]."""

    frame: int
    lost: int
    misfit: float
    step: float


def warning_of_moved_frames(positions: Floats, rate: float, where: Callable[[int], str]) -> str:
    """Return a warning of whole frames that seem lost or inserted, '' without any.

    - `positions` [m], (frames, markers, 3), NaN where not seen; `rate` [1/s]: frame rate
    - `where`: returns the name of a frame's number in the file
    """
    seen = np.flatnonzero(np.isfinite(positions[..., 0]).any(0))
    if len(seen) < FEWEST_STEPPING or len(positions) < 2 * AROUND + 2:
        return ""
    some = seen[np.unique(np.linspace(0, len(seen) - 1, MARKERS_STEPPING).astype(int))]
    usual, found = list[Floats](), list[_Place]()
    for first in range(0, len(positions), STEPS_AT_ONCE):
        piece = positions[first : first + STEPS_AT_ONCE + 2 * AROUND + MOST_FRAMES + 1, some]
        for gap in range(1, MOST_FRAMES + 2):
            differ, places = _places(piece, gap, first)
            usual += [differ] if gap == 1 else []
            found += places
    differ = np.concatenate(usual)
    differ = differ[np.isfinite(differ)]
    if not found or not len(differ):
        return ""
    least = max(STEP_SHOWS * float(np.quantile(differ, STEPS_ALIKE)), FEWEST_UNITS * _resolution(positions[:, some]))
    places = _best_of([place for place in found if place.step > least])
    if not places or len(places) > max(FEW_PLACES, MOST_PLACES * len(positions)):
        return ""
    each = [
        f"{counted(abs(place.lost), 'frame')} {'lost' if place.lost > 0 else 'inserted'} behind {where(place.frame)}"
        for place in places
    ]
    early = sum(place.lost for place in places) / rate
    wrong = f"the last times are {abs(early):.2g} s too {'early' if early > 0 else 'late'}"
    return (
        f"all markers step at once as where frames are missing or too many: {first_few(each, len(each))}; "
        f"{wrong if early else 'the times between are wrong'}; copy or export it again"
    )


def _places(positions: Floats, gap: int, first: int) -> tuple[Floats, list[_Place]]:
    """Return how far each step across `gap` frames is from the usual one [m], (steps,), and places that seem moved.

    - `positions` [m], (frames, markers, 3); `first`: number of their first frame
    """
    count = len(positions) - gap - 2 * AROUND
    if count < 1:
        return np.empty(0), []
    step, usual, share, size = _shares(positions, gap, np.arange(AROUND, AROUND + count))
    steps = np.clip(np.rint(share), 2, MOST_FRAMES + 1) if gap == 1 else np.ones(count)
    maybe = np.flatnonzero(np.abs(share - steps) < STEP_FITS)
    found = list[_Place]()
    for k in maybe.tolist():
        before, behind = AROUND + k, AROUND + k + gap
        beside = [positions[at + 1] - positions[at] for at in (before - 2, before - 1, behind, behind + 1)]
        between = [positions[before + one] - positions[before] for one in range(1, gap)]
        seen = np.isfinite(step[k] + usual[k] + beside[0] + beside[3]).all(1)
        if seen.sum() < FEWEST_STEPPING or any(abs(_along(one[seen], usual[k, seen]) - 1) > STEADY for one in beside):
            continue
        # A frame that lies between both ends of the step is not inserted.
        if any(abs(_along(one[seen], usual[k, seen]) - 0.5) < 0.5 - STEP_FITS for one in between):
            continue
        off, honest = (np.linalg.norm((step[k] - n * usual[k])[seen], axis=1) for n in (steps[k], gap))
        if (off < honest).sum() >= MOST_MARKERS * seen.sum():
            misfit = float(abs(share[k] - steps[k]))
            found.append(_Place(first + before, int(steps[k]) - gap, misfit, float(size[k])))
    return (np.abs(share - gap) * size)[:STEPS_AT_ONCE], found


def _shares(positions: Floats, gap: int, frames: Integers) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the steps across `gap` frames, the usual ones, their ratio along these, and the size of these [m].

    The ratio is over all markers seen, so that noise cancels; NaN where too few are seen, or at rest.
    """
    before, behind = positions[frames], positions[frames + gap]
    step = behind - before
    usual = (before - positions[frames - 1] + positions[frames + gap + 1] - behind) / 2
    are_seen = np.isfinite(step + usual)
    moved, along = np.where(are_seen, usual, 0.0), np.where(are_seen, step, 0.0)
    squares, count = np.einsum("fmc,fmc->f", moved, moved), are_seen[..., 0].sum(1)
    shows = (count >= FEWEST_STEPPING) & (squares > 0)
    share = np.einsum("fmc,fmc->f", along, moved) / np.where(shows, squares, np.nan)
    return step, usual, share, np.sqrt(squares / np.maximum(count, 1))


def _along(step: Floats, usual: Floats) -> float:
    """Return the part of some markers' steps along the usual ones, in units of these; both (markers, 3)."""
    return float(np.nansum(step * usual) / (usual**2).sum())


def _resolution(positions: Floats) -> float:
    """Return the smallest usual change of a coordinate from one frame to the next [m], 0 without any."""
    changes = np.abs(np.diff(positions[:STEPS_AT_ONCE], axis=0))
    changes = changes[changes > 0]
    return float(np.quantile(changes, FINEST_SHARE)) if len(changes) else 0.0


def _best_of(found: list[_Place]) -> list[_Place]:
    """Return the places in order, of those beside each other the one that fits best."""
    kept = list[_Place]()
    for place in sorted(found, key=lambda one: (one.misfit, one.frame)):
        if all(abs(place.frame - one.frame) > AROUND + MOST_FRAMES for one in kept):
            kept.append(place)
    return sorted(kept, key=lambda one: one.frame)
