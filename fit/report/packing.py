"""Compress motion for the report's player, small enough to be embedded in the page.

Positions are rounded to whole steps and differenced from frame to frame (modulo 2^16). Zigzag coding makes small
differences of either sign small numbers. The numbers are split into low and high bytes and deflated, which leaves about
a byte per coordinate. A coordinate that is not a number becomes -32768.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from fit.report.motion import ReportMotion
from formats.arrays import Floats

POINT_STEP = 1e-4  # m, a tenth of the sensor's noise
MESH_STEP = 5e-4  # m, half a pixel of the player for a garment half a metre wide
UNSEEN = -32768  # the smallest 16-bit integer, which stands for no position
LARGEST_SHORT = 32767  # the largest 16-bit integer
STRIDES = (1, 2, 3, 4, 6, 8, 12)  # frames per stored mesh, so that the page stays small


def pack(track: Floats | None, step: float, every: int = 1) -> dict[str, Any] | None:
    """Encode positions [m], (frames, points, 3), in the player's format, one of `every` frames."""
    if track is None or not track.size:
        return None
    kept = np.asarray(track, dtype=float)[::every]
    known = kept[np.isfinite(kept).all(-1)]
    # The median stays in the middle of the cloth even if a few vertices are outliers.
    centre = np.round(np.median(known, axis=0), 3) if len(known) else np.zeros(3)
    with np.errstate(invalid="ignore"):
        scaled = np.clip(np.round((kept - centre) / step), -LARGEST_SHORT, LARGEST_SHORT)
    whole = np.where(np.isfinite(scaled), scaled, UNSEEN).astype(np.int16).reshape(len(kept), -1)
    change = np.diff(whole, axis=0, prepend=np.zeros((1, whole.shape[1]), np.int16)).ravel()
    zigzag = ((change << 1) ^ (change >> 15)).astype(np.uint16)
    planes = np.concatenate([(zigzag & 255).astype(np.uint8), (zigzag >> 8).astype(np.uint8)])
    data = base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode("ascii")
    return {"count": kept.shape[1], "every": every, "step": step, "centre": centre.tolist(), "data": data}


def pack_motions(motions: Sequence[ReportMotion], budget: int) -> tuple[list[dict[str, Any]], str]:
    """Return the motions for the player within `budget` bytes, and a sentence on omissions.

    Meshes get fewer frames first, then the last motions lose their meshes, then whole motions are left out.
    """
    packed = [_without_meshes(motion) for motion in motions]
    note = ""
    while packed and sum(_size(p) for p in packed) > budget:
        packed.pop()
    if len(packed) < len(motions):
        note = f"{len(motions) - len(packed)} of {len(motions)} takes are left out here to keep this file small."
    left = budget - sum(_size(p) for p in packed)
    coarsest = [_meshes(motion, STRIDES[-1]) for motion in motions[: len(packed)]]
    sizes = np.cumsum([_size(m) for m in coarsest])
    count = int(np.searchsorted(sizes, left, side="right"))
    if count and count <= len(packed):
        # If half of the coarsest packing's size exceeds the budget, no stride can fit, so none is tried.
        hopeful = [every for every in STRIDES if 0.5 * sizes[count - 1] * STRIDES[-1] / every <= left] or [STRIDES[-1]]
        for every in hopeful:
            meshes = [_meshes(motion, every) for motion in motions[:count]]
            if sum(_size(m) for m in meshes) <= left:
                break
        for target, found in zip(packed, meshes, strict=False):
            target.update(found)
    if any(run.mesh is not None for motion in motions[count : len(packed)] for run in motion.runs.values()):
        note = (note + " The cloth between the points is shown for the first takes only.").strip()
    return packed, note


def _without_meshes(motion: ReportMotion) -> dict[str, Any]:
    free = motion.free if motion.free is not None else np.ones(len(motion.point_names), bool)
    return {
        "take_id": motion.take_id,
        "is_held_out": motion.is_held_out,
        "point_names": list(motion.point_names),
        "free": [bool(one) for one in free],
        "worst_frame": motion.worst_frame,
        "time": [round(float(t), 4) for t in motion.time],
        "real": pack(motion.real, POINT_STEP),
        "held": pack(motion.held, POINT_STEP),
        "points": {name: pack(motion.compared(name), POINT_STEP) for name in motion.shown},
        "meshes": dict.fromkeys(motion.shown),
        "triangles": [],
    }


def _meshes(motion: ReportMotion, every: int) -> dict[str, Any]:
    meshes = {name: pack(motion.runs[name].mesh, MESH_STEP, every) for name in motion.shown}
    is_shown = motion.triangles is not None and any(meshes.values())
    return {"meshes": meshes, "triangles": np.asarray(motion.triangles).tolist() if is_shown else []}


def _size(packed: dict[str, Any]) -> int:
    tracks = [packed.get("real"), packed.get("held"), *packed.get("points", {}).values(), *packed["meshes"].values()]
    numbers = 8 * len(packed.get("time", [])) + 16 * len(packed["triangles"])
    return numbers + sum(len(track["data"]) + 120 for track in tracks if track)
