"""Say in words which seconds of a take are missing, and which of its notes doubt it.

Seconds in every sentence about a take count from `origin_of`, the take's first frame. That frame may show the points,
the hanger or both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from formats.arrays import Floats
from formats.blocks import LATEST, TICKS
from formats.plain_text import plain
from formats.take import Take
from formats.take_report import Span

MOST_SPANS = 5  # that one sentence lists
DOUBTS = ("clock", "file")  # notes in which an import doubts clocks, or the number of frames


def missing_words(take: Take, spans: Sequence[Span] | None = None) -> str:
    """Return `2.03 to 3.10 s and from 7.20 s on`; nothing where nothing is missing.

    spans: of the sensor's clock; by default all that the take lacks

    Seconds count from the take's first frame, or from the first one that is left where the beginning is not known.
    """
    found = take.missing if spans is None else spans
    origin = origin_of(take, found)
    return listed([_span(begin - origin, end - origin) for begin, end in found])


def listed(words: list[str]) -> str:
    """Return `a, b and c`; of many spans only the first, and how many more there are."""
    if len(words) > MOST_SPANS:
        words = [*words[: MOST_SPANS - 1], f"{len(words) - MOST_SPANS + 1} more spans"]
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def origin_of(take: Take, spans: Sequence[Span] = ()) -> float:
    """Return when a take began, or its rest where the beginning is not known [s of the sensor's clock].

    spans: missing ones besides its own
    """
    return min([*(begin for begin, _ in (*take.missing, *spans) if math.isfinite(begin)), float(take.time[0])])


def incomplete_words(take: Take) -> str:
    """Return `is incomplete; missing: 2.03 to 3.10 s`; nothing of a complete take."""
    if take.is_complete:
        return ""
    return f"is incomplete; missing: {missing_words(take) or 'its end was never written'}"


def noted_doubts(notes: Mapping[str, str]) -> list[str]:
    """Return the notes of a take that doubt it, each one line: a file gives them, and every sentence repeats them."""
    return [plain(notes[name]) for name in DOUBTS if notes.get(name)]


def _span(begin: float, end: float) -> str:
    if math.isinf(begin):
        return f"what was before {end:.2f} s"
    return f"from {begin:.2f} s on" if math.isinf(end) else span_words(begin, end)


def span_words(begin: float, end: float, digits: int = 2, lead: str = "") -> str:
    """Return `2.03 to 3.10 s`, and `at 4.03 s` where both are the same in so many digits; lead: before two times."""
    first, last = f"{begin:.{digits}f}", f"{end:.{digits}f}"
    return f"at {first} s" if first == last else f"{lead}{first} to {last} s"


def possible_spans(spans: Sequence[Span], time: Floats) -> list[Span]:
    """Return the spans [s] in which frames can be missing: each is a beginning and a later end, without a frame within.

    time [s], (frames,): of the frames that are there
    """
    begin, end = np.array(spans, float).reshape(-1, 2).T
    are_times = [(np.abs(at) <= LATEST / TICKS) | np.isinf(at) for at in (begin, end)]
    is_free = np.searchsorted(time, begin + 1 / TICKS) >= np.searchsorted(time, end - 1 / TICKS)
    can_be = (begin < end) & np.all(are_times, axis=0) & is_free
    return [span for span, is_span in zip(spans, can_be, strict=True) if is_span]
