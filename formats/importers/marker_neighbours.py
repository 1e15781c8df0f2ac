"""Check the distances between neighbouring markers against the flat garment, and find the cause of wrong ones.

A wrong unit or size changes all distances by one factor. Two markers with exchanged names change the distances to the
neighbours of these two alone. Names that are exchanged in some frames, as behind a gap, change them there alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from formats.arrays import Booleans, Floats, Integers
from formats.errors import TakeError
from formats.garment import Garment
from formats.importers.marker_tracks import MARKER_SD
from formats.importers.units import other_unit, step_of_unit
from formats.impossible_points import BEYOND_REACH, GLUE, PAIRS_LOOKED_AT, find_impossible
from formats.judged_cloth import MOST_STRETCHED
from formats.plain_text import counted, first_few
from formats.sights import spread

LEAST_WIDTH = 0.6  # of the flat distances, in the median over neighbours: folds shorten some, a wrong unit all
AS_NEAR = 1.1  # times the distance of the nearest marker: markers within it are neighbours

MOST_EXCHANGED = 0.5  # of a garment's markers; our choice: labels are exchanged among few, and noise moves all


def check_neighbours(
    positions: Floats, garment: Garment, held: tuple[int, int], path: Path, *, offers_anyway: bool = False,
    overridden: Sequence[str] = (), is_unit_stated: bool = True,
) -> None:  # fmt: skip
    """Refuse neighbours or corners farther apart than cloth can stretch, and neighbours that are all too near.

    - `positions` [m], (frames, points, 3), NaN where not seen
    - `held`: indices of the markers on the two top corners
    - `offers_anyway`: whether the command has the options --unit and --anyway, which the error then names
    - `overridden`: symbols of the units that the file states and that --unit overrides
    - `is_unit_stated`: whether the file states a unit

    Raises:
        TakeError: names the distance, and the unit or the exchange of markers that would explain it.
    """
    flat, near = _neighbours(garment)
    pairs = [(int(a), int(b)) for a, b in zip(*np.nonzero(np.triu(near)), strict=True)]
    widths, apart = {}, {}
    for first, second in [*pairs, held]:
        distances = np.linalg.norm(positions[:, first] - positions[:, second], axis=1)
        both = np.isfinite(distances)
        if both.any() and np.isfinite(flat[first, second]):
            apart[first, second] = float(np.median(distances[both]))
            widths[first, second] = apart[first, second] / flat[first, second]
    shares = [widths[pair] for pair in pairs if pair in widths]
    usual = float(np.median(shares)) if shares else 1.0
    far = next((pair for pair, width in widths.items() if width > MOST_STRETCHED), None)
    if far is not None:
        one, other = (garment.points[k].name for k in far)
        told = (
            f"markers {one!r} and {other!r} are {1e3 * apart[far]:.0f} mm apart, "
            f"on the flat garment {1e3 * flat[far]:.0f} mm"
        )
        exchanged = _exchanged(positions, flat, near, far) if usual <= MOST_STRETCHED else None
        if exchanged is not None:
            names = " and ".join(repr(garment.points[k].name) for k in exchanged)
            raise TakeError(
                f"{told}; are the names of {names} exchanged?", where=path, advice="check the names of the markers"
            )
        off = widths[far] if usual > MOST_STRETCHED else 1.0
        step = step_of_unit(off, overridden, is_stated=is_unit_stated) if offers_anyway else ""
        raise TakeError(
            f"{told}{other_unit(off)}", where=path,
            advice=f"check the unit, the garment's size and the names of the markers{step}",
        )  # fmt: skip
    if usual < LEAST_WIDTH:
        step = step_of_unit(usual, overridden, is_stated=is_unit_stated) if offers_anyway else ""
        raise TakeError(
            f"neighbouring markers are {usual:.2g} of their distance on the flat garment apart in the "
            f"median{other_unit(usual)}",
            where=path, advice=f"check the unit and the garment's size{step}",
        )  # fmt: skip


def warning_of_far_markers(time: Floats, positions: Floats, garment: Garment) -> str:
    """Return a warning of markers that are farther from others in some frames than the cloth reaches, '' without any.

    A fit leaves these positions out. `time` [s], (frames,); `positions` [m], (frames, points, 3), NaN where not seen
    """
    flat, near = _neighbours(garment)
    one, other = np.nonzero(np.triu(near))
    with np.errstate(invalid="ignore"):
        apart = np.linalg.norm(positions[:, one] - positions[:, other], axis=2)
        frames = np.flatnonzero((apart > MOST_STRETCHED * flat[one, other] + GLUE).any(1))
    looked_at = spread(frames, max(PAIRS_LOOKED_AT // len(flat) ** 2, 1))
    seen = np.asarray(np.isfinite(positions[looked_at]).all(2))
    places = np.array([point.at_m for point in garment.points], float)
    some = np.where(seen[..., None], positions[looked_at], 0.0)
    far = find_impossible(some, seen, np.full(some.shape, MARKER_SD), places)
    if not far.any():
        return ""
    often = [k for k in np.argsort(-far.sum(0), kind="stable").tolist() if far[:, k].any()]
    names = first_few([repr(garment.points[k].name) for k in often])
    begin, end = (time[looked_at[k]] - time[0] for k in np.flatnonzero(far.any(1))[[0, -1]])
    count = counted(round(len(frames) * float(far.any(1).mean())), "frame")
    count = count if len(looked_at) == len(frames) else f"about {count}"
    when = f"in {count}, at {begin:.2f} s" if begin == end else f"in {count}, from {begin:.2f} to {end:.2f} s"
    cause = "are their labels exchanged there?" if len(often) > 1 else "is another marker labelled so there?"
    if len(often) > MOST_EXCHANGED * len(flat):
        cause = "is their noise of several mm, or the garment larger than described?"
    return f"{names} {BEYOND_REACH if len(often) > 1 else BEYOND_REACH.replace('are', 'is', 1)} {when}; {cause}"


def _neighbours(garment: Garment) -> tuple[Floats, Booleans]:
    """Return the distances of markers on the flat garment [m], and whether two are neighbours, (points, points)."""
    places = np.array([point.at_m for point in garment.points], float)
    flat = np.linalg.norm(places[:, None] - places[None], axis=2)
    flat[flat == 0] = np.inf  # of a marker to itself, and of two markers that the garment has at one place
    near = flat <= AS_NEAR * flat.min(axis=1, keepdims=True)
    return flat, np.asarray((near | near.T) & np.isfinite(flat))


def _exchanged(positions: Floats, flat: Floats, near: Booleans, far: tuple[int, int]) -> tuple[int, int] | None:
    """Return the only two markers whose exchange makes all neighbours fit, in one frame.

    Of the frames in which both far ones are seen, the frame is the one with the most markers.

    - `flat` [m], `near`: distances on the flat garment, and whether two markers are neighbours, (points, points)
    - `far`: two neighbours that are too far apart: one of them is exchanged
    """
    seen = np.asarray(np.isfinite(positions).all(2))
    place = positions[int((seen.sum(1) * seen[:, far[0]] * seen[:, far[1]]).argmax())]
    found = set[tuple[int, int]]()
    for one in far:
        for other in range(len(place)):
            order = np.arange(len(place))
            order[[one, other]] = other, one
            if other != one and _fit(place[order], flat, near, order[[one, other]]) and _fit(place[order], flat, near):
                found.add((min(one, other), max(one, other)))
    return found.pop() if len(found) == 1 else None


def _fit(place: Floats, flat: Floats, near: Booleans, markers: Integers | slice = slice(None)) -> bool:
    """Return whether no neighbour of some markers lies farther away than cloth can stretch."""
    one, other = np.nonzero(near[markers])
    one = np.arange(len(place))[markers][one]
    apart = np.linalg.norm(place[one] - place[other], axis=1)
    return not (apart > MOST_STRETCHED * flat[one, other]).any()
