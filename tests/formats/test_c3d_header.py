"""The words of a C3D header and the counts of its parameters are read exactly, in each byte order."""

from __future__ import annotations

import dataclasses
import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.c3d_header import (
    HeaderWords,
    _of_two_words,
    analogue_of,
    counts_of,
    first_of,
    is_word_of,
    read_parameters,
    read_words,
)
from tests.formats.c3d_by_hand import PROCESSORS, c3d_bytes

SHORT, FLOAT = 2, 4  # kinds of parameters, C3D user guide
TRIAL, ANALOG = 2, 3  # groups of `c3d_by_hand`
PLACES = np.arange(4 * 2 * 3).reshape(4, 2, 3) + 1.0


def words(first, last, **changes):
    """The words of a header that says this first and last frame."""
    found = HeaderWords(2, 0, first, last, 3, -1.0, 100.0, PROCESSORS["intel"], 512, 1, (512,))
    return dataclasses.replace(found, **changes)


@pytest.mark.parametrize("processor", PROCESSORS)
def test_the_words_of_a_header_are_those_that_were_written(tmp_path, processor):
    path = tmp_path / "a.c3d"
    path.write_bytes(
        c3d_bytes(
            PLACES, ["a", "b"], processor=processor, analogue=6, header={"first": 300, "rate": 59.5, "scale": -0.25}
        )
    )
    found = read_words(path)
    assert found == HeaderWords(2, 6, 300, 303, 3, -0.25, 59.5, PROCESSORS[processor], 512, 1, (512,))
    assert found.frames == 4
    assert read_words(path, 512, PROCESSORS["intel"]).points == (2 if processor != "sgi" else 512)
    assert read_words(path, 1024).parameters_at == 1024


@pytest.mark.parametrize(
    ("head", "advice"),
    [
        (b"", "export it again"),
        (b"\2\x50" + bytes(509), "export it again"), (b"\2\x51" + bytes(510), "export it again"),
        (b"\0\x50" + bytes(510), "export it again"), (b"\2\x50" + bytes(510), ""),
        (b"Time,X,Y\r\n\t1.5" * 40, "the file is text: give it the ending .trc, .csv or .tsv"),
        (b"Time", "the file is text: give it the ending .trc, .csv or .tsv"), (b"Time\0" * 110, "export it again"),
    ],
)  # fmt: skip
def test_a_file_without_a_header_is_refused(tmp_path, head, advice):
    path = tmp_path / "a.c3d"
    path.write_bytes(head)
    if not advice:
        found = read_words(path)
        assert (found.points, found.processor, found.parameter_blocks, found.parameters_at) == (0, 0, 0, 512)
        return
    with pytest.raises(TakeError) as refused:
        read_words(path)
    says = "is no C3D file that can be read (the file lacks a C3D header)"
    assert str(refused.value) == f"{path}: {says}; {advice}"


@pytest.mark.parametrize(
    ("first", "last", "frames", "cannot"),
    [
        (1, 10, 10, False), (1, 10, 11, False), (1, 10, 65546, True), (1, 10, 131082, True), (1, 10, 65545, False),
        (1, 65535, 65535, False), (1, 65535, 65536, True), (1, 65534, 65535, False), (101, 65535, 65436, True),
        (101, 65535, 65435, False), (65527, 0, 65546, True), (1, 0, 65536, True), (1, 0, 0, False),
        (1, 65535, 9, False),
    ],
)  # fmt: skip
def test_a_header_cannot_count_frames_beyond_its_16_bits(first, last, frames, cannot):
    assert words(first, last).frames == last - first + 1
    assert words(first, last).cannot_count(frames) is cannot


@pytest.mark.parametrize(
    ("word", "frames", "is_of"),
    [
        (4, 4, True), (4, 5, False), (4, 65540, True), (65535, 70000, True), (65535, 3, True), (0, 65536, True),
        (1, 0, False),
    ],
)  # fmt: skip
def test_a_word_counts_frames_that_wrap_round_or_clip_it(word, frames, is_of):
    assert is_word_of(word, frames) is is_of


@pytest.mark.parametrize(
    ("low", "high", "count"),
    [
        (5, 0, 5), (5, 1, 65541), (-1, 0, 65535), (-1, -1, 2**32 - 1), (0, 2, 131072), (np.nan, 1, 65536),
        (np.inf, 1, 65536), (7, -np.inf, 7),
    ],
)  # fmt: skip
def test_two_words_make_one_number_the_lower_first(low, high, count):
    assert _of_two_words(np.array([low, high], float)) == count


def test_the_first_finite_number_counts():
    assert first_of(np.array([np.nan, np.inf, 2.5, 3.0])) == 2.5
    assert first_of(np.array([np.nan])) == first_of(np.array([])) == 0.0


def parameters(tmp_path, *more, **changes):
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_bytes(PLACES, ["a", "b"], more=more, **changes))
    header = read_words(path)
    found, error = read_parameters(path, header)
    assert error is None
    return header, found


def two(low, high):
    return struct.pack("<HH", low, high), SHORT, [2]


@pytest.mark.parametrize(
    ("more", "said", "counts"),
    [
        ((), 4, {"POINT:FRAMES": 4}),
        ((), 40000, {"POINT:FRAMES": 40000}),
        ((("LONG_FRAMES", struct.pack("<f", 70000.0), FLOAT, []),), 4, {"POINT:FRAMES": 4, "POINT:LONG_FRAMES": 70000}),
        ((("LONG_FRAMES", *two(4464, 1)),), 4, {"POINT:FRAMES": 4, "POINT:LONG_FRAMES": 70000}),
        (
            (("ACTUAL_START_FIELD", *two(10, 1), TRIAL), ("ACTUAL_END_FIELD", *two(9, 2), TRIAL)), 4,
            {"POINT:FRAMES": 4, "TRIAL:ACTUAL_END_FIELD": 65536},
        ),
        ((("ACTUAL_START_FIELD", *two(10, 0), TRIAL), ("ACTUAL_END_FIELD", *two(9, 0), TRIAL)), 4, {"POINT:FRAMES": 4}),
        ((("ACTUAL_START_FIELD", *two(1, 0), TRIAL), ("ACTUAL_END_FIELD", *two(1, 0), TRIAL)), 4,
         {"POINT:FRAMES": 4, "TRIAL:ACTUAL_END_FIELD": 1}),
        ((("ACTUAL_END_FIELD", *two(9, 0), TRIAL),), 4, {"POINT:FRAMES": 4}),
        ((("ACTUAL_START_FIELD", *two(1, 0), TRIAL), ("ACTUAL_END_FIELD", struct.pack("<H", 9), SHORT, [], TRIAL)), 4,
         {"POINT:FRAMES": 4}),
    ],
)  # fmt: skip
def test_the_frames_are_counted_by_each_parameter_that_states_them(tmp_path, more, said, counts):
    assert counts_of(parameters(tmp_path, *more, frames_said=said)[1]) == counts


@pytest.mark.parametrize(
    ("used", "analogue_rate", "rate", "in_header", "count"),
    [
        (3, 1000.0, 100.0, 100.0, 30),
        (3, 100.0, 100.0, 100.0, 3), (3, 0.0, 100.0, 100.0, 3),
        (0, 1000.0, 100.0, 100.0, 0),
        (-2, 1000.0, 100.0, 100.0, 0),
        (3, 1000.0, None, 50.0, 60), (3, 1000.0, 0.0, 50.0, 60), (3, 1000.0, None, 0.0, 0),
        (3, 1240.0, 100.0, 1.0, 36), (3, 1000.0, -1.0, 50.0, 0), (2, 1.0, 1e-4, 1.0, 2000),
    ],
)  # fmt: skip
def test_analogue_values_a_frame_are_those_of_all_channels(tmp_path, used, analogue_rate, rate, in_header, count):
    more = (
        ("USED", struct.pack("<h", used), SHORT, [], ANALOG),
        ("RATE", struct.pack("<f", analogue_rate), FLOAT, [], ANALOG),
    )
    header, found = parameters(tmp_path, *more, rate=rate, header={"rate": in_header})
    assert analogue_of(header, found) == count
