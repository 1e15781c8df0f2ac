"""Store a report's motion in a file beside it, so that `hangtime report` rebuilds the page without a simulation."""

from __future__ import annotations

import io
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from fit.errors import FitError
from fit.report.motion import RUNS, ReportMotion, Run
from fit.report.origin import Origin
from formats.arrays import Floats, Indices
from formats.diagnosis_records import Diagnosis
from formats.fit_records import FitResult
from formats.system_causes import step_to_write
from formats.whole_files import check_ends, write_whole
from formats.zip_members import members_of

FORMAT = "hangtime-report-motion/1"
STEP = 1e-4  # m: rounding step of positions, a tenth of the sensor's noise
NOT_SEEN, FARTHEST_KEPT = np.iinfo(np.int32).min, 10**8  # 10 km: positions farther away belong to cloth that blew up
PLAIN_BYTES = 1 << 24  # for the other arrays of a file: times, triangles and outlines
FAULT = "is no motion of a report"
# Types of the plain arrays.
ARRAY_KINDS = {"time": "float64", "triangles": "int64", "free": "bool", "outline": "float64"}
MOST_BYTES = 1 << 28  # of a file's positions, unpacked: 18 minutes of two runs at 30 frames a second and 330 vertices


class _Take(msgspec.Struct, frozen=True, kw_only=True):
    """The values of a motion beside its arrays, as in `ReportMotion`; `runs` are the names of its runs."""

    take_id: str
    is_held_out: bool
    point_names: tuple[str, ...]
    runs: tuple[str, ...]
    pull_hz: Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]
    is_material: bool


class _Head(msgspec.Struct, frozen=True, kw_only=True):
    format: str
    created: str
    origin: Origin
    takes: list[_Take]


def place_beside(report: Path) -> Path:
    """Return the path of a report's motion file: `report.html` has `report.motion.npz`."""
    return report.with_suffix(".motion.npz")


def created_of(fit: FitResult | None, diagnosis: Diagnosis | None) -> str:
    """Return the creation time of the result to which a report's motion belongs."""
    return next((record.created for record in (diagnosis, fit) if record is not None), "")


def save_motions(report: Path, motions: list[ReportMotion], origin: Origin, created: str) -> None:
    """Store a report's motions and provenance beside it; where they are very long, every second frame, or fewer.

    created: creation time of the shown result; a page of another result will not use this motion

    Raises:
        FitError: the file cannot be written.
    """
    takes: list[_Take] = []
    arrays: dict[str, Any] = {}
    each = -(-sum(map(_bytes_of, motions)) // MOST_BYTES)
    for number, motion in enumerate(motions if each <= 1 else [_thinned(motion, each) for motion in motions]):
        takes.append(_Take(
            take_id=motion.take_id, is_held_out=motion.is_held_out, point_names=motion.point_names, runs=motion.shown,
            pull_hz=float(motion.pull_hz), is_material=bool(motion.is_material),
        ))  # fmt: skip
        tracks = {"real": motion.real, "held": motion.held}
        tracks |= {f"points_{name}": run.points for name, run in motion.runs.items()}
        tracks |= {f"mesh_{name}": run.mesh for name, run in motion.runs.items()}
        arrays |= {f"{number}_{name}": _rounded(track) for name, track in tracks.items() if track is not None}
        plain = {"time": motion.time, "triangles": motion.triangles, "free": motion.free, "outline": motion.outline}
        arrays |= {
            f"{number}_{name}": np.asarray(value, ARRAY_KINDS[name])
            for name, value in plain.items()
            if value is not None
        }
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
        with path.open("rb") as file:
            if sum(part.file_size for part in members_of(file)) > MOST_BYTES + PLAIN_BYTES:
                raise ValueError("too many bytes unpacked")
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


def _motion(number: int, take: _Take, arrays: Any) -> ReportMotion:
    """Return one motion.

    Raises:
        ValueError: an array is missing, or has another type or shape than `save_motions` gives it.
        KeyError: the same.
    """

    def plain(name: str, *shape: int | None) -> Any:
        values = arrays[f"{number}_{name}"]
        sizes = zip(values.shape, shape, strict=True)
        if values.dtype != ARRAY_KINDS.get(name, "int32") or any(
            size != right for size, right in sizes if right is not None
        ):
            raise ValueError(f"{name} is {values.dtype} {values.shape}")
        return values

    def track(name: str, points: int | None) -> Any:
        found = plain(name, len(time), points, 3)
        steps = np.cumsum(found, axis=0, dtype=np.int32, out=found)
        return np.where(steps == NOT_SEEN, np.nan, steps * STEP)

    def has(name: str) -> bool:
        return f"{number}_{name}" in arrays

    time = plain("time", None)
    if len(time) < 2 or not (np.isfinite(time).all() and (np.diff(time) > 0).all()) or not set(take.runs) <= {*RUNS}:
        raise ValueError("its time does not increase, or a run is not known")
    points = len(take.point_names)
    runs = {
        name: Run(
            points=track(f"points_{name}", points),
            mesh=track(f"mesh_{name}", None) if has(f"mesh_{name}") else None,
        )
        for name in take.runs
    }  # fmt: skip
    triangles = plain("triangles", None, 3) if has("triangles") else None
    vertices = [run.mesh.shape[1] for run in runs.values() if run.mesh is not None]
    if triangles is not None and vertices and not ((triangles >= 0) & (triangles < min(vertices))).all():
        raise ValueError("a triangle has a corner that the mesh lacks")
    outline = plain("outline", None, 2) if has("outline") else None
    if outline is not None and not np.isfinite(outline).all():
        raise ValueError("the outline is not finite")
    return ReportMotion(
        take_id=take.take_id, is_held_out=take.is_held_out, time=time, real=track("real", points),
        point_names=take.point_names, runs=runs, triangles=triangles, pull_hz=take.pull_hz,
        held=track("held", 2) if has("held") else None, free=plain("free", points) if has("free") else None,
        is_material=take.is_material, outline=outline,
    )  # fmt: skip


def _bytes_of(motion: ReportMotion) -> int:
    """Return the bytes of a motion's stored positions."""
    tracks = [motion.real, motion.held, *(track for run in motion.runs.values() for track in (run.points, run.mesh))]
    return sum(track.size for track in tracks if track is not None) * np.dtype(np.int32).itemsize


def _thinned(motion: ReportMotion, each: int) -> ReportMotion:
    """Return a motion of every frame number that `each` divides, and of two frames at least."""
    few = slice(None, None, min(each, len(motion.time) - 1))
    runs = {
        name: Run(points=run.points[few], mesh=None if run.mesh is None else run.mesh[few])
        for name, run in motion.runs.items()
    }  # fmt: skip
    held = None if motion.held is None else motion.held[few]
    return replace(motion, time=motion.time[few], real=motion.real[few], held=held, runs=runs)


def _rounded(track: Floats) -> Indices:
    """Return positions [m], (frames, n, 3), as differences of whole steps from frame to frame, modulo 2^32."""
    known = np.isfinite(track)
    steps = np.clip(np.round(np.where(known, track, 0.0) / STEP), -FARTHEST_KEPT, FARTHEST_KEPT).astype(np.int32)
    return np.diff(np.where(known, steps, np.int32(NOT_SEEN)), axis=0, prepend=np.int32(0))
