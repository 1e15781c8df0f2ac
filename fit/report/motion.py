"""Motion for the report's player: packed small enough to travel inside the page.

Positions are rounded to whole steps and differenced from frame to frame (modulo 2^16). Zigzag coding makes small
differences of either sign small numbers. The numbers are split into low and high bytes and deflated, which leaves about
a byte per coordinate. A coordinate that is not a number becomes -32768.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from formats.arrays import Floats

POINT_STEP = 1e-4  # m, a tenth of the sensor's noise
MESH_STEP = 5e-4  # m, half a pixel of the player for a garment half a metre wide
NOT_SEEN = -32768
LARGEST = 32767
STRIDES = (1, 2, 3, 4, 6, 8, 12)  # every so many frames a mesh, so that the page stays small
RUNS = ("before", "after", "with_effect")


@dataclass(frozen=True, kw_only=True)
class ReportMotion:
    """Real and simulated motion of one take, in a world frame with z up.

    - `time` [s], (frames,)
    - `real` [m], (frames, points, 3), NaN where not seen
    - `before`, `after`, `with_effect` [m], (frames, points, 3): the simulated points before the fit, after the fit, and
      with the named effect; None without this run
    - `mesh_before`, `mesh_after`, `mesh_with_effect` [m], (frames, vertices, 3): the simulated cloth of the same runs,
      or None
    - `triangles`, (triangles, 3): indices of vertices
    - `held` [m], (frames, 2, 3): the two ends of the held edge, left first
    - `pull_hz`: natural frequency of the pull that drew the simulated cloth to the real points, 0 where it moved freely
    """

    take_id: str
    is_held_out: bool
    time: Floats
    real: Floats
    point_names: tuple[str, ...]
    before: Floats | None = None
    after: Floats | None = None
    with_effect: Floats | None = None
    mesh_before: Floats | None = None
    mesh_after: Floats | None = None
    mesh_with_effect: Floats | None = None
    triangles: NDArray[np.int64] | None = None
    pull_hz: float = 0.0
    held: Floats | None = None

    def __post_init__(self) -> None:
        frames, points = len(self.time), len(self.point_names)
        if frames < 2:
            raise FitError("a motion needs two frames or more", where=self.take_id)
        tracks = {"real": self.real, **{run: self.points(run) for run in RUNS}}
        for name, track in tracks.items():
            if track is not None and track.shape != (frames, points, 3):
                raise FitError(f"{name} points have shape {track.shape}, not {(frames, points, 3)}", where=self.take_id)
        for run in RUNS:
            mesh = self.mesh(run)
            if mesh is not None and (mesh.ndim != 3 or mesh.shape[0] != frames or mesh.shape[2] != 3):
                raise FitError(
                    f"the mesh of {run} has shape {mesh.shape}, not ({frames}, vertices, 3)", where=self.take_id
                )

    def points(self, run: str) -> Floats | None:
        """Return the simulated points of a run of `RUNS` [m], (frames, points, 3)."""
        found: Floats | None = {"before": self.before, "after": self.after, "with_effect": self.with_effect}[run]
        return found

    def mesh(self, run: str) -> Floats | None:
        """Return the simulated cloth of a run of `RUNS` [m], (frames, vertices, 3)."""
        meshes = {"before": self.mesh_before, "after": self.mesh_after, "with_effect": self.mesh_with_effect}
        found: Floats | None = meshes[run]
        return found

    def errors(self, run: str) -> Floats | None:
        """Return the distance of each simulated point of a run from the real one [m], (frames, points), or None."""
        simulated = self.points(run)
        return None if simulated is None else np.asarray(np.linalg.norm(simulated - self.real, axis=2))


def pack(track: Floats | None, step: float, every: int = 1) -> dict[str, Any] | None:
    """Return positions [m], (frames, points, 3), as the player unpacks them, one of `every` frames."""
    if track is None or not track.size:
        return None
    kept = np.asarray(track, dtype=float)[::every]
    known = kept[np.isfinite(kept).all(-1)]
    # The median is in the middle of the cloth even when a few vertices have been thrown far away.
    centre = np.round(np.median(known, axis=0), 3) if len(known) else np.zeros(3)
    with np.errstate(invalid="ignore"):
        scaled = np.clip(np.round((kept - centre) / step), -LARGEST, LARGEST)
    whole = np.where(np.isfinite(scaled), scaled, NOT_SEEN).astype(np.int16).reshape(len(kept), -1)
    change = np.diff(whole, axis=0, prepend=np.zeros((1, whole.shape[1]), np.int16)).ravel()
    zigzag = ((change << 1) ^ (change >> 15)).astype(np.uint16)
    planes = np.concatenate([(zigzag & 255).astype(np.uint8), (zigzag >> 8).astype(np.uint8)])
    data = base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode("ascii")
    return {"count": kept.shape[1], "every": every, "step": step, "centre": centre.tolist(), "data": data}


def pack_motions(motions: Sequence[ReportMotion], budget: int) -> tuple[list[dict[str, Any]], str]:
    """Return the motions for the player within `budget` bytes, and a sentence on what had to be left out.

    Meshes are thinned out in time first, then left out from the last motion on, then whole motions are.
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
        # Half of what the coarsest would grow to is less than any stride needs: do not try what cannot fit.
        hopeful = [every for every in STRIDES if 0.5 * sizes[count - 1] * STRIDES[-1] / every <= left] or [STRIDES[-1]]
        for every in hopeful:
            meshes = [_meshes(motion, every) for motion in motions[:count]]
            if sum(_size(m) for m in meshes) <= left:
                break
        for target, found in zip(packed, meshes, strict=False):
            target.update(found)
    if any(motion.mesh(run) is not None for motion in motions[count : len(packed)] for run in RUNS):
        note = (note + " The cloth between the points is shown for the first takes only.").strip()
    return packed, note


def _without_meshes(motion: ReportMotion) -> dict[str, Any]:
    return {
        "take_id": motion.take_id,
        "is_held_out": motion.is_held_out,
        "point_names": list(motion.point_names),
        "time": [round(float(t), 4) for t in motion.time],
        "real": pack(motion.real, POINT_STEP),
        "held": pack(motion.held, POINT_STEP),
        "points": {run: pack(motion.points(run), POINT_STEP) for run in RUNS},
        "meshes": dict.fromkeys(RUNS),
        "triangles": [],
    }


def _meshes(motion: ReportMotion, every: int) -> dict[str, Any]:
    meshes = {run: pack(motion.mesh(run), MESH_STEP, every) for run in RUNS}
    is_shown = motion.triangles is not None and any(meshes.values())
    return {"meshes": meshes, "triangles": np.asarray(motion.triangles).tolist() if is_shown else []}


def _size(packed: dict[str, Any]) -> int:
    tracks = [packed.get("real"), packed.get("held"), *packed.get("points", {}).values(), *packed["meshes"].values()]
    numbers = 8 * len(packed.get("time", [])) + 16 * len(packed["triangles"])
    return numbers + sum(len(track["data"]) + 120 for track in tracks if track)
