"""Read the take in an NPZ file that `hangtime takes export` wrote, with all its arrays, its rig and its garment.

`formats.exporters.arrays.write_npz` describes the file. No object is unpickled.
"""

from __future__ import annotations

import json
import os
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.blocks import OPTIONAL, STORED, TICKS, as_arrays, check_columns
from formats.errors import TakeError
from formats.importers.npz import load_arrays
from formats.missing import possible_spans
from formats.surface import SurfaceScan, encode_scan
from formats.take import Take
from formats.take_header import described
from formats.take_writer import MOST_HEADER_BYTES, PROFILE
from formats.zip_members import members_of

ABOUT = "about"
SCAN = re.compile(r"scan(\d{1,6})_(?:time|grid|contour)")
MOST_ABOUT = 8 * MOST_HEADER_BYTES  # bytes: NumPy stores a letter in 4, and JSON may need two where a take needs one
MOST_ARRAYS = 1 << 30  # bytes of all arrays as 64-bit numbers: an hour of 81 markers at 70 frames a second
EXPORT_AGAIN = "export the take again with `hangtime takes export --to npz`"
Arrays = dict[str, NDArray[Any]]


def holds_a_take(path: Path) -> bool:
    """Return whether a file is an archive of arrays with a text about a take; False where it cannot be read."""
    return f"{ABOUT}.npy" in _names_in(path)


def import_own_arrays(path: Path) -> Take:
    """Return the take in one exported `.npz` file, exactly as it was exported.

    Raises:
        TakeError: the file cannot be read, lacks an array, or holds values that no take has; names them.
    """
    names = {name.removesuffix(".npy") for name in _names_in(path)}
    text = load_arrays(path, (ABOUT,), most_bytes=MOST_ABOUT, advice=EXPORT_AGAIN)[ABOUT]
    needed = [name for name in STORED if name in names or name not in OPTIONAL]
    scans = sorted({int(found[1]) for name in names if (found := SCAN.fullmatch(name))})
    parts = [f"scan{number}_{part}" for number in scans for part in ("time", "grid", "contour")]
    arrays = load_arrays(path, (*needed, *parts), most_bytes=MOST_ARRAYS, advice=EXPORT_AGAIN)
    try:
        return _take(path, _about(text, path), arrays, scans)
    except TakeError as error:  # of a take's own parts, whose advice is for the one who records
        raise TakeError(error.what, where=error.where, advice=EXPORT_AGAIN) from error


def _names_in(path: Path) -> set[str]:
    if not os.path.isfile(path):  # a pipe would wait for its writer
        return set()
    try:
        with path.open("rb") as file:
            return {part.filename for part in members_of(file)}
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile):
        return set()


def _about(text: NDArray[Any], path: Path) -> dict[str, Any]:
    try:
        about = json.loads(str(text)) if text.dtype.kind == "U" and not text.ndim else None
        json.dumps(about, ensure_ascii=False).encode()  # no file can keep half a character, as of UTF-16
    except (ValueError, RecursionError):
        about = None
    if not isinstance(about, dict):
        raise TakeError(f"its array {ABOUT!r} is no text that describes a take", where=path, advice=EXPORT_AGAIN)
    return about


def _take(path: Path, about: dict[str, Any], arrays: Arrays, scans: list[int]) -> Take:
    rig, garment, words = described(about | {"format": PROFILE, "missing": _missing(about, path)}, path)
    columns = as_arrays({name: arrays[name] for name in STORED if name in arrays}, path)
    frames = columns["time"].shape
    absent = dict.fromkeys(OPTIONAL[:3], np.full(frames, np.nan))
    unseen = {"points_hidden": np.zeros(columns["points_valid"].shape, bool)}
    points = len(garment.points)
    if frames == (0,):
        raise TakeError("holds no frame", where=path, advice=EXPORT_AGAIN)
    check_columns({**absent, **unseen, **columns}, points=points, take_id=str(path), first=0, after=-np.inf)
    if not {*words.missing} <= {*possible_spans(words.missing, columns["time"])}:
        raise TakeError("its missing_s has a span in which no frames can be missing", where=path, advice=EXPORT_AGAIN)
    values: dict[str, Any] = columns | {
        name: columns[name].astype(bool) for name in ("held_valid", "points_valid", "points_hidden") if name in columns
    }
    for name in ("held", "points"):
        values[name] = np.where(values[f"{name}_valid"][..., None], values[name], np.nan)
    values["state"] = values["state"].astype(np.uint16)
    found = tuple(_scan(arrays, number, path) for number in scans)
    if len({round(scan.time * TICKS) for scan in found}) < len(found):
        raise TakeError("has two scans of the surface at one time", where=path, advice=EXPORT_AGAIN)
    return Take(
        take_id=words.take_id, created=words.created, rig=rig, garment=garment, source=words.source, notes=words.notes,
        is_complete=about.get("is_complete") is True, missing=words.missing,
        scans=found, **values,
    )  # fmt: skip


def _missing(about: dict[str, Any], path: Path) -> list[list[float]]:
    """Return the spans without frames [s]; JSON has no infinite numbers, so they are texts."""
    try:
        return [[float(end) for end in span] for span in about.get("missing_s", [])]
    except (TypeError, ValueError) as error:
        raise TakeError("its missing_s must be pairs of seconds", where=path, advice=EXPORT_AGAIN) from error


def _scan(arrays: Arrays, number: int, path: Path) -> SurfaceScan:
    time, grid, contour = (arrays[f"scan{number}_{part}"] for part in ("time", "grid", "contour"))
    if time.ndim or any(one.dtype.kind not in "iuf" for one in (time, grid, contour)):
        raise TakeError(f"scan {number} is no time with arrays of numbers", where=path, advice=EXPORT_AGAIN)
    scan = SurfaceScan(time=float(time), grid=grid.astype(float), contour=contour.astype(float))
    try:
        encode_scan(scan)
    except TakeError as error:
        raise TakeError(f"{error.where}: {error.what}", where=path, advice=EXPORT_AGAIN) from error
    return scan
