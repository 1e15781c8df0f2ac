"""Bytes that a C3D file has lost are found by its size, and blocks of zeros in its frames are gaps."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.c3d_file import read_c3d
from tests.formats.c3d_by_hand import c3d_bytes

FRAMES = 61


def places(points=4):
    """Markers that swing [mm], 64 bytes a frame of floats and 32 of 16 bits."""
    angle = np.arange(FRAMES)[:, None, None] / 9
    return np.array([300.0, -145, 1205]) + 100 * np.arange(points)[:, None] + 30 * np.sin(angle + np.arange(3))


def begin_of(raw):
    return 512 * (struct.unpack_from("<H", raw, 16)[0] - 1)


def read(tmp_path, raw):
    (tmp_path / "a.c3d").write_bytes(raw)
    return read_c3d(tmp_path / "a.c3d", None)


@pytest.mark.parametrize("scale", [-1.0, 0.05])
@pytest.mark.parametrize("lost", [1, 2, 16, 95])
def test_a_file_that_lost_bytes_of_its_last_block_is_refused(tmp_path, scale, lost):
    """So many bytes less in the middle shift every frame behind them; the last block has room for them."""
    raw = c3d_bytes(places(), list("abcd"), scale=scale)
    end = begin_of(raw) + FRAMES * (64 if scale < 0 else 32)
    at = begin_of(raw) + 640
    size = len(raw) - lost
    words = f"has {size} bytes, which is no multiple of 512, and its frames end at {end}: bytes are lost; copy or"
    assert end < size
    with pytest.raises(TakeError, match=words):
        read(tmp_path, raw[:at] + raw[at + lost :])


@pytest.mark.parametrize("scale", [-1.0, 0.05])
def test_a_file_may_end_with_its_last_frame_or_a_block_or_far_behind(tmp_path, scale):
    raw = c3d_bytes(places(), list("abcd"), scale=scale)
    end = begin_of(raw) + FRAMES * (64 if scale < 0 else 32)
    for whole in (raw, raw[:end], raw + bytes(512), raw + b"\1" * 700):
        np.testing.assert_allclose(read(tmp_path, whole).positions, places() / 1e3, atol=3e-5)


@pytest.mark.parametrize(
    ("scale", "analogue", "block", "frames", "partly"),
    [(-1.0, 0, 2, (16, 23), ()), (0.05, 0, 2, (32, 47), ()), (-1.0, 3, 2, (13, 20), (13, 20))],
)
def test_markers_in_a_block_of_zeros_are_gaps(tmp_path, scale, analogue, block, frames, partly):
    """512 bytes are 8 frames of 4 floats for each of 4 markers, or 16 of half the size; with 3 others a frame has 76.

    Bytes 1024 to 1536 then begin within c in frame 13, 36 bytes behind its start, and end behind a in frame 20.
    """
    raw = bytearray(c3d_bytes(places(), list("abcd"), scale=scale, analogue=analogue))
    begin = begin_of(raw) + 512 * block
    raw[begin : begin + 512] = bytes(512)
    found = read(tmp_path, bytes(raw))
    first, last = frames
    told = f"frames {first + 1} to {last + 1} hold 1 block of 512 zero bytes, and markers in them count as not seen"
    assert found.doubt == told
    gone = np.isnan(found.positions).any(2)
    assert np.flatnonzero(gone.any(1)).tolist() == list(range(first, last + 1))
    assert gone.sum() == (32 if scale < 0 and not analogue else 64 if not analogue else 27)
    if partly:
        assert gone[list(partly)].tolist() == [[False, False, True, True], [True, False, False, False]]
    np.testing.assert_allclose(found.positions[~gone], places()[~gone] / 1e3, atol=3e-5)


def test_zeros_at_either_end_and_many_gaps_of_zeros_are_told_by_no_sentence(tmp_path):
    raw = c3d_bytes(places(), list("abcd"))
    for block in (0, 7):
        ends = bytearray(raw)
        begin = begin_of(raw) + 512 * block
        ends[begin : begin + 512] = bytes(512)
        assert read(tmp_path, bytes(ends)).doubt == ""
    many = bytearray(c3d_bytes(np.tile(places(), (2, 1, 1)), list("abcd")))
    for block in (1, 3, 5, 7):
        begin = begin_of(raw) + 512 * block
        many[begin : begin + 512] = bytes(512)
    assert read(tmp_path, bytes(many)).doubt == ""
