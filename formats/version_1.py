"""Read the blocks and scans of takes of version 1, which are no longer written. See `formats/SPEC-1.md`."""

from __future__ import annotations

from typing import Any

import numpy as np

from formats.arrays import Booleans, Floats
from formats.blocks import ANGLE_STEP, LATEST, MOST_ROWS, NO_QUALITY, QUALITY_STEPS, TICKS, Columns
from formats.surface import LARGEST_GRID, MOST_OUTLINE_PLACES, SurfaceScan

FIRST_PLACE_STEP = 1e-4  # m, `formats/SPEC-1.md`


def decode_block(block: dict[str, Any], points: int) -> Columns:
    """Return the columns of a block, by the names of `formats.take.Take`.

    Raises:
        ValueError, KeyError, TypeError: the content is malformed.
    """
    n, start = block["frames"], block["start"]
    if type(n) is not int or type(start) is not int or not 1 <= n <= MOST_ROWS or abs(start) > LATEST:
        raise ValueError(f"{n!r} frames from {start!r} on cannot be")
    state, quality = np.frombuffer(block["state"], "<u2").astype(np.uint16), block.get("quality")
    steps = np.frombuffer(quality if quality else bytes([NO_QUALITY] * n), np.uint8)
    if len(state) != n or len(steps) != n:
        raise ValueError(f"the columns state and quality have {len(state)} and {len(steps)} rows for {n} frames")
    decoded: Columns = {
        "time": start / TICKS + unpack(block["time"], (n,), 1 / TICKS),
        "state": state,
        "markers": unpack(block["markers"], (n, 2, 3), FIRST_PLACE_STEP),
        "held": unpack(block["held"], (n, 2, 3), FIRST_PLACE_STEP),
        "held_sd": unpack(block["held_sd"], (n, 2, 3), FIRST_PLACE_STEP),
        "points": unpack(block["points"], (n, points, 3), FIRST_PLACE_STEP),
        "points_sd": unpack(block["points_sd"], (n, points, 3), FIRST_PLACE_STEP),
        "held_valid": unpack_flags(block["held_valid"], (n, 2)),
        "points_valid": unpack_flags(block["points_valid"], (n, points)),
    }
    hidden = block.get("points_hidden")
    decoded["points_hidden"] = unpack_flags(hidden, (n, points)) if hidden else np.zeros((n, points), bool)
    decoded["quality"] = np.where(steps == NO_QUALITY, np.nan, steps / QUALITY_STEPS)
    markers_valid = unpack_flags(block["markers_valid"], (n, 2))
    for name, valid in (
        ("markers", markers_valid), ("held", decoded["held_valid"]), ("points", decoded["points_valid"]),
    ):  # fmt: skip
        decoded[name][~valid] = np.nan
    pitch = np.full((n, 2), np.nan)
    if "pitch" in block:  # older takes have none
        pitch = unpack(block["pitch"], (n, 2), ANGLE_STEP)
        pitch[~unpack_flags(block["pitch_valid"], (n,))] = np.nan
    decoded["pitch"], decoded["pitch_sd"] = pitch.T
    return decoded


def decode_scan(content: dict[str, Any]) -> SurfaceScan:
    """Return the scan of a `/surface` message.

    Raises:
        ValueError, KeyError, TypeError: the content is malformed.
    """
    size, count, time = content["grid_size"], content["contour_size"], content["surface"]
    if not all(type(number) is int for number in (size, count, time)) or abs(time) > LATEST:
        raise ValueError(f"sizes {size!r} and {count!r} at {time!r} are not whole numbers")
    if not (0 <= size <= LARGEST_GRID and 0 <= count <= MOST_OUTLINE_PLACES):
        raise ValueError(f"{size} x {size} places and {count} around them cannot be")
    grid = unpack(content["grid"], (size * size, 3), FIRST_PLACE_STEP)
    grid[~unpack_flags(content["grid_valid"], (size * size,))] = np.nan
    contour = unpack(content["contour"], (count, 3), FIRST_PLACE_STEP)
    contour[~unpack_flags(content["contour_valid"], (count,))] = np.nan
    return SurfaceScan(time=time / TICKS, grid=grid.reshape(size, size, 3), contour=contour)


def unpack(raw: bytes, shape: tuple[int, ...], step: float) -> Floats:
    """Return a packed column of `shape`, (frames, ...): four byte planes of zigzag differences in steps.

    Raises:
        ValueError: the bytes do not fit the shape.
    """
    columns = int(np.prod(shape[1:])) if len(shape) > 1 else 1
    planes = np.frombuffer(raw, np.uint8)
    if planes.size != 4 * columns * shape[0]:
        raise ValueError(f"{planes.size} bytes do not hold {shape}")
    zigzag = np.ascontiguousarray(planes.reshape(4, -1).T).view("<u4").reshape(columns, shape[0]).T.astype(np.int64)
    difference = (zigzag >> 1) ^ -(zigzag & 1)
    return np.asarray(np.cumsum(difference, axis=0).reshape(shape) * step)


def unpack_flags(raw: bytes, shape: tuple[int, ...]) -> Booleans:
    """Return packed booleans of `shape`, (frames, ...).

    Raises:
        ValueError: the bytes do not fit the shape.
    """
    count = int(np.prod(shape))
    packed = np.frombuffer(raw, np.uint8)
    if packed.size != -(-count // 8):
        raise ValueError(f"{packed.size} bytes do not hold {count} bits")
    bits = np.unpackbits(packed, count=count).astype(bool)
    return bits.reshape(shape[::-1]).T
