"""Packing of arrays for take archives: quantise, difference along time, zigzag, split into byte planes.

    q = round(x / step);  d_0 = q_0, d_t = q_t - q_(t-1);  z = 2 d for d >= 0, -2 d - 1 else;  planes of z's four bytes

Small differences leave the upper planes empty, which zstd removes. A value that is not a number repeats the one before
it (difference 0); which values are valid is stored apart.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.arrays import Booleans, Floats

LARGEST = 2**30  # quantised: 107 km in steps of 0.1 mm, far beyond any sensor


def pack(values: Floats, step: float) -> bytes:
    """Pack `values`, (frames, ...), in steps of `step`."""
    flat = np.asarray(values, float).reshape(len(values), -1)
    whole = np.clip(np.rint(np.nan_to_num(flat, nan=0.0) / step), -LARGEST, LARGEST).astype(np.int64)
    missing = ~np.isfinite(flat)
    if missing.any():
        # Repeat the last finite value: the index of the last finite row so far, per column.
        rows = np.where(missing, 0, np.arange(len(flat))[:, None])
        whole = np.take_along_axis(whole, np.maximum.accumulate(rows, axis=0), axis=0)
    difference = np.diff(whole, axis=0, prepend=np.zeros((1, whole.shape[1]), np.int64)).astype(np.int32)
    zigzag = ((difference << 1) ^ (difference >> 31)).astype("<u4")
    # Column by column, so that one coordinate's history lies together.
    return np.ascontiguousarray(zigzag.T).view(np.uint8).reshape(-1, 4).T.tobytes()


def unpack(raw: bytes, shape: tuple[int, ...], step: float) -> Floats:
    """Unpack to `shape`, (frames, ...).

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


def pack_flags(flags: NDArray[Any]) -> bytes:
    """Pack booleans, (frames, ...), into bits."""
    return np.packbits(np.asarray(flags, bool).T.ravel()).tobytes()


def unpack_flags(raw: bytes, shape: tuple[int, ...]) -> Booleans:
    """Unpack booleans to `shape`, (frames, ...).

    Raises:
        ValueError: the bytes do not fit the shape.
    """
    count = int(np.prod(shape))
    packed = np.frombuffer(raw, np.uint8)
    if packed.size != -(-count // 8):
        raise ValueError(f"{packed.size} bytes do not hold {count} bits")
    bits = np.unpackbits(packed, count=count).astype(bool)
    return bits.reshape(shape[::-1]).T
