"""Import motion capture of a garment with markers: trajectories and a garment description become a take.

The garment's points are the markers, matched by name. The markers on the two top corners of the outline hold the
garment. Their trajectories drive the simulation. Source: "Optimization of Cloth Simulation Parameters by Considering
Static and Dynamic Features", section 2.

Cloth cannot stretch by a quarter. Neighbouring markers that are farther apart mean a wrong unit, garment or naming. The
same holds for held corners that are farther apart than the cloth is wide. Markers that hang hardly lower than the held
corners mean a wrong vertical axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.blocks import FARTHEST_PLACE
from formats.errors import TakeError
from formats.findings import FEWEST_SEEN, OF_MARKERS
from formats.garment import Garment
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_neighbours import check_neighbours, warning_of_far_markers
from formats.importers.marker_tracks import EXPORT_MEASURED, MARKER_SD, MarkerTracks, Wanted, composed, nearest_label
from formats.importers.path_outliers import refuse_jumps
from formats.plain_text import counted
from formats.plausible import check_plausible_times, check_rate_alone, check_stated_rate
from formats.rig import Rig, Vector
from formats.take import FrameState, Take

ON_CORNER = 2e-3  # m, largest distance of a marker from the outline's corner
LEAST_DROP = 1 / 3  # of the flat drop, in the median over the take: the drop of cloth held at 70 degrees throughout
DOWNWARD: dict[str, Vector] = {
    "x": (-1.0, 0.0, 0.0), "y": (0.0, -1.0, 0.0), "z": (0.0, 0.0, -1.0),
    "-x": (1.0, 0.0, 0.0), "-y": (0.0, 1.0, 0.0), "-z": (0.0, 0.0, 1.0),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class MarkerOptions:
    """User options for a file of marker trajectories.

    - `up`: the axis that points up
    - `frames`: number of frames to keep, from the beginning
    - `unit`: unit of lengths, needed where the file states none
    - `decimal`: decimal separator of a text file, `comma` or `point`; '' to detect it
    - `subject`: subject whose markers are used, where several subjects have the same marker names
    - `anyway`: accept implausible times, corners that jump, and `unit` where the file states another; None: refuse
      them, and do not offer --anyway in the error
    """

    up: str = "z"
    frames: int | None = None
    unit: str | None = None
    decimal: str = ""
    subject: str = ""
    anyway: bool | None = None


def import_marker_take(path: Path, garment: Garment, options: MarkerOptions | None = None) -> Take:
    """Return the take in a file of marker trajectories.

    Raises:
        TakeError: the file cannot be read, has too few frames, times that are not in seconds, or markers that do not
            fit the garment.
    """
    options = options or MarkerOptions()
    up, frames = options.up, options.frames
    if frames is not None and frames < FEWEST_SEEN:
        raise TakeError(
            f"a fit needs {FEWEST_SEEN} frames or more, not {frames}", where="--frames",
            advice=f"give {FEWEST_SEEN} or more, or leave it out",
        )  # fmt: skip
    if up not in DOWNWARD:
        raise TakeError(f"there is no axis {up!r}", where="--up", advice=f"choose one of {', '.join(DOWNWARD)}")
    wanted = Wanted(garment.point_names, options.subject, frames)
    tracks = read_marker_tracks(path, options.unit, options.decimal, wanted, anyway=options.anyway)
    time, positions = _of_garment(tracks, garment, path, options)
    left, right = _held_markers(garment, path)
    _check_held(positions, garment, (left, right), _zeros_of(tracks, garment, options), path)
    check_neighbours(
        positions, garment, (left, right), path, offers_anyway=options.anyway is not None,
        overridden=tracks.overridden, is_unit_stated=tracks.has_unit,
    )  # fmt: skip
    _check_up(positions, garment, (left, right), path, up)
    _check_origin(positions, garment, path)
    seen = np.asarray(np.isfinite(positions).all(2))
    held, held_seen = positions[:, [left, right]], seen[:, [left, right]]
    if not options.anyway:
        advice = f"empty {garment.points[left].name!r} or {garment.points[right].name!r} there, and export again"
        refuse_jumps(time, held, path, one="frame", advice=advice, offers_anyway=options.anyway is not None)
    warning = "; ".join(filter(None, [tracks.warning, warning_of_far_markers(time, positions, garment)]))
    state = np.where(held_seen.all(1), 0, FrameState.MARKER_LOST).astype(np.uint16)
    return Take(
        take_id=path.stem,
        created=datetime.fromtimestamp(path.stat().st_mtime, UTC).isoformat(timespec="seconds"),
        rig=Rig(format="hangtime-rig/1", name=f"motion capture, {up} up", gravity=DOWNWARD[up]),
        garment=garment, time=time - time[0], held=held, held_valid=held_seen,
        held_sd=np.full(held.shape, MARKER_SD), points=positions, points_valid=seen,
        points_sd=np.full(positions.shape, MARKER_SD), state=state, markers=held, source=path.name,
        notes={
            OF_MARKERS: f"{len(garment.points)} of the {len(tracks.labels)} markers in the file",
            "front": facing(held, up),
        }
        | ({"file": warning} if warning else {}),
    )  # fmt: skip


def facing(held: Floats, up: str) -> str:
    """Return the axis that the garment's front faces, from its held corners [m], (frames, 2, 3): left, right.

    Flat cloth seen from behind is its own mirror image. So the import cannot detect exchanged sides or left-handed
    axes. Only a person who was present knows the direction of the front.
    """
    across = np.nanmean(held[:, 1] - held[:, 0], axis=0)
    front = np.cross(across, -np.array(DOWNWARD[up]))
    axis = int(np.argmax(np.abs(front)))
    return f"{'-' if front[axis] < 0 else ''}{'xyz'[axis]}"


def _of_garment(tracks: MarkerTracks, garment: Garment, path: Path, options: MarkerOptions) -> tuple[Floats, Floats]:
    """Return the times [s] and the positions [m] of the garment's markers, in the garment's order."""
    frames = options.frames
    found = {name: tracks.columns_named(name, options.subject) for name in garment.point_names}
    absent = [name for name in garment.point_names if not found[name]]
    subjects = sorted({label.rpartition(":")[0] for label in tracks.labels} - {""})
    if absent and options.subject and composed(options.subject) not in map(composed, subjects):
        raise TakeError(
            f"has no subject {options.subject!r}", where=path,
            advice=f"give --subject, one of {', '.join(subjects)}" if subjects
            else "leave out --subject: its markers' names have no subject before a colon",
        )  # fmt: skip
    if pathless := [name for name in absent if name in {label.rpartition(":")[2] for label in tracks.without_path}]:
        raise TakeError(
            f"names {pathless[0]!r} and has no path of it: the file has {counted(len(tracks.labels), 'path')} and "
            f"{counted(len(tracks.labels) + len(tracks.without_path), 'name')}", where=path,
            advice="export it again with the paths of all markers",
        )  # fmt: skip
    if computed := [name for name in absent if name in {label.rpartition(":")[2] for label in tracks.expected}]:
        raise TakeError(
            f"has {computed[0]!r} only where Motive expects it by the pose of a body, as Rigid Body Marker or Bone "
            "Marker", where=path, advice=EXPORT_MEASURED,
        )  # fmt: skip
    if absent:
        near = nearest_label(tracks.labels, absent[0])
        of_file = f"the file has {near!r}" if near else f"the file's first is {tracks.labels[0]!r}"
        bare = tracks.without_name
        of_paths = f"{bare} of its {counted(len(tracks.labels), 'path')} {'has' if bare == 1 else 'have'} no label"
        raise TakeError(
            f"{len(absent)} of the garment's {len(garment.points)} markers {'is' if len(absent) == 1 else 'are'} not "
            f"in the file, first {absent[0]!r} ({of_file})" + f"; {of_paths}" * bool(bare),
            where=path,
            advice="name the garment's points as the markers are labelled"
            + ", or label all markers and export it again" * bool(bare),
        )
    for name, columns in found.items():
        if len(columns) > 1:
            owners = sorted({tracks.labels[k].rpartition(":")[0] for k in columns})
            raise TakeError(
                f"the marker {name!r} comes {len(columns)} times",
                where=path,
                advice=f"give --subject, one of {', '.join(owners)}" if len(owners) > 1
                else "rename one and export again",
            )  # fmt: skip
    time = tracks.time[:frames]
    if len(time) < FEWEST_SEEN:
        raise TakeError(
            f"has {counted(len(time), 'frame')}, {FEWEST_SEEN} are needed", where=path, advice="record for longer"
        )
    if frames is not None and len(time) < frames:
        raise TakeError(
            f"has {len(time)} frames, --frames asks for {frames}", where=path,
            advice=f"give --frames {len(time)} or fewer, or leave it out",
        )  # fmt: skip
    if not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        wrong = 1 + int(np.flatnonzero(~(np.diff(time, prepend=-np.inf) > 0) | ~np.isfinite(time))[0])
        raise TakeError(
            f"its time does not increase from frame to frame, first at frame {wrong}", where=path,
            advice="mend the times, or the numbers of the frames",
        )  # fmt: skip
    if not options.anyway:
        if not tracks.has_times:
            check_rate_alone(time, tracks.rate, path, offers_anyway=options.anyway is not None)
        check_plausible_times(
            time, path, named_unit=tracks.named_unit, offers_anyway=options.anyway is not None
        )  # fmt: skip
        check_stated_rate(time, tracks.rate, path, offers_anyway=options.anyway is not None)
    positions = tracks.positions[:frames, [columns[0] for columns in found.values()]]
    return time, positions


def _held_markers(garment: Garment, path: Path) -> tuple[int, int]:
    """Return the indices of the markers on the top left and the top right corner."""
    places = np.array([point.at_m for point in garment.points], float)
    found = []
    for corner, name in zip(garment.outline_m[:2], ("left", "right"), strict=True):
        apart = np.linalg.norm(places - corner, axis=1)
        if apart.min() > ON_CORNER:
            raise TakeError(
                f"no marker sits on the garment's top {name} corner, the nearest is {1e3 * apart.min():.0f} mm off",
                where=path,
                advice="let outline_m end at the outer markers: the two top ones drive the simulation",
            )
        found.append(int(np.argmin(apart)))
    return found[0], found[1]


def _zeros_of(tracks: MarkerTracks, garment: Garment, options: MarkerOptions) -> list[int]:
    """Return how often each of the garment's markers has three zero coordinates; all of them are in the file."""
    columns = [tracks.columns_named(name, options.subject)[0] for name in garment.point_names]
    return [0 if tracks.zeros is None else int(tracks.zeros[k]) for k in columns]


def _check_held(positions: Floats, garment: Garment, held: tuple[int, int], zeros: list[int], path: Path) -> None:
    """Refuse a take whose two top corners were never seen together, since nothing can be fitted to it.

    `zeros`: how often each marker has three zero coordinates
    """
    seen = np.asarray(np.isfinite(positions[:, held]).all(axis=2))
    if np.asarray(seen.all(axis=1)).any():
        return
    names = [
        repr(garment.points[k].name) for k, there in zip(held, np.asarray(seen.any(axis=0)), strict=True) if not there
    ]
    never = "was never seen" if len(names) == 1 else "were never seen"
    what = f"{' and '.join(names)} {never}" if names else f"the two markers on its top corners {never} together"
    most = max(held, key=lambda k: zeros[k])
    taken = f": {garment.points[most].name!r} is at 0, 0, 0 {counted(zeros[most], 'time')}, which counts as not seen"
    advice = "the markers on the two top corners drive the simulation: record with both in view"
    if zeros[most]:
        what += taken
        advice += "; where a marker was at 0, 0, 0, move the origin and export again"
    raise TakeError(what, where=path, advice=advice)


def _check_origin(positions: Floats, garment: Garment, path: Path) -> None:
    """Refuse markers farther from the origin than a take can hold; name the marker, and count frames from 1."""
    away = np.nan_to_num(np.abs(positions), nan=0.0).max(2)
    if (away > FARTHEST_PLACE).any():
        frame, marker = (int(at[0]) for at in np.nonzero(away > FARTHEST_PLACE))
        raise TakeError(
            f"the marker {garment.points[marker].name!r} lies {away[frame, marker]:g} m from the origin in frame "
            f"{frame + 1}", where=path,
            advice=f"check the unit, and move the origin: a take reaches {FARTHEST_PLACE:g} m",
        )  # fmt: skip


def _check_up(positions: Floats, garment: Garment, held: tuple[int, int], path: Path, up: str) -> None:
    """Refuse a vertical axis along which the markers do not hang below the held corners; name the axis that fits."""
    places = np.array([point.at_m for point in garment.points], float)
    flat = places[list(held), 1].mean() - places[:, 1]
    below = flat > ON_CORNER
    fallen = positions[:, below] - positions[:, held].mean(1, keepdims=True)
    fallen = fallen[np.isfinite(fallen).all(2)]
    if not len(fallen):
        return
    drops = {axis: float(np.median(fallen @ down)) for axis, down in DOWNWARD.items()}
    least = LEAST_DROP * float(np.median(flat[below]))
    if drops[up] >= least:
        return
    fitting = max(drops, key=lambda axis: drops[axis])
    drop = round(1e3 * drops[up])
    hang = f"{abs(drop)} mm {'above' if drop < 0 else 'below'}"
    raise TakeError(
        f"with {up} up the markers are {hang} the held corners in the median, "
        f"and {1e3 * np.median(flat[below]):.0f} mm below on the flat garment",
        where=path,
        advice=f"give --up {fitting}, along which they hang" if drops[fitting] >= least
        else "record cloth that hangs from the two top corners",
    )  # fmt: skip
