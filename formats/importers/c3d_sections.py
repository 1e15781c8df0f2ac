"""Find the parameters of a C3D file whose header points to no parameters, or to a stale copy of them.

Programs that rewrite the parameters may leave the old ones in their blocks, or an old block number in the header. So
all blocks before the frames are searched where the stated block holds none, or some that contradict the header. Other
parameters count instead if nothing in them contradicts it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from formats.errors import TakeError
from formats.importers.c3d_blocks import BLOCK_BYTES
from formats.importers.c3d_header import (
    COUNTED,
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

Section = tuple[HeaderWords, Parameters, NoParametersError | None]


def find_parameters(path: Path) -> tuple[Section, str]:
    """Return a file's header and parameters, and a warning where they are not those at the stated block.

    Raises:
        TakeError: the file is no C3D file, or holds no parameters.
    """
    words = read_words(path)
    parameters, malformed = read_parameters(path, words)
    stated = words.parameters_at // BLOCK_BYTES + 1
    is_there = words.processor in (INTEL, DEC, SGI)
    if (is_there and malformed is not None) or (parameters.has("POINT") and not _contradicts(words, parameters)):
        return (words, parameters, malformed), ""
    other = next((one for one in _others(path, words) if not _contradicts(*one[:2])), None)
    told = f"its header states block {stated} as the first of its parameters"
    if other is not None:
        begin = other[0].parameters_at // BLOCK_BYTES + 1
        why = "which contradict it; those from" if is_there else "where there are none; those from"
        return other, f"{told}, {why} block {begin} agree with it and were read"
    if not is_there and words.points and not parameters.has("POINT"):
        raise TakeError(f"{told}, where there are none", where=path, advice="export it again")
    return (words, parameters, malformed), ""


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
