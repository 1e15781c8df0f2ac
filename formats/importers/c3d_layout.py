"""Decide by a C3D file's size where its frames lie, if its header and its parameters contradict each other.

Several layouts of the frames are possible then:

    bytes of a frame  =  (4 points + analogue values) x (4 for floats, 2 for integers)

A layout agrees with the size if its frames end less than a block or a frame before the file's end. The first layout
that agrees counts, and the layouts with the fewest departures from the header come first.

Where no layout agrees, or the frames would begin within the parameters, the frames may begin right behind these. This
layout counts if its size agrees. The bytes before the stated block and behind the last frame must agree, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass, replace
from itertools import product
from operator import itemgetter
from pathlib import Path

import numpy as np

from formats.errors import TakeError
from formats.importers.c3d_blocks import BLOCK_BYTES
from formats.importers.c3d_header import (
    COUNTED,
    MOST_STATED_FRAMES,
    SENSIBLE,
    WORD_VALUES,
    HeaderWords,
    analogue_of,
    counts_of,
    first_of,
    is_word_of,
    points_of,
)
from formats.importers.c3d_parameters import FLOAT, Parameters, numbers_of
from formats.importers.c3d_sections import find_parameters
from formats.importers.stated_values import FEWER_FRAMES

FASTEST_RATE = 10_000.0  # frames a second; our choice: ten times what can be used (`formats.plausible`)
SAME_SCALE = 1e-3  # relative difference: a copy has the same digits


@dataclass(frozen=True)
class Layout:
    """Place and number format of the frames in a file.

    - `points`, `analogue`: numbers of points and of analogue values a frame
    - `frames`: number of frames; `start`: block of 512 bytes at which they begin, counted from 1
    - `is_float`: whether numbers are floats, else 16-bit integers
    """

    points: int
    frames: int
    start: int
    analogue: int
    _: KW_ONLY
    is_float: bool

    @property
    def width(self) -> int:
        """Bytes of a frame."""
        return (4 * self.points + self.analogue) * (4 if self.is_float else 2)

    @property
    def data_at(self) -> int:
        """Offset of the first frame [bytes]."""
        return BLOCK_BYTES * (self.start - 1)

    def held(self, size: int) -> int:
        """Return the number of frames for which a file of `size` bytes has room."""
        return (size - self.data_at) // self.width if self.width and self.start > 1 else 0

    def agrees(self, size: int) -> bool:
        """Return whether the frames fill a file of `size` bytes."""
        rest = size - self.data_at - self.frames * self.width
        is_filled = 0 <= rest < BLOCK_BYTES or self.held(size) == self.frames
        return self.start > 1 and self.frames > 0 and self.width > 0 and is_filled


@dataclass(frozen=True)
class Header:
    """The header of a file, with the layout that counts.

    - `processor`: code of the byte order
    - `scale`: unit of integer positions, in the file's unit of length
    - `held`: number of frames for which the file has room
    - `end` [bytes]: offset of the file's end, or of the section behind the frames
    - `rate` [1/s]: None where the header states none
    - `doubts`: warnings of parameters that contradict the header, '' without any
    - `lacking`: error of a file that ends before its last frame, None where it does not
    """

    processor: int
    layout: Layout
    scale: float
    held: int
    end: int
    rate: float | None
    doubts: str
    lacking: TakeError | None = None


def read_header(path: Path, size: int) -> tuple[Header, Parameters]:
    """Return the header and the parameters of a file of `size` bytes.

    Raises:
        TakeError: the file is no C3D file, is malformed, or contradicts itself so that its size cannot decide.
    """
    (words, parameters, malformed), moved = find_parameters(path)
    rotations, start = (int(first_of(parameters.numbers("ROTATION", name))) for name in ("USED", "DATA_START"))
    if rotations > 0 and start % WORD_VALUES > 1:  # some programs state a section of no rotations
        first = BLOCK_BYTES * (start % WORD_VALUES - 1)  # the word of a block wraps round in large files
        words = replace(words, behind=(*words.behind, *range(first, size, WORD_VALUES * BLOCK_BYTES)))
    scale, copy = words.scale, first_of(parameters.numbers("POINT", "SCALE"))
    if not np.isfinite(scale) and not copy:
        raise TakeError(f"states a scale of {scale:g}", where=path, advice="export it again")
    scale = scale if scale and np.isfinite(scale) else copy or -1.0
    counts = counts_of(parameters)
    layouts = _layouts(words, (scale, copy), counts, parameters)
    layout = _choice(layouts, words, size)
    within = _is_within(layout, words, parameters)
    if within or not layout.agrees(_end(words, size, layout)):
        moved_layout = _behind_parameters(path, layouts[0], words, parameters, size)
        layout, within = (layout, within) if moved_layout is None else (moved_layout, False)
    if within and layout.points and layout.frames > 0:
        holds = ("which is before the first one", "which holds its header", "which holds its parameters")
        raise TakeError(
            f"states block {layout.start} as the first of its frames, {holds[min(layout.start, 2)]}", where=path,
            advice="export it again",
        )  # fmt: skip
    agrees = layout.agrees(_end(words, size, layout))
    doubts = [
        moved,
        *_doubts(words, layout, counts, parameters, path, agrees=agrees),
        _doubt_of_scales(scale, copy, layout, path, agrees=agrees),
    ]
    held = layout.held(_end(words, size, layout))
    lacking = None
    if layout.width and layout.frames > 0 and layout.start > 1:
        copied = counts.get(COUNTED, 0)
        if held < layout.frames:
            is_header = layout.frames == words.frames or layout.frames not in counts.values()
            who = "its header states" if is_header else "its parameters state"
            lacking = cut_off(max(held, 0), layout.frames, who, path)
        elif held < copied and not agrees and not is_word_of(copied, layout.frames):
            lacking = cut_off(held, copied, f"its parameter {COUNTED} states", path)
    if malformed and lacking is not None:
        raise lacking
    if malformed:
        raise TakeError(
            "is no C3D file that can be read (its parameters are malformed)", where=path, advice="export it again"
        ) from malformed
    if lacking is None:
        _refuse_a_long_file(words, layout, held, path)
    rate = words.rate if 0 < words.rate < FASTEST_RATE else None
    found = Header(
        words.processor, layout, scale, held, _end(words, size, layout), rate, "; ".join(filter(None, doubts)), lacking
    )  # fmt: skip
    return found, parameters


def cut_off(found: int, stated: int, who: str, path: Path) -> TakeError:
    """Return the error of a file that ends before the last frame that it states."""
    return TakeError(
        f"holds {found} of the {stated} frames that {who}", where=path,
        advice=FEWER_FRAMES,
    )  # fmt: skip


def _end(words: HeaderWords, size: int, layout: Layout) -> int:
    """Return the offset at which the frames must end, in a file of `size` bytes.

    Of several possible offsets of a section, the one next to the frames' own end counts.
    """
    ends = [at for at in words.behind if layout.data_at < at < size]
    own = layout.data_at + layout.frames * layout.width
    return min(ends, key=lambda at: abs(at - own), default=size)


def _layouts(
    words: HeaderWords, scales: tuple[float, float], counts: dict[str, int], parameters: Parameters
) -> list[Layout]:
    """Return the layouts that header and parameters state, those with the fewest departures from the header first.

    `scales`: by the header and by POINT:SCALE, 0 where it is not stated; negative for floats
    """
    begin = int(first_of(parameters.numbers("POINT", "DATA_START")))
    analogue = analogue_of(words, parameters)
    beyond = max((count for count in counts.values() if words.cannot_count(count)), default=0)
    frames = [beyond] if beyond else [*([words.frames] if words.frames > 0 else []), *counts.values()]
    if words.frames < 0:
        frames = [*frames, words.frames % WORD_VALUES]  # the last frame's number wraps round
    points = _distinct(words.points, points_of(parameters) or words.points)
    starts = _distinct(*[start for start in (words.start, begin) if start > 1]) or [words.start]
    kinds = list(dict.fromkeys(scale < 0 for scale in scales if scale))
    values = _distinct(words.analogue, analogue or words.analogue)
    stated = product(*map(enumerate, (points, _distinct(*frames) or [words.frames], starts, values)))
    found = [
        (kind + sum(place for place, _ in one), Layout(*(value for _, value in one), is_float=is_float))
        for one in stated for kind, is_float in enumerate(kinds)
    ]  # fmt: skip
    return [layout for _, layout in sorted(found, key=itemgetter(0))]


def _distinct(*numbers: int) -> list[int]:
    return list(dict.fromkeys(numbers))


def _choice(layouts: list[Layout], words: HeaderWords, size: int) -> Layout:
    """Return the first layout that agrees with a file of `size` bytes; else the header's, where there is room."""
    for layout in layouts:
        if layout.agrees(_end(words, size, layout)):
            return layout
    moved = (replace(layouts[0], start=layout.start) for layout in layouts)
    return next((one for one in moved if one.held(_end(words, size, one)) >= one.frames), layouts[0])


def _is_within(layout: Layout, words: HeaderWords, parameters: Parameters) -> bool:
    """Return whether the frames would begin within the header or the parameters."""
    offset = layout.data_at - words.parameters_at
    return layout.start < 2 or (parameters.has("POINT") and 0 <= offset < parameters.end)


def _behind_parameters(
    path: Path, stated: Layout, words: HeaderWords, parameters: Parameters, size: int
) -> Layout | None:
    """Return the layout whose frames begin at the block behind the parameters; None if the file does not agree."""
    first = words.parameters_at // BLOCK_BYTES + 1
    for start in _distinct(first + words.parameter_blocks, first - (-parameters.end // BLOCK_BYTES)):
        layout = replace(stated, start=start)
        end = layout.data_at + layout.frames * layout.width
        if not parameters.has("POINT") or not layout.agrees(size) or _is_within(layout, words, parameters):
            continue
        with path.open("rb") as file:
            file.seek(layout.data_at)
            before = file.read(max(stated.data_at - layout.data_at, 0))
            file.seek(end)
            if _are_frames(before, file.read(BLOCK_BYTES), words, is_float=layout.is_float):
                return layout
    return None


def _are_frames(before: bytes, behind: bytes, words: HeaderWords, *, is_float: bool) -> bool:
    """Return whether bytes before the stated block are of frames, and those behind the last frame zeros.

    Otherwise the stated block may be true, and the file cut off by as many bytes as stand before it.
    """
    blocks = [before[at : at + BLOCK_BYTES] for at in range(0, len(before), BLOCK_BYTES)]
    if any(behind) or not all(map(any, blocks)):
        return False
    if is_float:
        return bool((np.abs(numbers_of(before, FLOAT, words.processor)) <= SENSIBLE[1]).all())
    return bool(behind) or not before


def _doubts(
    words: HeaderWords, layout: Layout, counts: dict[str, int], parameters: Parameters, path: Path, *, agrees: bool
) -> Iterator[str]:
    """Yield warnings of parameters that contradict the header, with what was read.

    Raises:
        TakeError: the numbers of points or analogue values differ, and the file's size agrees with neither.
    """
    for name, count in counts.items():
        differs = count != words.frames and not words.cannot_count(count)
        if differs and (layout.frames == count or (name == COUNTED and not is_word_of(count, layout.frames))):
            yield (
                f"its header states frames {words.first} to {words.last}, and its parameter {name} {count} frames; "
                f"{layout.frames} were read"
            )
            break
    begin = int(first_of(parameters.numbers("POINT", "DATA_START")))
    if words.start and begin > 1 and begin != words.start:
        yield (
            f"its header and its parameter POINT:DATA_START state blocks {words.start} and {begin} as the first of "
            f"its frames; the frames were read from block {layout.start}"
        )
    elif layout.start != words.start:
        yield (
            f"its header states block {words.start} as the first of its frames; the frames fill the file from block "
            f"{layout.start} on, and were read from there"
        )
    if (used := points_of(parameters)) not in (None, words.points):
        told = f"its header states {words.points} points, and its parameter POINT:USED {used}"
        if not agrees:
            raise TakeError(f"{told}, and its size agrees with neither", where=path, advice="export it again")
        yield f"{told}; {layout.points} were read"
    channels = analogue_of(words, parameters)
    told = f"its header states {words.analogue} analogue values a frame, and its parameters {channels}"
    if layout.analogue != words.analogue:
        yield f"{told}, with which its size agrees"
    elif channels not in (0, words.analogue) and not agrees:
        raise TakeError(f"{told}, and its size agrees with neither", where=path, advice="export it again")


def _doubt_of_scales(scale: float, copy: float, layout: Layout, path: Path, *, agrees: bool) -> str:
    """Return a warning of two scales of which one is for floats, '' without them.

    `scale`, `copy`: by the header and by POINT:SCALE, 0 where it is not stated; for floats only the sign counts

    Raises:
        TakeError: either may be the true one.
    """
    has_two_kinds = bool(copy) and (copy < 0) is not (scale < 0)
    are_two = not layout.is_float and bool(copy) and abs(abs(copy / scale) - 1) >= SAME_SCALE
    told = f"its header states a scale of {scale:g}, its parameter POINT:SCALE {copy:g}"
    if are_two or (has_two_kinds and not agrees):
        raise TakeError(told, where=path, advice="export it again")
    return f"{told}; its numbers were read as {'floats' if layout.is_float else 'integers'}" if has_two_kinds else ""


def _refuse_a_long_file(words: HeaderWords, layout: Layout, held: int, path: Path) -> None:
    """Refuse a file that may hold more frames than its header can state, if some were not read."""
    is_at_its_most = words.last == MOST_STATED_FRAMES and words.first <= 1
    # The last block's rest may look like frames, of a 16-bit point each.
    rest, more = BLOCK_BYTES // 8, held - layout.frames
    has_wrapped = more >= WORD_VALUES and more % WORD_VALUES <= rest
    if has_wrapped or (is_at_its_most and more > rest):
        raise TakeError(
            f"has room for {held} frames and states {layout.frames}: its header counts no further", where=path,
            advice="export it in shorter parts, or as text",
        )  # fmt: skip
