"""Find the parameters of a C3D file whose header points to no parameters, or to a stale copy of them.

Programs that rewrite the parameters may leave the old ones in their blocks, or an old block number in the header. So
all blocks before the frames are searched where the stated block holds none, or some that contradict the header. Other
parameters count instead if nothing in them contradicts it.

A program may also state a byte order and write in another one. The stated order does not hold if it makes the copies
differ, or the frame rate or the scale a number that no file has. The order that makes all of them agree counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from formats.errors import TakeError
from formats.importers.c3d_blocks import BLOCK_BYTES
from formats.importers.c3d_header import (
    COUNTED,
    SENSIBLE,
    HeaderWords,
    counts_of,
    first_of,
    is_word_of,
    read_parameters,
    read_words,
)
from formats.importers.c3d_parameters import DEC, INTEL, SGI, NoParametersError, Parameters

MOST_SEARCHED = 600  # blocks; our choice: two sections of 255 blocks, which one byte can count, and some more
SAME_RATE = 1e-3  # relative difference: programs round 59.94 and 69.99
MAKERS = {INTEL: "Intel", DEC: "DEC", SGI: "SGI"}  # of the processors, for warnings

Section = tuple[HeaderWords, Parameters, NoParametersError | None]


def find_parameters(path: Path) -> tuple[Section, str]:
    """Return a file's header and parameters, and a warning where they are not those at the stated block.

    Raises:
        TakeError: the file is no C3D file, or holds no parameters.
    """
    words = read_words(path)
    parameters, malformed = read_parameters(path, words)
    if (reordered := _in_another_order(path, words, parameters)) is not None:
        stated, own = (MAKERS.get(one.processor) for one in (words, reordered[0]))
        told = f"state the byte order of {stated}" if stated else "state no byte order"
        return reordered, f"its parameters {told}, and its numbers agree in that of {own}, which was used"
    block = words.parameters_at // BLOCK_BYTES + 1
    is_there = words.processor in (INTEL, DEC, SGI)
    if (is_there and malformed is not None) or (parameters.has("POINT") and not _contradicts(words, parameters)):
        return (words, parameters, malformed), ""
    other = next((one for one in _others(path, words) if not _contradicts(*one[:2])), None)
    told = f"its header states block {block} as the first of its parameters"
    if other is not None:
        begin = other[0].parameters_at // BLOCK_BYTES + 1
        why = "which contradict it; those from" if is_there else "where there are none; those from"
        return other, f"{told}, {why} block {begin} agree with it and were read"
    if not is_there and words.points and not parameters.has("POINT"):
        raise TakeError(f"{told}, where there are none", where=path, advice="export it again")
    return (words, parameters, malformed), ""


def _in_another_order(path: Path, words: HeaderWords, parameters: Parameters) -> Section | None:
    """Return header and parameters in the byte order in which they agree; None where they do in the stated one."""
    if _is_sensible(words, parameters):
        return None
    for processor in MAKERS:
        found = read_words(path, words.parameters_at, processor)
        read, malformed = read_parameters(path, found)
        if processor != words.processor and malformed is None and _is_sensible(found, read):
            return found, read, None
    return None


def _is_sensible(words: HeaderWords, parameters: Parameters) -> bool:
    """Return whether header and parameters agree, and state sizes of frame rate and scale that files have."""
    copies = (first_of(parameters.numbers("POINT", name)) for name in ("RATE", "SCALE"))
    floats = [number for number in (words.rate, words.scale, *copies) if number]
    least, most = SENSIBLE
    return (
        parameters.has("POINT") and not _contradicts(words, parameters)
        and all(least <= abs(number) <= most for number in floats)
    )  # fmt: skip


def _others(path: Path, words: HeaderWords) -> Iterator[Section]:
    """Yield the header and the parameters as they are with each other section before the frames."""
    size = path.stat().st_size
    with path.open("rb") as file:
        front = file.read(min(size, MOST_SEARCHED * BLOCK_BYTES))
    for begin in range(BLOCK_BYTES, len(front), BLOCK_BYTES):
        if begin == words.parameters_at or front[begin + 3 : begin + 4] not in (b"T", b"U", b"V"):  # 84 to 86
            continue
        found = read_words(path, begin)
        parameters, malformed = read_parameters(path, found)
        if begin < BLOCK_BYTES * (found.start - 1) and parameters.has("POINT"):
            yield found, parameters, malformed


def _contradicts(words: HeaderWords, parameters: Parameters) -> bool:
    """Return whether parameters state other points, frames, block of the frames or frame rate than the header."""
    used, begin, rate = (first_of(parameters.numbers("POINT", name)) for name in ("USED", "DATA_START", "RATE"))
    frames = counts_of(parameters).get(COUNTED, words.frames)
    has_other_rate = rate > 0 and words.rate > 0 and abs(rate - words.rate) > SAME_RATE * words.rate
    return used != words.points or begin != words.start or not is_word_of(frames, words.frames) or has_other_rate
