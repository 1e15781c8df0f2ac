"""Store a report's motion in a file beside it, so that `hangtime report` rebuilds the page without a simulation."""

from __future__ import annotations

import io
import zipfile
import zlib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fit.errors import FitError
from fit.report.motion import ReportMotion, Run
from fit.report.origin import Origin
from formats.arrays import Floats, Indices
from formats.diagnosis_records import Diagnosis
from formats.fit_records import FitResult
from formats.system_causes import step_to_write
from formats.whole_files import check_ends, write_whole

FORMAT = "hangtime-report-motion/1"
STEP = 1e-4  # m: rounding step of positions, a tenth of the sensor's noise
NOT_SEEN, FARTHEST_KEPT = np.iinfo(np.int32).min, 10**8  # 10 km: positions farther away belong to cloth that blew up
FAULT = "is no motion of a report"
MOST_UNPACKED = 1 << 28  # bytes: hundreds of times the motion of a page of 1.5 MB


class _Head(msgspec.Struct, frozen=True, kw_only=True):
    format: str
    created: str
    origin: Origin
    takes: list[dict[str, Any]]


def place_beside(report: Path) -> Path:
    """Return the path of a report's motion file: `report.html` has `report.motion.npz`."""
    return report.with_suffix(".motion.npz")


def created_of(fit: FitResult | None, diagnosis: Diagnosis | None) -> str:
    """Return the creation time of the result to which a report's motion belongs."""
    return next((record.created for record in (diagnosis, fit) if record is not None), "")


def save_motions(report: Path, motions: list[ReportMotion], origin: Origin, created: str) -> None:
    """Store a report's motions and provenance beside it.

    created: creation time of the shown result; a page of another result will not use this motion

    Raises:
        FitError: the file cannot be written.
    """
    takes: list[dict[str, Any]] = []
    arrays: dict[str, Any] = {}
    for number, motion in enumerate(motions):
        takes.append({
            "take_id": motion.take_id, "is_held_out": motion.is_held_out, "point_names": list(motion.point_names),
            "runs": list(motion.shown), "pull_hz": motion.pull_hz, "is_material": motion.is_material,
        })  # fmt: skip
        tracks = {"real": motion.real, "held": motion.held}
        tracks |= {f"points_{name}": run.points for name, run in motion.runs.items()}
        tracks |= {f"mesh_{name}": run.mesh for name, run in motion.runs.items()}
        arrays |= {f"{number}_{name}": _rounded(track) for name, track in tracks.items() if track is not None}
        plain = {"time": motion.time, "triangles": motion.triangles, "free": motion.free, "outline": motion.outline}
        arrays |= {f"{number}_{name}": np.asarray(value) for name, value in plain.items() if value is not None}
    head = msgspec.json.encode(_Head(format=FORMAT, created=created, origin=origin, takes=takes))
    packed = io.BytesIO()
    np.savez_compressed(packed, head=np.frombuffer(head, np.uint8), **arrays)
    path = place_beside(report)
    try:
        write_whole(path, packed.getvalue())
    except OSError as error:
        raise FitError(
            f"the report's motion cannot be written ({error.strerror})", where=path, advice=step_to_write(error)
        ) from error


def load_motions(report: Path, created: str) -> tuple[list[ReportMotion], Origin | None]:
    """Return the motions and the provenance stored beside a report; nothing if absent or of another result.

    Raises:
        FitError: the file is there and cannot be read.
    """
    path = place_beside(report)
    if not path.exists():
        return [], None
    try:
        check_ends(path)
        with zipfile.ZipFile(path) as archive:
            if sum(part.file_size for part in archive.infolist()) > MOST_UNPACKED:
                raise FitError(FAULT, where=path, advice="remove it, or fit or diagnose the takes again")
        with np.load(path, allow_pickle=False) as arrays:
            head = msgspec.json.decode(arrays["head"].tobytes(), type=_Head)
            if head.format != FORMAT:
                raise FitError(f"{FAULT} of this version", where=path, advice="fit or diagnose the takes again")
            if head.created != created:
                return [], None
            return [_motion(number, take, arrays) for number, take in enumerate(head.takes)], head.origin
    except (
        OSError, EOFError, ValueError, KeyError, TypeError, RuntimeError, MemoryError, SyntaxError, zlib.error,
        zipfile.BadZipFile, msgspec.MsgspecError,
    ) as error:  # fmt: skip
        raise FitError(FAULT, where=path, advice="remove it, or fit or diagnose the takes again") from error


def _motion(number: int, take: dict[str, Any], arrays: Any) -> ReportMotion:
    def plain(name: str) -> Any:
        return arrays.get(f"{number}_{name}")

    def track(name: str) -> Any:
        found = plain(name)
        if found is None:
            return None
        steps = np.cumsum(found, axis=0, dtype=np.int32)
        return np.where(steps == NOT_SEEN, np.nan, steps * STEP)

    def run(name: str) -> Run:
        return Run(points=track(f"points_{name}"), mesh=track(f"mesh_{name}"))

    return ReportMotion(
        take_id=take["take_id"], is_held_out=take["is_held_out"], time=plain("time"), real=track("real"),
        point_names=tuple(take["point_names"]), runs={name: run(name) for name in take["runs"]},
        triangles=plain("triangles"), pull_hz=take["pull_hz"], held=track("held"), free=plain("free"),
        is_material=take["is_material"], outline=plain("outline"),
    )  # fmt: skip


def _rounded(track: Floats) -> Indices:
    """Return positions [m], (frames, n, 3), as differences of whole steps from frame to frame, modulo 2^32."""
    known = np.isfinite(track)
    steps = np.clip(np.round(np.where(known, track, 0.0) / STEP), -FARTHEST_KEPT, FARTHEST_KEPT).astype(np.int32)
    return np.diff(np.where(known, steps, np.int32(NOT_SEEN)), axis=0, prepend=np.int32(0))
