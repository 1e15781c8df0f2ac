"""Import of re-packed recordings of a cloth swung by a robot arm (github Alados5/tfm_matlab, IRI CSIC-UPC).

One `.npz` per take: `t` (T,) s; `points` (T, 64, 3) m, an 8 x 8 grid, z up; `valid` (T, 64); `hanger_corners` (T, 2, 3)
m, the two held corners; `rest` (64, 2) m, places on the flat cloth.
"""

from __future__ import annotations

import zipfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formats.errors import TakeError
from formats.garment import Garment, TrackedPoint
from formats.rig import Rig
from formats.take import Take

NEEDED = ("t", "points", "valid", "hanger_corners", "rest")
MEDIAN_DENSITY = 0.197  # kg/m^2, median of 618 fabrics, ClothDrapeTester (SIGGRAPH Asia 2022)
POINT_SD = (0.0028, 0.0019, 0.0028)  # m, static noise measured on these recordings
HELD_SD = 0.002  # m, stated by us: the robot's pose is better than the fitted offset to the corners


def import_swung_cloth(path: Path) -> Take:
    """Return the take in one `.npz` file.

    Raises:
        TakeError: the file is missing or is no such recording.
    """
    data = _load(path)
    time, points = data["t"].astype(float), data["points"].astype(float)
    frames = len(points)
    if (
        points.shape != (frames, 64, 3)
        or data["rest"].shape != (64, 2)
        or data["hanger_corners"].shape != (frames, 2, 3)
    ):
        raise TakeError(
            f"points have shape {points.shape}, not (frames, 64, 3)", where=path, advice="see docs/real-cloth.md"
        )
    rest = data["rest"].astype(float)
    width, height = (round(float(size), 6) for size in np.ptp(rest, axis=0))
    rest = np.round(rest - [rest[:, 0].min() + width / 2, rest[:, 1].max()], 6)
    held = _left_first(data["hanger_corners"].astype(float), points, data["valid"], rest)
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(time)) > 0])
    valid = data["valid"].astype(bool) & np.isfinite(points).all(2)
    held_valid = np.isfinite(held).all(2)
    half = width / 2
    garment = Garment(
        format="hangtime-garment/1", name="swung cloth", kind="swatch",
        mass_kg=round(MEDIAN_DENSITY * width * height, 6),
        outline_m=((-half, 0.0), (half, 0.0), (half, -height), (-half, -height)), held="edge",
        points=tuple(
            TrackedPoint(name=f"row{k // 8}_column{k % 8}", at_m=(float(x), float(y))) for k, (x, y) in enumerate(rest)
        ),
    )  # fmt: skip
    return Take(
        take_id=path.stem,
        created=datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds"),
        rig=Rig(format="hangtime-rig/1", name="robot arm, robot base frame", gravity=(0.0, 0.0, -1.0)),
        garment=garment,
        time=time[keep] - time[keep][0],
        held=held[keep],
        held_valid=held_valid[keep],
        held_sd=np.full((int(keep.sum()), 2, 3), HELD_SD),
        points=np.where(valid[..., None], points, np.nan)[keep],
        points_valid=valid[keep],
        points_sd=np.broadcast_to(np.array(POINT_SD), points.shape)[keep].copy(),
        state=np.zeros(int(keep.sum()), np.uint16),
        markers=held[keep],
        source=f"{path.name}, re-packed from Alados5/tfm_matlab",
        notes={
            "mass": "not recorded; the garment's weight is that of the median of 618 fabrics",
            "points": "a re-gridded silhouette, not material markers: edges are eaten, corners jump",
        },
    )


def _left_first(held: NDArray[Any], points: NDArray[Any], valid: NDArray[Any], rest: NDArray[Any]) -> NDArray[Any]:
    """Order the held corners so that the first is the one at the smaller x of the flat cloth."""
    top = np.flatnonzero(np.isclose(rest[:, 1], rest[:, 1].max()))
    left, right = top[np.argmin(rest[top, 0])], top[np.argmax(rest[top, 0])]
    seen = valid[:, left] & valid[:, right] & np.isfinite(held).all((1, 2))
    straight = np.linalg.norm(held[seen] - points[seen][:, [left, right]], axis=2).sum()
    crossed = np.linalg.norm(held[seen] - points[seen][:, [right, left]], axis=2).sum()
    return held if straight <= crossed else held[:, ::-1]


def _load(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            absent = [k for k in NEEDED if k not in archive]
            if absent:
                raise TakeError(
                    f"has no array {absent[0]!r}", where=path, advice="only swung-cloth .npz files can be imported"
                )
            return {k: archive[k] for k in NEEDED}
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror or error})", where=path, advice="check the path") from error
    except (ValueError, zipfile.BadZipFile) as error:
        raise TakeError(
            "is not an .npz archive", where=path, advice="only swung-cloth .npz files can be imported"
        ) from error
