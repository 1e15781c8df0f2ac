"""Read the header of a C3D file, and decide which of contradicting statements counts by the file's size.

The header's words, counted from 1, are:

- 2 and 3: numbers of points and of analogue values a frame
- 4 and 5: first and last frame
- 7 and 8: scale, negative where the data are floats
- 9: block of 512 bytes at which the data begin
- 11 and 12: frame rate, a float

Parameters repeat all of them. Where the two differ, several layouts of the frames are possible:

    bytes of a frame  =  (4 points + analogue values) x (4 for floats, 2 for integers)

A layout agrees with the size if its frames end less than a block or a frame before the file's end. The first layout
that agrees counts, and the layouts with the fewest departures from the header come first.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass, replace
from itertools import product
from operator import itemgetter
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.importers.c3d_blocks import BLOCK_BYTES
from formats.importers.c3d_parameters import FLOAT, SGI, NoParametersError, Parameters, numbers_of

TEXT_BYTES = bytes(range(32, 256)) + b"\t\r\n"  # bytes of text without zeros
C3D_KEY = 0x50  # second byte of every C3D file
FASTEST_RATE = 10_000.0  # frames a second
LEAST_RATE = 1e-3  # frames a second, so that quotients are finite
WORDS = 1 << 16  # numbers that a word of 16 bits can state
MOST_FRAMES = WORDS - 1  # that the header can state
LARGEST_SECTION = 1 << 24  # bytes of parameters
COUNTED = "POINT:FRAMES"
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
    """

    processor: int
    layout: Layout
    scale: float
    held: int
    end: int
    rate: float | None
    doubts: str


@dataclass(frozen=True)
class _Words:
    """The words of a header as they stand in the file, and the parameters' processor and offset [bytes].

    `behind` [bytes]: possible offsets of the parameters and of rotations, which may stand behind the frames
    """

    points: int
    analogue: int
    first: int
    last: int
    start: int
    scale: float
    rate: float
    processor: int
    parameters_at: int
    behind: tuple[int, ...]

    @property
    def frames(self) -> int:
        """Number of frames, 0 or less where the last lies before the first."""
        return self.last - self.first + 1

    def cannot_count(self, frames: int) -> bool:
        """Return whether the header's 16 bits are clipped or have wrapped round, and so many frames are the count."""
        has_wrapped = frames > MOST_FRAMES and (frames - self.frames) % WORDS == 0
        return has_wrapped or (self.last == MOST_FRAMES and frames > self.frames)

    def end(self, size: int, layout: Layout) -> int:
        """Return the offset at which the frames must end, in a file of `size` bytes.

        Of several possible offsets of a section, the one next to the frames' own end counts.
        """
        ends = [at for at in self.behind if layout.data_at < at < size]
        own = layout.data_at + layout.frames * layout.width
        return min(ends, key=lambda at: abs(at - own), default=size)


def read_header(path: Path, size: int) -> tuple[Header, Parameters]:
    """Return the header and the parameters of a file of `size` bytes.

    Raises:
        TakeError: the file is no C3D file, is malformed, ends before its last frame, or contradicts itself so that its
            size cannot decide.
    """
    words = _words(path)
    parameters, malformed = _parameters(path, words)
    rotations, start = (int(first_of(parameters.numbers("ROTATION", name))) for name in ("USED", "DATA_START"))
    if rotations > 0 and start % WORDS > 1:  # some programs state a section of no rotations
        first = BLOCK_BYTES * (start % WORDS - 1)  # the word of a block wraps round in large files
        words = replace(words, behind=(*words.behind, *range(first, size, WORDS * BLOCK_BYTES)))
    scale, copy = words.scale, first_of(parameters.numbers("POINT", "SCALE"))
    if not np.isfinite(scale) and not copy:
        raise TakeError(f"states a scale of {scale:g}", where=path, advice="export it again")
    scale = scale if scale and np.isfinite(scale) else copy or -1.0
    counts = _counts(parameters)
    layouts = _layouts(words, (scale, copy), counts, parameters)
    layout = _choice(layouts, words, size)
    agrees = layout.agrees(words.end(size, layout))
    doubts = [
        *_doubts(words, layout, counts, parameters, path, agrees=agrees),
        _doubt_of_scales(scale, copy, layout, path, agrees=agrees),
    ]
    held = layout.held(words.end(size, layout))
    if layout.width and layout.frames > 0 and layout.start > 1:
        copied = counts.get(COUNTED, 0)
        if held < layout.frames:
            who = "its header states" if layout.frames == words.frames else "its parameters state"
            raise cut_off(max(held, 0), layout.frames, who, path)
        if held < copied and not agrees and not _is_word_of(copied, layout.frames):
            raise cut_off(held, copied, f"its parameter {COUNTED} states", path)
    if malformed:
        raise TakeError(
            "is no C3D file that can be read (its parameters are malformed)", where=path, advice="export it again"
        ) from malformed
    _refuse_a_long_file(words, layout, held, path)
    rate = words.rate if 0 < words.rate < FASTEST_RATE else None
    found = Header(
        words.processor, layout, scale, held, words.end(size, layout), rate, "; ".join(filter(None, doubts))
    )  # fmt: skip
    return found, parameters


def cut_off(found: int, stated: int, who: str, path: Path) -> TakeError:
    """Return the error of a file that ends before its last frame."""
    return TakeError(
        f"holds {found} of the {stated} frames that {who}", where=path,
        advice="it is cut off: copy or export it again",
    )  # fmt: skip


def first_of(numbers: Floats) -> float:
    """Return the first finite number, 0 where there is none."""
    return next((float(number) for number in numbers if np.isfinite(number)), 0.0)


def _words(path: Path) -> _Words:
    with path.open("rb") as file:
        head = file.read(BLOCK_BYTES)
        if len(head) < BLOCK_BYTES or head[1] != C3D_KEY or not head[0]:
            is_text = bool(head) and not head.translate(None, TEXT_BYTES)
            advice = "it is text: give it the ending .trc, .csv or .tsv" if is_text else "export it again"
            raise TakeError("is no C3D file that can be read (it lacks a C3D header)", where=path, advice=advice)
        parameters_at = BLOCK_BYTES * (head[0] - 1)
        file.seek(parameters_at + 3)
        processor = (file.read(1) or b"\0")[0]
    order = ">" if processor == SGI else "<"
    points, analogue, first, last = struct.unpack_from(f"{order}HHHH", head, 2)
    start = struct.unpack_from(f"{order}H", head, 16)[0]
    scale, rate = (float(numbers_of(head[at : at + 4], FLOAT, processor)[0]) for at in (12, 20))
    return _Words(points, analogue, first, last, start, scale, rate, processor, parameters_at, (parameters_at,))


def _parameters(path: Path, words: _Words) -> tuple[Parameters, NoParametersError | None]:
    """Return the parameters of a file, none with the error where they are malformed.

    Their section may be longer than it states.
    """
    begin = words.parameters_at
    with path.open("rb") as file:
        file.seek(begin + 2)
        blocks = (file.read(1) or b"\0")[0]
        file.seek(begin)
        until = BLOCK_BYTES * (words.start - 1) - begin
        section = file.read(min(max(BLOCK_BYTES * blocks, until, 0), LARGEST_SECTION))
    try:
        return Parameters(section), None
    except NoParametersError as error:
        return Parameters(b""), error


def _counts(parameters: Parameters) -> dict[str, int]:
    """Return the numbers of frames by the parameters, by name.

    TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD hold two words of 16 bits, the lower first. POINT:LONG_FRAMES is a
    float, or two words as well. POINT:FRAMES is a word, or a float beyond 65535.

    Source: the C3D file format, user guide.
    """
    frames = int(first_of(parameters.numbers("POINT", "FRAMES")))
    long = parameters.numbers("POINT", "LONG_FRAMES")
    found = {
        COUNTED: frames + WORDS if frames < 0 else frames,
        "POINT:LONG_FRAMES": _of_two_words(long) if len(long) == 2 else int(first_of(long)),
    }
    begin, end = (parameters.numbers("TRIAL", f"ACTUAL_{which}_FIELD") for which in ("START", "END"))
    if len(begin) == len(end) == 2:
        found["TRIAL:ACTUAL_END_FIELD"] = _of_two_words(end) - _of_two_words(begin) + 1
    return {name: count for name, count in found.items() if count > 0}


def _of_two_words(words: Floats) -> int:
    low, high = (int(word) % WORDS for word in np.nan_to_num(words, posinf=0.0, neginf=0.0))
    return low + WORDS * high


def _is_word_of(word: int, frames: int) -> bool:
    """Return whether a word of 16 bits, which may be clipped or have wrapped round, states a number of frames."""
    return word == MOST_FRAMES or (word - frames) % WORDS == 0


def _layouts(
    words: _Words, scales: tuple[float, float], counts: dict[str, int], parameters: Parameters
) -> list[Layout]:
    """Return the layouts that header and parameters state, those with the fewest departures from the header first.

    `scales`: by the header and by POINT:SCALE, 0 where it is not stated; negative for floats
    """
    used, begin = (int(first_of(parameters.numbers("POINT", name))) for name in ("USED", "DATA_START"))
    analogue = _analogue(words, parameters)
    beyond = max((count for count in counts.values() if words.cannot_count(count)), default=0)
    frames = [beyond] if beyond else [*([words.frames] if words.frames > 0 else []), *counts.values()]
    points = _distinct(words.points, max(used, 0) or words.points)
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


def _analogue(words: _Words, parameters: Parameters) -> int:
    """Return the number of analogue values a frame by the parameters, 0 where they state none."""
    channels, analogue_rate = (first_of(parameters.numbers("ANALOG", name)) for name in ("USED", "RATE"))
    rate = first_of(parameters.numbers("POINT", "RATE")) or words.rate
    each = round(max(analogue_rate / max(rate, LEAST_RATE), 1.0)) if rate > 0 else 0
    return max(int(channels), 0) * each


def _choice(layouts: list[Layout], words: _Words, size: int) -> Layout:
    """Return the first layout that agrees with a file of `size` bytes; else the header's, where there is room."""
    for layout in layouts:
        if layout.agrees(words.end(size, layout)):
            return layout
    moved = (replace(layouts[0], start=layout.start) for layout in layouts)
    return next((one for one in moved if one.held(words.end(size, one)) >= one.frames), layouts[0])


def _doubts(
    words: _Words, layout: Layout, counts: dict[str, int], parameters: Parameters, path: Path, *, agrees: bool
) -> Iterator[str]:
    """Yield warnings of parameters that contradict the header, with what was read.

    Raises:
        TakeError: the numbers of points or analogue values differ, and the file's size agrees with neither.
    """
    for name, count in counts.items():
        differs = count != words.frames and not words.cannot_count(count)
        if differs and (layout.frames == count or (name == COUNTED and not _is_word_of(count, layout.frames))):
            yield (
                f"its header states frames {words.first} to {words.last}, and its parameter {name} {count} frames; "
                f"{layout.frames} were read"
            )
            break
    begin = int(first_of(parameters.numbers("POINT", "DATA_START")))
    if words.start and begin > 1 and begin != words.start:
        yield (
            f"its header and its parameter POINT:DATA_START state blocks {words.start} and {begin} as the first of "
            f"its frames; they were read from block {layout.start}"
        )
    used = parameters.numbers("POINT", "USED")
    if len(used) and (count := int(first_of(used))) != words.points:
        told = f"its header states {words.points} points, and its parameter POINT:USED {count}"
        if not agrees:
            raise TakeError(f"{told}, and its size agrees with neither", where=path, advice="export it again")
        yield f"{told}; {layout.points} were read"
    channels = _analogue(words, parameters)
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


def _refuse_a_long_file(words: _Words, layout: Layout, held: int, path: Path) -> None:
    """Refuse a file that may hold more frames than its header can state, if some were not read."""
    is_at_its_most = words.last == MOST_FRAMES and words.first <= 1
    # The last block's rest may look like frames, of a 16-bit point each.
    if is_at_its_most and held > layout.frames + BLOCK_BYTES // 8:
        raise TakeError(
            f"has room for {held} frames and states {layout.frames}: its header counts no further", where=path,
            advice="export it in shorter parts, or as text",
        )  # fmt: skip
