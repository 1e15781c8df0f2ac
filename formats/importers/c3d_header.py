"""Read the header of a C3D file, and the copies of its words among the parameters.

The header's words, counted from 1, are:

- 2 and 3: numbers of points and of analogue values a frame
- 4 and 5: first and last frame
- 7 and 8: scale, negative where the data are floats
- 9: block of 512 bytes at which the data begin
- 11 and 12: frame rate, a float

`c3d_layout` decides where the copies differ.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.importers.c3d_blocks import BLOCK_BYTES
from formats.importers.c3d_parameters import FLOAT, SGI, NoParametersError, Parameters, numbers_of

TEXT_BYTES = bytes(range(32, 256)) + b"\t\r\n"  # bytes of text without zeros
C3D_KEY = 0x50  # second byte of every C3D file; C3D user guide
LEAST_RATE = 1e-3  # frames a second, so that quotients are finite
WORD_VALUES = 1 << 16  # numbers that a word of 16 bits can state
MOST_STATED_FRAMES = WORD_VALUES - 1  # that the header can state
LARGEST_SECTION = 1 << 24  # bytes of parameters; our choice: 128 times the 255 blocks that one byte can state
# Size of a frame rate [1/s], a scale or a coordinate in the file's unit, which no other bytes show as a float. Our
# choice: scales are 1e-4 to 1, the number 100 of another byte order is 1e-40, and letters are 1e20.
SENSIBLE = (1e-6, 1e6)
COUNTED = "POINT:FRAMES"


@dataclass(frozen=True)
class HeaderWords:
    """The words of a header as they stand in the file, and the parameters' processor and offset [bytes].

    - `parameter_blocks`: number of blocks that the parameters state for themselves
    - `behind` [bytes]: possible offsets of the parameters and of rotations, which may stand behind the frames
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
    parameter_blocks: int
    behind: tuple[int, ...]

    @property
    def frames(self) -> int:
        """Number of frames, 0 or less where the last lies before the first, as beyond the frame 65535."""
        return self.last - self.first + 1

    def cannot_count(self, frames: int) -> bool:
        """Return whether the header's 16 bits are clipped or have wrapped round, and so many frames are the count."""
        may_have_wrapped = frames > MOST_STATED_FRAMES or self.frames < 0
        has_wrapped = may_have_wrapped and (frames - self.frames) % WORD_VALUES == 0
        return has_wrapped or (self.last == MOST_STATED_FRAMES and frames > self.frames)


def read_words(path: Path, parameters_at: int | None = None, processor: int | None = None) -> HeaderWords:
    """Return the words of a file's header, with other parameters than the header states where they are given.

    - `parameters_at` [bytes]: offset of the parameters, whose byte order is the header's as well
    - `processor`: code of the byte order, the one that the parameters state unless given

    Raises:
        TakeError: the file is no C3D file.
    """
    with path.open("rb") as file:
        head = file.read(BLOCK_BYTES)
        if len(head) < BLOCK_BYTES or head[1] != C3D_KEY or not head[0]:
            is_text = bool(head) and not head.translate(None, TEXT_BYTES)
            advice = "the file is text: give it the ending .trc, .csv or .tsv" if is_text else "export it again"
            raise TakeError("is no C3D file that can be read (the file lacks a C3D header)", where=path, advice=advice)
        parameters_at = BLOCK_BYTES * (head[0] - 1) if parameters_at is None else parameters_at
        file.seek(parameters_at + 2)
        blocks, stated = file.read(2).ljust(2, b"\0")
    processor = stated if processor is None else processor
    order = ">" if processor == SGI else "<"
    points, analogue, first, last = struct.unpack_from(f"{order}HHHH", head, 2)
    start = struct.unpack_from(f"{order}H", head, 16)[0]
    scale, rate = (float(numbers_of(head[at : at + 4], FLOAT, processor)[0]) for at in (12, 20))
    return HeaderWords(
        points, analogue, first, last, start, scale, rate, processor, parameters_at, blocks, (parameters_at,)
    )


def read_parameters(path: Path, words: HeaderWords) -> tuple[Parameters, NoParametersError | None]:
    """Return the parameters of a file, none with the error where they are malformed.

    Their section may be longer than it states.
    """
    begin, blocks = words.parameters_at, words.parameter_blocks
    with path.open("rb") as file:
        file.seek(begin)
        until = BLOCK_BYTES * (words.start - 1) - begin
        section = file.read(min(max(BLOCK_BYTES * blocks, until, 0), LARGEST_SECTION))
    try:
        return Parameters(section, words.processor), None
    except NoParametersError as error:
        return Parameters(b""), error


def first_of(numbers: Floats) -> float:
    """Return the first finite number, 0 where there is none."""
    return next((float(number) for number in numbers if np.isfinite(number)), 0.0)


def counts_of(parameters: Parameters) -> dict[str, int]:
    """Return the numbers of frames by the parameters, by name.

    TRIAL:ACTUAL_START_FIELD and ACTUAL_END_FIELD hold two words of 16 bits, the lower first. POINT:LONG_FRAMES is a
    float, or two words as well. POINT:FRAMES is a word, or a float beyond 65535.

    Source: the C3D file format, user guide.
    """
    frames = int(first_of(parameters.numbers("POINT", "FRAMES")))
    long = parameters.numbers("POINT", "LONG_FRAMES")
    found = {
        COUNTED: frames + WORD_VALUES if frames < 0 else frames,
        "POINT:LONG_FRAMES": _of_two_words(long) if len(long) == 2 else int(first_of(long)),
    }
    begin, end = (parameters.numbers("TRIAL", f"ACTUAL_{which}_FIELD") for which in ("START", "END"))
    if len(begin) == len(end) == 2:
        found["TRIAL:ACTUAL_END_FIELD"] = _of_two_words(end) - _of_two_words(begin) + 1
    return {name: count for name, count in found.items() if count > 0}


def _of_two_words(words: Floats) -> int:
    low, high = (int(word) % WORD_VALUES for word in np.nan_to_num(words))  # 0 of infinity, the largest number there
    return low + WORD_VALUES * high


def is_word_of(word: int, frames: int) -> bool:
    """Return whether a word of 16 bits, which may be clipped or have wrapped round, states a number of frames."""
    return word == MOST_STATED_FRAMES or (word - frames) % WORD_VALUES == 0


def points_of(parameters: Parameters) -> int | None:
    """Return the number of points by POINT:USED, a word without sign; None where the file lacks it."""
    used = parameters.numbers("POINT", "USED")
    return int(first_of(used)) % WORD_VALUES if len(used) else None


def analogue_of(words: HeaderWords, parameters: Parameters) -> int:
    """Return the number of analogue values a frame by the parameters, 0 where they state none."""
    channels, analogue_rate = (first_of(parameters.numbers("ANALOG", name)) for name in ("USED", "RATE"))
    rate = first_of(parameters.numbers("POINT", "RATE")) or words.rate
    each = round(max(analogue_rate / max(rate, LEAST_RATE), 1.0)) if rate > 0 else 0
    return max(int(channels), 0) * each
