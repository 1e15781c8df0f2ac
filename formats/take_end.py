"""Compare the end message of a take with its blocks: missing frames and contradictions. See `formats/SPEC.md`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats, Integers
from formats.blocks import LATEST, TICKS
from formats.plain_text import counted
from formats.sound_blocks import is_number
from formats.surface import SurfaceScan
from formats.take_messages import Message
from formats.take_report import Span
from formats.take_writer import FILE_BLOCK_SECONDS


def is_end(end: Message, version: int) -> bool:
    """Return whether a message has the valid content of an `/end` of this version."""
    names = ("frames", "blocks") if version == 1 else ("frames", "blocks", "scans")
    times = [end[name] for name in ("from", "until") if name in end]
    return all(is_number(end.get(name), 0, 2**40) for name in names) and all(
        is_number(time, -LATEST, LATEST) for time in times
    )


@dataclass(frozen=True)
class Held:
    """The existing part of a take, in the order of its frames.

    - `first`, `rows`, (blocks,): each block's first frame number and number of frames
    - `begins`, `ends` [s], (blocks,): times of each block's first and last frame
    - `scans`: number of scans
    """

    first: Integers
    rows: Integers
    begins: Floats
    ends: Floats
    scans: int

    @classmethod
    def of(cls, kept: list[Message], time: Floats, scans: int) -> Held:
        """Describe sound blocks whose frames have these times [s], (frames,)."""
        rows = np.array([block["frames"] for block in kept])
        last = np.cumsum(rows) - 1
        return cls(np.array([block["first"] for block in kept]), rows, time[last - rows + 1], time[last], scans)


def missing_spans(held: Held, end: Message | None) -> tuple[tuple[Span, ...], int | None]:
    """Return the spans of the sensor's clock with missing frames, and the number of missing frames, None if not known.

    A time in the end message that contradicts the blocks counts as not known.
    """
    begin, finish = _times_of(held, end)
    before = np.concatenate([[0], (held.first + held.rows)[:-1]])
    until = np.concatenate([[begin], held.ends[:-1]])
    gaps = held.first > before
    spans = [(float(a), float(b)) for a, b in zip(until[gaps], held.begins[gaps], strict=True)]
    frames = int((held.first - before)[gaps].sum())
    there = int(held.first[-1] + held.rows[-1])
    if end is None:
        return (*spans, (float(held.ends[-1]), float("inf"))), None
    if end["frames"] > there:
        spans.append((float(held.ends[-1]), finish))
        frames += end["frames"] - there
    return tuple(spans), frames


def _times_of(held: Held, end: Message | None) -> tuple[float, float]:
    """Return the times of a take's first and last frame [s], infinite where not known."""
    begin, finish = (end[name] / TICKS if end and name in end else np.nan for name in ("from", "until"))
    return begin if begin < held.begins[0] else -np.inf, finish if finish > held.ends[-1] else np.inf


def contradictions(held: Held, ends: list[Message]) -> Iterator[str]:
    """Yield the statements in a take's end messages that contradict its blocks, its scans or another end message."""
    if not ends:
        return
    end = ends[-1]
    if any(other != end for other in ends):
        yield "its several ends differ"
    there = int(held.first[-1] + held.rows[-1])
    for name, count in (("frame", there), ("block", len(held.rows)), ("scan", held.scans)):
        if end.get(f"{name}s", count) < count:
            yield f"its end counts {counted(end[f'{name}s'], name)}, and there are {count}"
    for name, word, which, time, is_there in (
        ("from", "begins", "first", float(held.begins[0]), held.first[0] == 0),
        ("until", "ends", "last", float(held.ends[-1]), there == end["frames"]),
    ):
        apart = end[name] - round(time * TICKS) if name in end else 0
        is_within = apart > 0 if name == "from" else apart < 0
        if abs(apart) > 1 and (is_there or is_within):  # a tick of rounding is no contradiction
            yield f"its end says that it {word} at {end[name] / TICKS:.6f} s, and its {which} frame is of {time:.6f} s"


def stray_scans(held: Held, scans: list[SurfaceScan], spans: tuple[Span, ...]) -> Iterator[str]:
    """Yield a warning where scans of a version 1 take lie outside its time, since they may belong to another take.

    A scan of version 1 names no take. The writer put every scan behind the frame from which it was made. So a scan lies
    between the first and the last frame, or within a span with missing frames. A pause may precede frames that a cut
    removed, so the whole span counts. Other programs may have scanned shortly before or after the frames, so one
    block's time beyond them also counts.

    - `spans`: as of `missing_spans`
    """
    begin, end = float(held.begins[0]), float(held.ends[-1])
    allowed = [(begin - FILE_BLOCK_SECONDS, end + FILE_BLOCK_SECONDS), *spans]
    stray = [scan.time for scan in scans if not any(since <= scan.time <= until for since, until in allowed)]
    if stray:
        which = "a scan" if len(stray) == 1 else f"{len(stray)} of {len(scans)} scans, one"
        yield f"{which} of {stray[0]:.6f} s may be of another take: the frames go from {begin:.6f} to {end:.6f} s"
