"""Import re-packed recordings of a cloth that a robot arm swung (github Alados5/tfm_matlab, IRI CSIC-UPC).

Each take is one `.npz` file with these arrays:

- `t` [s], (frames,)
- `points` [m], (frames, points, 3): a whole grid, z up; 8 x 8 in the public recordings
- `valid`, (frames, points)
- `hanger_corners` [m], (frames, 2, 3): the two held corners
- `rest` [m], (points, 2): positions on the flat cloth

The points follow the silhouette, so they slide over the cloth.
"""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from formats.arrays import Booleans, Floats
from formats.blocks import FARTHEST_PLACE
from formats.errors import TakeError
from formats.garment import Garment, TrackedPoint
from formats.importers.arm_path import check_arm_path, check_clock, path_beside, read_arm_path
from formats.importers.folders import refuse_folder
from formats.importers.marker_files import FILE_ENDINGS
from formats.importers.npz import kind_of, load_arrays
from formats.importers.path_outliers import refuse_jumps
from formats.importers.units import other_unit
from formats.meant_units import unit_of
from formats.plausible import LONGEST, SHORTEST, check_plausible_times
from formats.rig import Rig
from formats.take import Take
from formats.two_clocks import at_times, with_hanger

MOST_BYTES_OF_ARRAYS = 1 << 27  # of all arrays: two hours of 64 points at 9 frames a second
FRAME_COUNT, POINT_COUNT = -1, -2  # sizes: the number of times, and of positions on the flat cloth
SHAPES: dict[str, tuple[int, ...]] = {
    "t": (FRAME_COUNT,), "points": (FRAME_COUNT, POINT_COUNT, 3), "valid": (FRAME_COUNT, POINT_COUNT),
    "hanger_corners": (FRAME_COUNT, 2, 3),
    "rest": (POINT_COUNT, 2),
}  # fmt: skip
FEWEST_GRID_POINTS = 9  # of a grid; our choice: three rows of three, the fewest that bend both ways
# m, tolerance within which positions share a row or column. Our choice: above rounding, and below a tenth of the
# points' distance.
SAME_LINE_METRES = 1e-3
MEDIAN_DENSITY = 0.197  # kg/m^2, median of 618 fabrics, ClothDrapeTester (SIGGRAPH Asia 2022)
MASS_NOTE = "not recorded; the garment's weight is that of the median of 618 fabrics"
# m between a described point and its position in the grid. Our choice: a ruler's reading errs by 1 mm at either end.
DESCRIBED_WITHIN = 2e-3
LEAST_WIDE, MOST_WIDE = 0.4, 1.6  # of the flat distances, median over neighbours: 0.98 in the public recordings
FARTHEST_HELD = 0.5  # of the cloth's side, median distance of corners from the held row: public recordings have < 0.1
# of the side, tolerance within which a position is in the held row. Our choice: above rounding, and far below the
# distance of rows.
ON_TOP = 1e-3
POINT_SD = (0.0028, 0.0019, 0.0028)  # m, static noise measured on these recordings
STATED_HELD_SD = 0.002  # m; our choice: the robot's pose is better than the fitted offset to the corners
WHAT_TO_GIVE = (
    "give marker paths (.c3d, .trc, .csv, .tsv, .txt), a swung-cloth .npz or one of `takes export`, see "
    "docs/reference/file-formats.md"
)

OTHER_DOORS = {
    ".mcap": "a take needs no import: `hangtime fit` reads it",
    ".partial": "`hangtime takes recover` makes a take of it",
    ".oni": "`hangtime record --sensor FILE` makes a take of a sensor's recording",
    ".bvh": "`hangtime animate --bvh FILE` lets a figure move as it says",
}


def import_swung_cloth(
    path: Path, described: Garment | None = None, *, hanger: Path | None = None, anyway: bool | None = None
) -> Take:
    """Return the take in one `.npz` file.

    described: a garment of known weight and name; its outline and tracked points match the file, in any order and from
    any origin

    hanger: the hanger's trajectory on its own clock (`formats.importers.arm_path`), instead of `hanger_corners`: a
    file, or a folder with a file of the same name

    anyway: accept implausible times and poses that jump; None: refuse them, and do not offer --anyway in the error

    Raises:
        TakeError: a file is missing or is no such recording, its time does not increase or is not in seconds, or it
            shows another garment than the described one.
    """
    data = _load(path)
    if not anyway:
        check_plausible_times(data["t"].astype(float), path, offers_anyway=anyway is not None)
    time, points = data["t"].astype(float), data["points"].astype(float)
    frames = len(time)
    rest = data["rest"].astype(float)
    width, height = (round(float(size), 6) for size in np.ptp(rest, axis=0))
    rest = np.round(rest - [rest[:, 0].min() + width / 2, rest[:, 1].max()], 6)
    valid = data["valid"].astype(bool) & np.isfinite(points).all(2)
    if not valid.any():
        raise TakeError(
            "no point was ever seen", where=path, advice="give a recording that has finite points where `valid` is true"
        )
    held, own, clock = data["hanger_corners"].astype(float), None, ""
    _refuse_infinity("points", np.where(data["valid"].astype(bool)[..., None], points, 0.0), path)
    _refuse_infinity("hanger_corners", held, path)
    if not anyway:
        _check_places(points, valid, held, rest, path)
    if hanger is not None:
        own = read_arm_path(path_beside(hanger, path), anyway=anyway)
        pictures, held = held, at_times(time, own.time, own.held)
        if not np.isfinite(held).any():
            raise TakeError(
                "its times are none of the recording's", where=own.file,
                advice="give the path of the same take, on a clock of the same zero",
            )  # fmt: skip
        if np.isfinite(pictures).any():
            clock = check_arm_path(own, time, pictures)
        else:
            clock = check_clock(own, time, _row_ends(points, valid, rest))
        if not anyway:
            advice = "leave such poses out of 'tcp_t' and 'tcp_pose'"
            refuse_jumps(own.time, own.held, own.file, one="pose", advice=advice, offers_anyway=anyway is not None)
    is_crossed = _is_crossed(held, points, valid, rest)
    held = held[:, ::-1] if is_crossed else held
    held_valid = np.isfinite(held).all(2)
    half = width / 2
    order = np.arange(len(rest))
    garment = described or Garment(
        format="hangtime-garment/2", name="swung cloth", kind="swatch", points_are="silhouette",
        mass_kg=round(MEDIAN_DENSITY * width * height, 6),
        outline_m=((-half, 0.0), (half, 0.0), (half, -height), (-half, -height)), held="edge",
        points=tuple(
            TrackedPoint(name=name, at_m=(float(x), float(y))) for name, (x, y) in zip(_names(rest), rest, strict=True)
        ),
    )  # fmt: skip
    if described is not None:
        order = _places_of(described, rest, path)
        if described.points_are is None:
            garment = msgspec.structs.replace(described, format="hangtime-garment/2", points_are="silhouette")
    points, valid = points[:, order], valid[:, order]
    take = Take(
        take_id=path.stem,
        created=datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds"),
        rig=Rig(format="hangtime-rig/1", name="robot arm, robot base frame", gravity=(0.0, 0.0, -1.0)),
        garment=garment,
        time=time - time[0],
        held=held,
        held_valid=held_valid,
        held_sd=np.full(held.shape, STATED_HELD_SD),
        points=np.where(valid[..., None], points, np.nan),
        points_valid=valid,
        points_sd=np.broadcast_to(np.array(POINT_SD), points.shape).copy(),
        state=np.zeros(frames, np.uint16),
        markers=held,
        source=f"{path.name}, re-packed from Alados5/tfm_matlab",
        notes={
            **({} if described is not None else {"mass": MASS_NOTE}),
            "points": "a re-gridded silhouette, not material markers: edges are eaten, corners jump",
            **({"clock": f"{own.file.name}: {clock}"} if own is not None and clock else {}),
        },
    )
    if own is None:
        return take
    corners = own.held[:, ::-1] if is_crossed else own.held
    return with_hanger(take, own.time - time[0], corners, STATED_HELD_SD)


def _refuse_infinity(name: str, places: Floats, path: Path) -> None:
    """Refuse places with an infinite coordinate, (frames, places, 3), as in a C3D file."""
    infinite = np.argwhere(np.isinf(places).any(2))
    if len(infinite):
        frame, place = infinite[0].tolist()
        more = f", the first of {len(infinite)} such places" if len(infinite) > 1 else ""
        raise TakeError(
            f"its {name!r} hold inf, which is no number, at frame {frame}, place {place}{more}", where=path,
            advice="export it again, with places that were not seen as NaN",
        )  # fmt: skip


def _check_places(points: Floats, valid: Booleans, held: Floats, rest: Floats, path: Path) -> None:
    """Refuse positions in another unit than the flat cloth, corners away from the cloth, and cloth that hangs upwards.

    - `points` [m], (frames, points, 3), where `valid`, (frames, points)
    - `held` [m], (frames, 2, 3); `rest` [m], (points, 2)

    Raises:
        TakeError: names the contradiction.
    """
    side = float(np.ptp(rest, axis=0).max())
    if not SHORTEST <= side <= LONGEST:
        raise TakeError(
            f"its cloth is {side:g} m long in 'rest', a garment {SHORTEST:g} to {LONGEST:g} m"
            f"{unit_of(side, SHORTEST, LONGEST)}", where=path, advice="give metres",
        )  # fmt: skip
    seen = np.where(valid[..., None], points, np.nan)
    flat = np.linalg.norm(np.diff(rest, axis=0), axis=1)
    apart = np.linalg.norm(np.diff(seen, axis=1), axis=2)[:, flat > 0] / flat[flat > 0]
    if np.isfinite(apart).any() and not LEAST_WIDE <= (ratio := float(np.nanmedian(apart))) <= MOST_WIDE:
        raise TakeError(
            f"its points are {ratio:.3g} times as far apart as in 'rest'{other_unit(ratio)}", where=path,
            advice="give 'points', 'hanger_corners' and 'rest' in metres",
        )  # fmt: skip
    top = rest[:, 1] > rest[:, 1].max() - ON_TOP * side
    away = np.linalg.norm(seen[:, top, None] - held[:, None], axis=3)
    nearest = np.nanmin(np.where(np.isfinite(away), away, np.inf), axis=1)
    if np.isfinite(nearest).any() and (far := float(np.median(nearest[np.isfinite(nearest)]))) > FARTHEST_HELD * side:
        raise TakeError(
            f"its hanger_corners are {far:.3g} m from the held row of its points, in the median", where=path,
            advice="give both in metres, in one frame and at the same times",
        )  # fmt: skip
    below = held[..., 2].mean(1)[:, None] - seen[:, ~top, 2]
    if np.isfinite(below).any() and float(np.nanmedian(below)) <= 0:
        raise TakeError(
            "its points lie above its hanger_corners, in the median", where=path, advice="turn both so that z points up"
        )


def _row_ends(points: Floats, valid: Booleans, rest: Floats) -> Floats:
    """Return the ends of the tracked held row [m], (frames, 2, 3), NaN where not seen."""
    top = np.flatnonzero(rest[:, 1] > rest[:, 1].max() - ON_TOP * np.ptp(rest, axis=0).max())
    ends = top[[rest[top, 0].argmin(), rest[top, 0].argmax()]]
    return np.where(valid[:, ends, None], points[:, ends], np.nan)


def _places_of(garment: Garment, rest: NDArray[Any], path: Path) -> NDArray[Any]:
    """Return the index of each described point in the file's flat grid, (points,).

    Raises:
        TakeError: the garment is held otherwise, has another outline, or has a point that the file lacks.
    """
    origin = np.mean(garment.outline_m[:2], axis=0)
    outline = np.array(garment.outline_m) - origin
    advice = "describe the grid of the file, or leave out --garment"
    if garment.held != "edge" or np.abs(np.ptp(outline, axis=0) - np.ptp(rest, axis=0)).max() > DESCRIBED_WITHIN:
        width, height = np.ptp(rest, axis=0)
        raise TakeError(
            f"its cloth is {width:g} m x {height:g} m and held along its top edge, the described garment is not",
            where=path, advice=advice,
        )  # fmt: skip
    apart = np.linalg.norm((np.array([p.at_m for p in garment.points]) - origin)[:, None] - rest, axis=2)
    astray = np.flatnonzero(apart.min(1) > DESCRIBED_WITHIN)
    if len(astray):
        raise TakeError(
            f"has no point where the described garment has {garment.points[int(astray[0])].name!r}", where=path,
            advice=advice,
        )  # fmt: skip
    return np.asarray(apart.argmin(1))


def _names(rest: NDArray[Any]) -> list[str]:
    """Name the points of a grid by row, from the bottom, and column, from the left."""
    row, column = (_line(rest[:, axis]) for axis in (1, 0))
    return [f"row{r}_column{c}" for r, c in zip(row, column, strict=True)]


def _line(values: NDArray[Any]) -> list[int]:
    """Return the row or column number of each value, the smallest value first."""
    order = np.argsort(values)
    number = np.empty(len(values), int)
    number[order] = np.cumsum(np.diff(values[order], prepend=values[order][:1]) > SAME_LINE_METRES)
    return [int(n) for n in number]


def _is_crossed(held: NDArray[Any], points: NDArray[Any], valid: NDArray[Any], rest: NDArray[Any]) -> bool:
    """Return whether the first held corner belongs to the larger x of the flat cloth, so that the two are exchanged."""
    top = np.flatnonzero(np.isclose(rest[:, 1], rest[:, 1].max()))
    left, right = top[np.argmin(rest[top, 0])], top[np.argmax(rest[top, 0])]
    seen = valid[:, left] & valid[:, right] & np.isfinite(held).all((1, 2))
    straight = np.linalg.norm(held[seen] - points[seen][:, [left, right]], axis=2).sum()
    crossed = np.linalg.norm(held[seen] - points[seen][:, [right, left]], axis=2).sum()
    return bool(straight > crossed)


def _load(path: Path) -> dict[str, NDArray[Any]]:
    """Return the needed arrays, with shapes and types checked."""
    refuse_folder(path, (*FILE_ENDINGS, ".npz"))
    if path.suffix.lower() != ".npz" and os.path.isfile(path):
        ends = f"ends in {path.suffix}" if path.suffix else "has no ending"
        raise TakeError(
            f"{ends}, which is no kind of file that can be imported", where=path,
            advice=OTHER_DOORS.get(path.suffix.lower(), WHAT_TO_GIVE),
        )  # fmt: skip
    data = load_arrays(path, SHAPES, most_bytes=MOST_BYTES_OF_ARRAYS, advice=WHAT_TO_GIVE)
    _check_arrays(data, path)
    return data


def _check_arrays(data: dict[str, NDArray[Any]], path: Path) -> None:
    """Refuse arrays whose shapes or types differ from `SHAPES`, and times that do not increase."""
    counts = {FRAME_COUNT: len(data["t"]) if data["t"].ndim else 0}
    counts[POINT_COUNT] = data["points"].shape[1] if data["points"].ndim == 3 else 0
    frames = counts[FRAME_COUNT]
    for name, shape in SHAPES.items():
        found, needed = data[name].shape, tuple(counts.get(size, size) for size in shape)
        if found != needed:
            raise TakeError(f"the array {name!r} has shape {found}, not {needed}", where=path, advice=WHAT_TO_GIVE)
        if data[name].dtype.kind not in "biuf":
            raise TakeError(
                f"the array {name!r} holds {kind_of(data[name])}, not real numbers", where=path, advice=WHAT_TO_GIVE
            )
    if not frames:
        raise TakeError("has no frames", where=path, advice="export it again")
    if not np.isfinite(data["rest"]).all():
        raise TakeError("a place on the flat cloth ('rest') is not a number", where=path, advice="export it again")
    for name in ("points", "hanger_corners", "rest"):
        places = data[name].astype(float)
        if np.abs(places[np.isfinite(places)]).max(initial=0.0) > FARTHEST_PLACE:
            raise TakeError(
                f"the array {name!r} has places beyond {FARTHEST_PLACE:g} m", where=path, advice="export it in metres"
            )
    lines = [_line(data["rest"][:, axis].astype(float)) for axis in (1, 0)]
    size = int(np.prod([max(line, default=-1) + 1 for line in lines]))
    if not len(set(zip(*lines, strict=True))) == size == counts[POINT_COUNT] >= FEWEST_GRID_POINTS:
        raise TakeError(
            f"its {counts[POINT_COUNT]} places on the flat cloth ('rest') are no whole grid", where=path,
            advice=f"give every place once, {FEWEST_GRID_POINTS} or more of them, rows and columns along x and y",
        )  # fmt: skip
    time = data["t"].astype(float)
    wrong = np.flatnonzero(~np.isfinite(time) | ~np.concatenate([[True], time[1:] > time[:-1]]))
    if len(wrong):
        raise TakeError(
            f"its time does not increase from frame to frame, first at frame {wrong[0]}, at {time[wrong[0]]:g} s",
            where=path, advice="mend 't', or leave that frame out of every array",
        )  # fmt: skip
