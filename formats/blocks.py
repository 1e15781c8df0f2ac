"""Frames of a take as the columns of one block, and back. See `formats/SPEC.md`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.arrays import Booleans, Floats
from formats.columns import pack, pack_flags, unpack, unpack_flags

POSITION_STEP = 1e-4  # m: a twentieth of the best depth sensor's noise
TIME_STEP = 1e-6  # s
LATEST = 10**16  # steps, three centuries, in which sums of seconds still keep their microseconds
ANGLE_STEP = 1e-4  # rad: a hundredth of what a depth sensor can tell
QUALITY_STEPS, NO_QUALITY = 254, 255  # a byte a frame


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One frame's measurements in the sensor frame; NaN and False where something was not seen.

    time [s]; markers, held [m], (2, 3); points [m], (points, 3); deviations per axis [m], same shapes;
    state: bits of `formats.take.FrameState`; pitch, pitch_sd [rad]: NaN where not seen;
    points_hidden, (points,): None where nobody looked; quality: 0 to 1
    """

    time: float
    markers: Floats
    held: Floats
    held_valid: Booleans
    held_sd: Floats
    points: Floats
    points_valid: Booleans
    points_sd: Floats
    state: int = 0
    pitch: float = float("nan")
    pitch_sd: float = float("nan")
    points_hidden: Booleans | None = None
    quality: float = float("nan")


def encode_block(frames: list[Frame], first: int) -> dict[str, Any]:
    """Return frames, of which the first has this number, as the content of a `/block` message."""
    stack = {
        name: np.stack([getattr(f, name) for f in frames])
        for name in ("markers", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd")
    }
    hidden = [f.points_hidden for f in frames if f.points_hidden is not None]
    quality = np.array([f.quality for f in frames])
    pitch = np.array([[f.pitch, f.pitch_sd] for f in frames])
    return {
        **({"points_hidden": pack_flags(np.stack(hidden))} if len(hidden) == len(frames) else {}),
        **({"quality": _quality_bytes(quality)} if np.isfinite(quality).any() else {}),
        "first": first,
        "frames": len(frames),
        "start": round(frames[0].time / TIME_STEP),
        "time": pack(np.array([[f.time - round(frames[0].time / TIME_STEP) * TIME_STEP] for f in frames]), TIME_STEP),
        "state": np.array([f.state for f in frames], "<u2").tobytes(),
        "pitch": pack(pitch, ANGLE_STEP),
        "pitch_valid": pack_flags(np.asarray(np.isfinite(pitch).all(-1))),
        "markers_valid": pack_flags(np.isfinite(stack["markers"]).all(-1)),
        **{name: pack(stack[name], POSITION_STEP) for name in ("markers", "held", "held_sd", "points", "points_sd")},
        **{name: pack_flags(stack[name]) for name in ("held_valid", "points_valid")},
    }


def _quality_bytes(quality: Floats) -> bytes:
    steps = np.rint(np.clip(np.nan_to_num(quality), 0.0, 1.0) * QUALITY_STEPS)
    return np.where(np.isfinite(quality), steps, NO_QUALITY).astype(np.uint8).tobytes()


def decode_block(block: dict[str, Any], points: int) -> dict[str, NDArray[Any]]:
    """Return the columns of a `/block` message, by the names of `formats.take.Take`.

    Raises:
        ValueError, KeyError, TypeError: the content does not hold together.
    """
    n, start = block["frames"], block["start"]
    if type(n) is not int or type(start) is not int or n < 1 or abs(start) > LATEST:
        raise ValueError(f"{n!r} frames from {start!r} on cannot be")
    state, quality = np.frombuffer(block["state"], "<u2").astype(np.uint16), block.get("quality")
    steps = np.frombuffer(quality if quality else bytes([NO_QUALITY] * n), np.uint8)
    if len(state) != n or len(steps) != n:
        raise ValueError(f"{len(state)} states and {len(steps)} qualities of {n} frames")
    decoded: dict[str, NDArray[Any]] = {
        "time": start * TIME_STEP + unpack(block["time"], (n,), TIME_STEP),
        "state": state,
        "markers": unpack(block["markers"], (n, 2, 3), POSITION_STEP),
        "held": unpack(block["held"], (n, 2, 3), POSITION_STEP),
        "held_sd": unpack(block["held_sd"], (n, 2, 3), POSITION_STEP),
        "points": unpack(block["points"], (n, points, 3), POSITION_STEP),
        "points_sd": unpack(block["points_sd"], (n, points, 3), POSITION_STEP),
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
