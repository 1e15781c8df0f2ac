"""Bytes that a C3D file has lost are found by its size, and blocks of zeros in its frames are gaps."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers import c3d_doubled
from formats.importers.c3d_blocks import _spans
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


@pytest.mark.parametrize("lost", [1, 400])
def test_a_file_of_one_point_whose_size_is_no_multiple_of_a_block_is_refused(tmp_path, lost):
    """One point may turn into any direction, so that it shows no shift."""
    raw = c3d_bytes(places(1), ["a"])
    size, end = len(raw) - lost, begin_of(raw) + FRAMES * 16
    words = (
        f"has {size} bytes, which is no multiple of 512, and its frames end at {end}: bytes are lost or foreign; copy"
    )
    with pytest.raises(TakeError, match=words if end < size else "holds 39 of the 61 frames that its header states"):
        read(tmp_path, raw[: begin_of(raw) + 320] + raw[begin_of(raw) + 320 + lost :])


@pytest.mark.parametrize("scale", [-1.0, 0.05])
@pytest.mark.parametrize("lost", [1, 2, 16, 95])
def test_a_file_that_lost_bytes_of_its_last_block_is_refused(tmp_path, scale, lost):
    """So many bytes less in the middle shift every frame behind them; the last block has room for them."""
    width = 64 if scale < 0 else 32
    raw = c3d_bytes(places(), list("abcd"), scale=scale)
    at = begin_of(raw) + 640
    assert begin_of(raw) + FRAMES * width < len(raw) - lost
    more, less = width - lost % width, lost % width
    words = rf"shifted from about frame \d+ on: {more} foreign bytes? or {less} lost bytes? would shift"
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
    assert found.warning == told
    gone = np.isnan(found.positions).any(2)
    assert np.flatnonzero(gone.any(1)).tolist() == list(range(first, last + 1))
    assert gone.sum() == (32 if scale < 0 and not analogue else 64 if not analogue else 27)
    if partly:
        assert gone[list(partly)].tolist() == [[False, False, True, True], [True, False, False, False]]
    np.testing.assert_allclose(found.positions[~gone], places()[~gone] / 1e3, atol=3e-5)


def test_zeros_at_either_end_and_many_gaps_of_zeros_are_reported_by_no_sentence(tmp_path):
    raw = c3d_bytes(places(), list("abcd"))
    for block in (0, 7):
        ends = bytearray(raw)
        begin = begin_of(raw) + 512 * block
        ends[begin : begin + 512] = bytes(512)
        assert read(tmp_path, bytes(ends)).warning == ""
    many = bytearray(c3d_bytes(np.tile(places(), (2, 1, 1)), list("abcd")))
    for block in (1, 3, 5, 7):
        begin = begin_of(raw) + 512 * block
        many[begin : begin + 512] = bytes(512)
    assert read(tmp_path, bytes(many)).warning == ""


def noisy(points, frames=150):
    """Markers that swing [mm], with the noise of cameras."""
    where = np.tile(places(points), (3, 1, 1))[:frames]
    return where + np.random.default_rng(0).normal(0, 0.2, where.shape)


@pytest.mark.parametrize(
    ("points", "analogue", "scale", "first", "last"),
    [(5, 0, -1.0, 26, 32), (4, 3, -1.0, 28, 34), (13, 0, -1.0, 10, 13), (5, 0, 0.1, 52, 64)],
)
@pytest.mark.parametrize("back", [1, 3])
def test_a_block_that_repeats_an_earlier_one_within_other_frames_is_stale(
    tmp_path, points, analogue, scale, first, last, back
):  # fmt: skip
    """Bytes 2048 to 2560. With 3 analogue values, frame 27 ends behind its points there."""
    where = noisy(points)
    raw = bytearray(c3d_bytes(where, [f"m{k}" for k in range(points)], scale=scale, analogue=analogue))
    begin = begin_of(raw) + 512 * 4
    raw[begin : begin + 512] = raw[begin - 512 * back : begin - 512 * back + 512]
    found = read(tmp_path, bytes(raw))
    assert found.warning == (
        f"frames {first} to {last} hold 1 block of 512 bytes of earlier frames, and markers in them count as not seen"
    )
    gone = np.isnan(found.positions).any(2)
    np.testing.assert_allclose(found.positions[~gone], where[~gone] / 1e3, atol=6e-5)
    assert set(np.flatnonzero(gone.any(1)).tolist()) <= set(range(first - 1, last))


@pytest.mark.parametrize("points", [4, 5, 13, 32, 64])
@pytest.mark.parametrize("change", ["rest", "twice", "period", "gaps"])
def test_frames_that_repeat_whole_are_read(tmp_path, points, change):
    """Of a marker at rest, of a camera that skips, of a motion that recurs, and without any marker."""
    where = noisy(points)
    if change == "gaps":
        where[40:120] = np.nan
    else:
        k = np.arange(150)
        where = where[{"rest": np.clip(k, 40, 120), "twice": k - (k % 10 == 9), "period": k % 16}[change]]
    found = read(tmp_path, c3d_bytes(where, [f"m{k}" for k in range(points)]))
    assert found.warning == ""
    np.testing.assert_allclose(found.positions, where / 1e3, atol=1e-6)


@pytest.mark.parametrize(("block", "cut"), [(0, 6), (5, 33)])
def test_a_marker_that_a_block_of_zeros_at_an_end_cuts_is_a_gap(tmp_path, block, cut):
    """Of 76 bytes a frame. The first block ends 8 within d in frame 6; the last one begins 4 within d in frame 33."""
    where = noisy(4)[:40]
    raw = bytearray(c3d_bytes(where, list("abcd"), analogue=3))
    begin = begin_of(raw) + 512 * block
    raw[begin : begin + 512] = bytes(min(512, len(raw) - begin))
    found = read(tmp_path, bytes(raw))
    assert found.warning == ""  # no place is left that jumps
    gone = np.isnan(found.positions).any(2)
    np.testing.assert_allclose(found.positions[~gone], where[~gone] / 1e3, atol=1e-6)
    assert gone[cut].tolist() == ([True] * 4 if block == 0 else [False, False, False, True])


@pytest.mark.parametrize("points", [3, 5])
def test_markers_that_all_rest_at_one_position_are_read(tmp_path, points):
    """Every block is then the same."""
    found = read(tmp_path, c3d_bytes(np.ones((150, points, 3)), [f"m{k}" for k in range(points)]))
    assert (found.warning, np.isfinite(found.positions).all()) == ("", True)


def test_a_block_that_begins_with_a_points_fourth_number_holds_no_coordinate_of_it():
    """Frames of 17 floats: block 5 has the numbers 640 to 767, so 11 to 16 of frame 37, and 7 further frames.

    Number 11 is the fourth of the third point. The numbers 12 to 15 are the fourth point's, and 16 is analogue.
    """
    spans = dict(_spans(np.zeros((60, 4, 3)), 5, 4, 68))
    touched = {frame: np.arange(4)[points].tolist() for frame, points in spans.items()}
    assert touched[37] == [3]
    assert touched[38] == [0, 1, 2, 3]
    assert sorted(touched) == list(range(37, 46))


@pytest.mark.parametrize("size", [512, 4096, 19 * 512])
@pytest.mark.parametrize("share", [0.3, 0.95])
@pytest.mark.parametrize("off", [0, 77])
@pytest.mark.parametrize("scale", [-1.0, 0.05])
def test_blocks_that_a_copy_wrote_twice_are_refused(tmp_path, size, share, off, scale):
    """All frames behind them would be read from the wrong bytes, most of them as positions of other markers."""
    places = np.random.default_rng(3).uniform(-900, 900, (200, 13, 3))
    places[:, 4:7] = np.nan  # gaps repeat bytes, but all of them alike
    raw = c3d_bytes(places, [f"m{k}" for k in range(13)], scale=scale)
    begin = 512 * (struct.unpack_from("<H", raw, 16)[0] - 1)
    at = begin + size + int(share * (len(raw) - begin - size)) // 512 * 512 - off
    found = read(tmp_path, raw)
    with pytest.raises(TakeError, match=rf"holds the {size} bytes from byte \d+ on twice, which shifts all frames beh"):
        read(tmp_path, raw[:at] + raw[at - size : at] + raw[at:])
    assert (found.warning, len(found.time)) == ("", 200)


@pytest.mark.parametrize("at_once", [1 << 22, 700, 1 << 12])
@pytest.mark.parametrize(("count", "size"), [(4, 512), (16, 1024), (32, 512)])
def test_whole_frames_that_a_copy_wrote_twice_are_refused_and_frames_at_rest_are_not(
    tmp_path, monkeypatch, count, size, at_once
):
    """The frames behind would be read too late by 8, 4 or 1 intervals, and the last ones not at all."""
    monkeypatch.setattr(c3d_doubled, "COMPARED_AT_ONCE", at_once)
    moving = np.random.default_rng(3).uniform(-900, 900, (128, count, 3))
    labels = [f"m{k}" for k in range(count)]
    raw = c3d_bytes(moving, labels)
    at = begin_of(raw) + 5 * 512 + 40
    with pytest.raises(TakeError, match=rf"holds the {size} bytes from byte \d+ on twice"):
        read(tmp_path, raw[:at] + raw[at - size : at] + raw[at:])
    at_rest = np.tile(moving[:1], (128, 1, 1))
    longer = c3d_bytes(np.concatenate([at_rest, at_rest[:8]]), labels, frames_said=128)
    np.testing.assert_allclose(1e3 * read(tmp_path, longer).positions, at_rest, atol=1e-3)


@pytest.mark.parametrize("repeated", [[20, 41, 77], range(1, 128, 2)])
@pytest.mark.parametrize("said", [127, 128])
def test_frames_that_a_program_repeats_are_no_blocks_written_twice(tmp_path, repeated, said):
    """Programs repeat a frame for a lost one, or each for a higher rate, and may state one frame too few."""
    moving = np.random.default_rng(3).uniform(-900, 900, (128, 32, 3))
    moving[list(repeated)] = moving[[k - 1 for k in repeated]]
    found = read(tmp_path, c3d_bytes(moving, [f"m{k}" for k in range(32)], frames_said=said))
    np.testing.assert_allclose(1e3 * found.positions, moving[:said], atol=1e-3)


@pytest.mark.parametrize("count", [1, 7])
def test_markers_at_rest_and_gaps_are_no_blocks_written_twice(tmp_path, count):
    """Frames of 208 bytes at rest repeat after 13 blocks, and behind them are as many blocks as no frames fill."""
    at_rest = np.tile(np.random.default_rng(3).uniform(-900, 900, (1, 13, 3)), (200, 1, 1))
    gaps = np.full((200, 13, 3), np.nan)
    gaps[::50] = at_rest[0]
    for found_places in (at_rest, gaps):
        raw = c3d_bytes(found_places, [f"m{k}" for k in range(13)])
        found = read(tmp_path, raw + np.random.default_rng(0).bytes(512 * count))
        np.testing.assert_allclose(1e3 * found.positions, found_places, atol=1e-3)
