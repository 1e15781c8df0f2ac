"""Choose the used part of a take with missing frames: the neighbouring stretches with the longest judged time.

A hole is a stretch of missing frames. The hanger's path is interpolated across a hole of more than `LONGEST_GAP`
seconds, as `fit.recordings.hanger_path` does where the hanger was not seen. The cloth is not judged there, nor in the
`SETTLING` after it. Hence a hole is bridged only if the stretch beyond it is judged for longer than the hole lasts.

A take whose first frames are lost begins with cloth of unknown state, and so does one whose used part begins at a
hole. Its first seconds drive the simulation and are not judged, unless hanger and cloth rest there. Cloth that swings
under a hanger at rest is no cloth at rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from fit.errors import FitError, ImpossiblePathError, MismatchError
from formats.arrays import Floats
from formats.fault_words import doubts_of
from formats.fit_records import OF_A_TAKE
from formats.missing import listed, missing_words, origin_of, span_words
from formats.motion import STILL_MOTION
from formats.plain_text import counted
from formats.sights import SETTLING, shown_halves, sights_of, too_few_halves
from formats.take import LONGEST_GAP, Take, told_apart

REST_WINDOW = 0.5  # s: beginning of a stretch that is tested for rest
FRAME_FIELDS = (
    "time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers", "pitch",
    "pitch_sd", "points_hidden", "quality",
)  # fmt: skip


def stretches(take: Take) -> list[slice]:
    """Return the frames between the holes of a take."""
    holes = [end for begin, end in take.missing if math.isfinite(begin + end) and end - begin > LONGEST_GAP]
    edges = [0, *(int(np.searchsorted(take.time, end)) for end in sorted(holes)), len(take.time)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def intact_part(take: Take) -> Take:
    """Return the used part of a take; the whole take if no frames are missing in it or before it.

    Points are invalid until the hanger's path determines the state of the cloth.
    """
    found = stretches(take)
    if len(found) < 2 and not _is_unknown(take, found[0]):
        return take
    used = _worth_their_holes(take, found)
    begin, rows = _judged_from(take, used[0]), slice(used[0].start, used[-1].stop)
    kept = {name: values[rows] for name in FRAME_FIELDS if (values := getattr(take, name)) is not None}
    valid = kept["points_valid"].copy()
    valid[kept["time"] < begin] = False
    return replace(take, **{**kept, "points_valid": valid})


def _worth_their_holes(take: Take, found: list[slice]) -> list[slice]:
    """Return the neighbouring stretches with the largest judged time less the time of the holes between them.

    Source: Kadane's algorithm, J. Bentley, "Programming pearls", Commun. ACM 27 (1984) 865.
    """
    best, here, begin, chosen = -math.inf, -math.inf, 0, slice(0, 1)
    for k, part in enumerate(found):
        end = float(take.time[part.stop - 1])
        alone = end - _judged_from(take, part)
        hole = float(take.time[part.start] - take.time[part.start - 1]) if k else 0.0
        joined = here + max(end - float(take.time[part.start]) - SETTLING, 0.0) - hole
        if k and joined > alone:
            here = joined
        else:
            here, begin = alone, k
        if here > best:
            best, chosen = here, slice(begin, k + 1)
    return found[chosen]


def _judged_from(take: Take, part: slice) -> float:
    """Return the instant [s, sensor's clock] from which the cloth is judged if this stretch is the first used one."""
    begin = float(take.time[part.start])
    return begin + SETTLING if _is_unknown(take, part) and not _begins_at_rest(take, part) else begin


def _is_unknown(take: Take, part: slice) -> bool:
    """Return whether frames are lost before a stretch."""
    return part.start > 0 or any(end <= take.time[0] for _, end in take.missing)


def _begins_at_rest(take: Take, part: slice) -> bool:
    """Return whether the held ends and at least half of the observed points are at rest."""
    time = take.time[part]
    first = time < time[0] + REST_WINDOW
    held = take.held[part][first]
    held = held[np.isfinite(held).all((1, 2))]
    places = np.where(take.points_valid[part][first][..., None], take.points[part][first], np.nan)
    moved = [_motion(one[np.isfinite(one).all(1)]) for one in np.swapaxes(places, 0, 1)]
    seen = [one for one in moved if np.isfinite(one)]
    rests = all(_motion(end) < STILL_MOTION for end in np.swapaxes(held, 0, 1))  # not a number is no rest
    return bool(rests and seen and np.median(seen) < STILL_MOTION)


def _motion(places: Floats) -> float:
    """Return the root mean square distance [m] of positions, (frames, 3), from their mean; nan for fewer than two."""
    return float(np.sqrt(places.var(0).sum())) if len(places) > 1 else math.nan


def describe_missing(takes: Sequence[Take]) -> list[str]:
    """Return a warning for each incomplete take, with its missing and its used parts."""
    found = []
    for take, name in zip(takes, told_apart(takes), strict=True):
        if take.is_complete:
            continue
        used = intact_part(take)
        words = missing_words(take) or "its end was never written"
        note = f"{OF_A_TAKE}{name} is incomplete ({len(take.time)} frames are left; missing: {words})"
        parts, origin = stretches(used), origin_of(take)
        if len(parts) > 1 or len(used.time) < len(take.time):
            spans = [span_words(used.time[p.start] - origin, used.time[p.stop - 1] - origin) for p in parts]
            note += f"; used: {listed(spans)}"
        if np.count_nonzero(used.points_valid) < np.count_nonzero(take.points_valid[_rows_of(used, take)]):
            note += f"; its first {SETTLING:g} s are not judged, as how the cloth hung there is lost"
        if len(parts) > 1:
            note += f"; {SETTLING:g} s after a hole are not judged, as how the hanger moved there is lost"
        found.append(note + ".")
    return found


def describe_doubts(takes: Sequence[Take]) -> list[str]:
    """Return a warning for every doubt about a take, except for missing frames."""
    return doubts_in_words(told_apart(takes), [doubts_of(take) for take in takes])


def doubts_in_words(names: Sequence[str], doubts: Sequence[Sequence[str]]) -> list[str]:
    """Return the warnings of `describe_doubts` from the name and the doubts of each take."""
    return [f"{OF_A_TAKE}{name}: {doubt}." for name, every in zip(names, doubts, strict=True) for doubt in every]


def describe_short(takes: Sequence[Take]) -> list[str]:
    """Return a warning for each whole take that is too short to be fitted to by itself, in the words of `record`."""
    found = []
    for take, name in zip(takes, told_apart(takes), strict=True):
        lack = "" if take.missing else too_few_halves(shown_halves(take, sights_of(take)))
        if lack:
            found.append(f"{OF_A_TAKE}{name} is too short to be fitted to by itself: {lack}.")
    return found


def describe_flaws(takes: Sequence[Take]) -> list[str]:
    """Return the warnings about takes: missing parts first, then other doubts."""
    return describe_missing(takes) + describe_doubts(takes)


@contextmanager
def naming_damage(takes: Sequence[Take]) -> Iterator[None]:
    """Add to a refusal within this context which of these takes are incomplete or damaged, as that may be its cause.

    Raises:
        FitError: the refusal, of its own class; unchanged if it is about an option, a file or the garment, if lost
        frames do not cause it, or if the takes are whole.
    """
    try:
        yield
    except (MismatchError, ImpossiblePathError):
        raise
    except FitError as error:
        named = [take for take in takes if error.where == take.take_id] or list(takes)
        is_elsewhere = _is_elsewhere(error.where) or error.where in {take.garment.name for take in takes}
        damage = "" if is_elsewhere else damage_of(named)
        if not damage:
            raise
        raise type(error)(error.what, where=error.where, advice=f"{error.advice}; {damage}") from error


def _is_elsewhere(where: object) -> bool:
    """Return whether an error is about an option or a file of the command's own."""
    return isinstance(where, Path) or str(where).startswith("--")


def damage_of(takes: Sequence[Take]) -> str:
    """Return which takes are incomplete or damaged, with the next step, or '' where none is."""
    found, is_damaged = [], False
    for take, name in zip(takes, told_apart(takes), strict=True):
        blocks = take.report.damaged_blocks if take.report else 0
        missing = missing_words(take) or "its end was never written"
        words = [] if take.is_complete else [f"is incomplete (missing: {missing})"]
        words += [f"has {counted(blocks, 'damaged block')}"] if blocks else []
        if words:
            found.append(f"the take {name} {' and '.join(words)}, which may be the cause")
            is_damaged |= blocks > 0
    if not found:
        return ""
    step = "copy the file again from where it was recorded, or record again" if is_damaged else "record again"
    return f"{'; '.join(found)}; {step}"


def flaw_notes(notes: Sequence[str]) -> list[str]:
    """Return a result's notes that come from `describe_flaws`: missing parts, damage and doubts of its takes."""
    return [note for note in notes if note.startswith(OF_A_TAKE)]


def _rows_of(used: Take, take: Take) -> slice:
    begin = int(np.searchsorted(take.time, used.time[0]))
    return slice(begin, begin + len(used.time))
