"""Describe the missing seconds of a take in words, and select the notes that report contradictions.

Seconds in every sentence about a take count from `origin_of`, the time of the take's first frame. That frame may show
the points, the hanger or both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from formats.arrays import Floats
from formats.blocks import LATEST, TICKS
from formats.plain_text import joined, plain
from formats.take import Take
from formats.take_report import Span

MOST_SPANS = 5  # listed in one sentence; our choice: more would hide the sentence's advice
DOUBTS = ("clock", "file")  # notes in which an import reports a clock offset, or contradictions in a file


def missing_words(take: Take, spans: Sequence[Span] | None = None) -> str:
    """Return the missing spans in words, such as `2.03 to 3.10 s and from 7.20 s on`; '' where none is missing.

    spans: on the sensor's clock; by default all spans that the take lacks

    Seconds count from the take's first frame, or from the first remaining frame where the beginning is not known.
    """
    found = take.missing if spans is None else spans
    origin = origin_of(take, found)
    return listed([_span(begin - origin, end - origin) for begin, end in found])


def listed(words: list[str]) -> str:
    """Return `a, b and c`; of many words only the first ones, and the count of the others."""
    if len(words) > MOST_SPANS:
        words = [*words[: MOST_SPANS - 1], f"{len(words) - MOST_SPANS + 1} more spans"]
    return joined(words)


def origin_of(take: Take, spans: Sequence[Span] = ()) -> float:
    """Return the time of a take's first frame, or first remaining frame [s of the sensor's clock].

    spans: missing spans besides the take's own
    """
    return min([*(begin for begin, _ in (*take.missing, *spans) if math.isfinite(begin)), float(take.time[0])])


def incomplete_words(take: Take) -> str:
    """Return `is incomplete; missing: 2.03 to 3.10 s`; '' for a complete take."""
    if take.is_complete:
        return ""
    return f"is incomplete; missing: {missing_words(take) or 'its end was never written'}"


def noted_doubts(notes: Mapping[str, str]) -> list[str]:
    """Return the notes of a take that report contradictions, each as one line, since sentences quote them."""
    return [plain(notes[name]) for name in DOUBTS if notes.get(name)]


def _span(begin: float, end: float) -> str:
    if math.isinf(begin):
        return f"all frames before {end:.2f} s"
    return f"from {begin:.2f} s on" if math.isinf(end) else span_words(begin, end)


def span_words(begin: float, end: float, digits: int = 2, lead: str = "") -> str:  # decimals, finer than a frame
    """Return `2.03 to 3.10 s`, or `at 4.03 s` where both round to the same; `lead` stands before two times."""
    first, last = f"{begin:.{digits}f}", f"{end:.{digits}f}"
    return f"at {first} s" if first == last else f"{lead}{first} to {last} s"


def possible_spans(spans: Sequence[Span], time: Floats) -> list[Span]:
    """Return the spans [s] that can be missing: the end is later than the beginning, and no frame lies within.

    time [s], (frames,): of the existing frames
    """
    begin, end = np.array(spans, float).reshape(-1, 2).T
    are_times = [(np.abs(at) <= LATEST / TICKS) | np.isinf(at) for at in (begin, end)]
    is_free = np.searchsorted(time, begin + 1 / TICKS) >= np.searchsorted(time, end - 1 / TICKS)
    can_be = (begin < end) & np.all(are_times, axis=0) & is_free
    return [span for span, is_span in zip(spans, can_be, strict=True) if is_span]
