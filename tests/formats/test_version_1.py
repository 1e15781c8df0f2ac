"""Blocks and scans of version 1, packed here by its specification: what comes back, and what cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from formats.blocks import LATEST, MOST_ROWS, NO_QUALITY, QUALITY_STEPS
from formats.surface import LARGEST_GRID, MOST_OUTLINE_PLACES
from formats.version_1 import decode_block, decode_scan, unpack, unpack_flags


def packed(steps):
    """Whole steps, (frames, ...), as four byte planes of zigzag differences, column by column."""
    columns = np.asarray(steps, np.int64).reshape(len(steps), -1)
    difference = np.diff(columns, axis=0, prepend=0)
    zigzag = ((difference << 1) ^ (difference >> 63)).astype("<u4").T.ravel()
    return zigzag.view(np.uint8).reshape(-1, 4).T.tobytes()


def flags(values):
    return np.packbits(np.asarray(values, bool).T.ravel()).tobytes()


RNG = np.random.default_rng(4)
HELD, POINTS = RNG.integers(-20_000, 20_000, (3, 2, 3)), RNG.integers(-20_000, 20_000, (3, 5, 3))
MARKERS, HELD_SD, POINTS_SD = HELD + 7, np.full((3, 2, 3), 20), np.full((3, 5, 3), 30)
SEEN = np.arange(15).reshape(3, 5) % 4 != 1
ENDS = np.array([[True, True], [False, True], [True, True]])
BOTH = np.array([[True, False], [True, True], [True, True]])


def block(**changes):
    """Three frames of five points, 1.5 s after the clock began."""
    return {
        "frames": 3, "start": 1_500_000, "time": packed([0, 33_000, 66_001]), "markers": packed(MARKERS),
        "held": packed(HELD), "held_sd": packed(HELD_SD), "points": packed(POINTS), "points_sd": packed(POINTS_SD),
        "held_valid": flags(ENDS), "points_valid": flags(SEEN), "markers_valid": flags(BOTH),
        "points_hidden": flags(~SEEN), "state": np.array([0, 5, 65535], "<u2").tobytes(),
        "quality": bytes([0, NO_QUALITY, QUALITY_STEPS]), "pitch": packed([[100, 5], [-200, 6], [300, 7]]),
        "pitch_valid": flags([True, False, True]), **changes,
    }  # fmt: skip


def without(content, *names):
    return {name: value for name, value in content.items() if name not in names}


def test_a_block_of_version_1_comes_back_in_metres_seconds_and_radians():
    found = decode_block(block(), 5)
    assert found["time"] == pytest.approx([1.5, 1.533, 1.566001], abs=1e-9)
    assert found["state"].tolist() == [0, 5, 65535]
    assert found["state"].dtype == np.uint16
    for name, steps, valid in (("held", HELD, ENDS), ("markers", MARKERS, BOTH), ("points", POINTS, SEEN)):
        np.testing.assert_allclose(found[name], np.where(valid[..., None], 1e-4 * steps, np.nan), atol=1e-12)
    assert found["held_sd"] == pytest.approx(np.full((3, 2, 3), 0.002))
    assert found["points_sd"] == pytest.approx(np.full((3, 5, 3), 0.003))
    assert (found["held_valid"] == ENDS).all()
    assert (found["points_valid"] == SEEN).all()
    assert (found["points_hidden"] == ~SEEN).all()
    np.testing.assert_allclose(found["quality"], [0.0, np.nan, 1.0])
    np.testing.assert_allclose(found["pitch"] / found["pitch"][0], [1.0, np.nan, 3.0])
    assert found["pitch_sd"][[0, 2]] == pytest.approx(found["pitch"][0] * np.array([0.05, 0.07]))


def test_older_blocks_lack_pitch_quality_and_what_is_hidden():
    found = decode_block(without(block(), "pitch", "pitch_valid", "quality", "points_hidden"), 5)
    assert np.isnan(found["pitch"]).all()
    assert np.isnan(found["pitch_sd"]).all()
    assert np.isnan(found["quality"]).all()
    assert not found["points_hidden"].any()
    assert found["points_hidden"].shape == (3, 5)


@pytest.mark.parametrize(
    "changes",
    [
        {"frames": 0}, {"frames": 2}, {"frames": 4}, {"frames": True}, {"frames": 3.0}, {"frames": MOST_ROWS + 1},
        {"start": 1.5e6}, {"start": LATEST + 1}, {"start": -LATEST - 1}, {"time": packed([0, 1])},
        {"state": b"\0\0" * 2}, {"quality": b"\0\0"}, {"points": packed(POINTS[:, :4])}, {"held": b""},
        {"held_valid": b""}, {"points_valid": flags(np.ones((3, 6), bool))}, {"pitch_valid": b"\0\0"},
        {"markers_valid": b"\0\0"},
    ],
    ids=lambda changes: next(iter(changes)),
)  # fmt: skip
def test_a_block_that_does_not_hold_together_is_refused(changes):
    with pytest.raises(ValueError, match=r"cannot be|rows for . frames|do not hold"):
        decode_block(block(**changes), 5)


@pytest.mark.parametrize("start", [LATEST, -LATEST])
def test_a_block_may_begin_as_late_as_three_centuries(start):
    assert decode_block(block(start=start), 5)["time"][0] == pytest.approx(start / 1e6)


def test_a_block_of_the_most_rows_is_read():
    few = {name: np.zeros((MOST_ROWS, *shape), int) for name, shape in (("held", (2, 3)), ("points", (0, 3)))}
    content = block(
        frames=MOST_ROWS, time=packed(np.arange(MOST_ROWS)), state=bytes(2 * MOST_ROWS), markers=packed(few["held"]),
        held=packed(few["held"]), held_sd=packed(few["held"]), points=b"", points_sd=b"", points_valid=b"",
        held_valid=flags(np.ones((MOST_ROWS, 2))), markers_valid=flags(np.ones((MOST_ROWS, 2))),
    )  # fmt: skip
    found = decode_block(without(content, "pitch", "pitch_valid", "quality", "points_hidden"), 0)
    assert len(found["time"]) == MOST_ROWS


def test_a_block_of_a_single_frame_is_read():
    one = {
        "time": packed([[5]]), "state": bytes(2), "held_valid": flags([[True, True]]), "points_valid": b"",
        "markers_valid": flags([[True, False]]), "points": b"", "points_sd": b"",
        **{name: packed(HELD[:1]) for name in ("markers", "held", "held_sd")},
    }  # fmt: skip
    found = decode_block(without(block(frames=1, **one), "pitch", "pitch_valid", "quality", "points_hidden"), 0)
    assert found["time"].tolist() == [1.500005]
    np.testing.assert_allclose(found["held"], 1e-4 * HELD[:1], atol=1e-12)


GRID, CONTOUR = RNG.integers(-9_000, 9_000, (9, 3)), RNG.integers(-9_000, 9_000, (4, 3))


def scan(**changes):
    return {
        "grid_size": 3, "contour_size": 4, "surface": 2_250_000, "grid": packed(GRID), "contour": packed(CONTOUR),
        "grid_valid": flags(np.arange(9) != 5), "contour_valid": flags(np.arange(4) != 0), **changes,
    }  # fmt: skip


def test_a_scan_of_version_1_comes_back():
    found = decode_scan(scan())
    assert found.time == 2.25
    expected = 1e-4 * GRID.astype(float)
    expected[5] = np.nan
    np.testing.assert_allclose(found.grid, expected.reshape(3, 3, 3), atol=1e-12)
    assert np.isnan(found.contour[0]).all()
    np.testing.assert_allclose(found.contour[1:], 1e-4 * CONTOUR[1:], atol=1e-12)


@pytest.mark.parametrize(
    "changes",
    [
        {"grid_size": -1}, {"grid_size": LARGEST_GRID + 1}, {"contour_size": -1},
        {"contour_size": MOST_OUTLINE_PLACES + 1},
    ],
    ids=lambda changes: next(iter(changes)),
)  # fmt: skip
def test_a_scan_of_sizes_that_cannot_be_is_refused_before_it_is_unpacked(changes):
    with pytest.raises(ValueError, match=r"^-?\d+ x -?\d+ places and -?\d+ around them cannot be$"):
        decode_scan(scan(**changes))


@pytest.mark.parametrize(
    "changes",
    [
        {"grid_size": 3.0}, {"grid_size": -1}, {"grid_size": LARGEST_GRID + 1}, {"grid_size": 2}, {"contour_size": "4"},
        {"contour_size": -1}, {"contour_size": MOST_OUTLINE_PLACES + 1}, {"contour_size": 5}, {"surface": 2.25e6},
        {"surface": LATEST + 1}, {"surface": -LATEST - 1}, {"grid_valid": b"\0"}, {"contour_valid": b""},
    ],
    ids=lambda changes: next(iter(changes)),
)  # fmt: skip
def test_a_scan_that_does_not_hold_together_is_refused(changes):
    with pytest.raises(ValueError, match=r"cannot be|whole numbers|do not hold"):
        decode_scan(scan(**changes))


def test_a_scan_may_be_empty_and_three_centuries_away():
    found = decode_scan(scan(grid_size=0, contour_size=0, grid=b"", contour=b"", grid_valid=b"", contour_valid=b"",
                             surface=-LATEST))  # fmt: skip
    assert (found.grid.shape, found.contour.shape, found.time) == ((0, 0, 3), (0, 3), -LATEST / 1e6)


def test_columns_and_flags_say_how_many_bytes_they_lack():
    with pytest.raises(ValueError, match=r"^7 bytes do not hold \(2,\)$"):
        unpack(bytes(7), (2,), 1.0)
    with pytest.raises(ValueError, match=r"^2 bytes do not hold 8 bits$"):
        unpack_flags(bytes(2), (2, 4))
    assert unpack(packed([[3, -1], [5, -4]]), (2, 2), 0.5).tolist() == [[1.5, -0.5], [2.5, -2.0]]
