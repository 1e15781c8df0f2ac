"""Export everything in a take as arrays: NPZ, one file a take, or Parquet, one table of many takes."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from formats.errors import TakeError
from formats.outputs import write_bytes
from formats.take import Take, told_apart
from formats.unfinished import ANOTHER_FOLDER

ARRAYS = (
    "time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers", "pitch",
    "pitch_sd", "points_hidden", "quality",
)  # fmt: skip


def write_npz(path: Path, take: Take, *, overwrite: bool = True) -> None:
    """Write a take's arrays by their names in `formats.take.Take`, metres and seconds, and `about`, a JSON text.

    Raises:
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
    about = {
        "take_id": take.take_id, "created": take.created, "source": take.source, "notes": take.notes,
        "is_complete": take.is_complete, "missing_s": [[str(a), str(b)] for a, b in take.missing],
        "rig": msgspec.to_builtins(take.rig), "garment": msgspec.to_builtins(take.garment),
    }  # fmt: skip
    arrays = {name: getattr(take, name) for name in ARRAYS if getattr(take, name) is not None}
    for number, scan in enumerate(take.scans):
        arrays |= {
            f"scan{number}_time": scan.time,
            f"scan{number}_grid": scan.grid,
            f"scan{number}_contour": scan.contour,
        }
    stream = io.BytesIO()
    np.savez_compressed(stream, about=np.array(json.dumps(about)), **arrays)
    write_bytes(path, stream.getvalue(), overwrite=overwrite, instead=ANOTHER_FOLDER)


def write_parquet(path: Path, takes: Sequence[Take], *, overwrite: bool = True) -> None:
    """Write many takes as one table: a row for each point in each frame, metres and seconds, null where not seen.

    Raises:
        ModuleNotFoundError: PyArrow is not installed.
        TakeError: two takes have one id, so that their rows could not be distinguished.
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    ids = [take.take_id for take in takes]
    same = [which for take, which in zip(takes, told_apart(takes), strict=True) if ids.count(take.take_id) > 1]
    if same:
        advice = "name each take once, and write another one of this id to a file of its own"
        raise TakeError(f"takes have one id: {' and '.join(same[:2])}", where=path, advice=advice)
    table = pa.concat_tables([pa.table(_rows(take, pa)) for take in takes])
    stream = io.BytesIO()
    pq.write_table(table, stream, compression="zstd")
    write_bytes(path, stream.getvalue(), overwrite=overwrite)


def _rows(take: Take, pa: Any) -> dict[str, Any]:
    """Return the columns of one take's rows, frame by frame, its held ends before its points."""
    names = ["held_left", "held_right", *take.garment.point_names]
    places = np.concatenate([take.held, take.points], axis=1)
    deviations = np.concatenate([take.held_sd, take.points_sd], axis=1)
    hidden = np.zeros(take.points_valid.shape, bool) if take.points_hidden is None else take.points_hidden
    hidden = np.concatenate([np.zeros((len(take.time), 2), bool), hidden], axis=1)
    frames, count = places.shape[:2]

    def text(values: list[str], which: Any) -> Any:
        return pa.DictionaryArray.from_arrays(pa.array(which, pa.int32()), pa.array(values, pa.string()))

    def number(values: Any) -> Any:
        flat = np.ascontiguousarray(values, float).ravel()
        return pa.array(flat, mask=~np.isfinite(flat))

    return {
        "take_id": text([take.take_id], np.zeros(frames * count, int)),
        "frame": pa.array(np.repeat(np.arange(frames), count), pa.int64()),
        "time_s": number(np.repeat(take.time, count)),
        "place": text(names, np.tile(np.arange(count), frames)),
        **{f"{axis}_m": number(places[..., k]) for k, axis in enumerate("xyz")},
        **{f"sd_{axis}_m": number(deviations[..., k]) for k, axis in enumerate("xyz")},
        "is_hidden": pa.array(hidden.ravel()),
        "state": pa.array(np.repeat(take.state, count), pa.uint16()),
    }
