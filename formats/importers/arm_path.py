"""Import of the path of a robot arm that swung a cloth, on the arm's own clock, for takes of `swung_cloth`.

Each take has one `.npz` file with these arrays. Their clock has the zero of the recording's `t`.

- `tcp_t` [s], (poses,)
- `tcp_pose`, (poses, 7): place [m] and rotation, a quaternion x y z w, of the tool in the frame of the points
- `tcp_to_corner_m` [m], (2, 3): from the tool to both held corners, in the tool's frame

The recording has the corners too, in its pictures. A path may be far from them at every small shift in time. Then the
path is of another take, in another unit, or has its quaternions in another order. The import refuses the path, and
names the unit or order that would bring it there. It also refuses a path that leaves them for a second, and says when.

A path on another clock is looked for at shifts up to `FARTHEST_SHIFT`. It is refused where the shift that brings it
nearest is larger than what a fit finds by itself. A motion that repeats itself is as near after each period, and then
the import says nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.blocks import FARTHEST_PLACE
from formats.errors import TakeError
from formats.importers.npz import load_arrays
from formats.plausible import check_plausible_times
from formats.two_clocks import at_times

SHAPES = {"tcp_t": (None,), "tcp_pose": (None, 7), "tcp_to_corner_m": (2, 3)}
MOST_BYTES = 1 << 26  # of all arrays: ten hours at 20 poses a second are half of it
FARTHEST = 0.03  # m from the pictures' corners, median: the public recordings' are 2 mm off, another take's 100 mm
FARTHEST_FOR_A_WHILE = 0.1  # m, median over as many pictures: the corners that a camera saw are up to 60 mm off
LONGEST_STEP = 0.2  # s between poses that a straight line is taken to join: four of the public paths' steps
WHILE = 9  # pictures: a second of the public recordings
LARGEST_SHIFT, SHIFT_STEP = 0.5, 0.02  # s between both clocks: what a diagnosis looks for; 10 mm at 0.5 m/s
FARTHEST_SHIFT = 5.0  # s between both clocks that is told
CLEARLY_NEARER = 1.15  # times: clocks that are 0.6 s apart bring the public paths 1.2 to thousands of times nearer
LEAST_NEARER = 3e-3  # m: less is noise, and a hanger that hardly moves tells no time
SEEN_AT_ALL = 0.5  # of the corners that a shift must leave beside the path
MOST_LOOKED_AT = 2000  # pictures
UNIT_WITHIN = 1e-2  # of a quaternion's length: printed with two decimals it still passes
WHAT_TO_GIVE = "give a .npz with tcp_t, tcp_pose and tcp_to_corner_m, see docs/reference/file-formats.md"


def path_beside(hanger: Path, recording: Path) -> Path:
    """Return the file with the hanger's path for a recording: `hanger` itself, or its file of the recording's name."""
    return hanger / recording.name if hanger.is_dir() else hanger


@dataclass(frozen=True)
class ArmPath:
    """The path of a tool that holds a cloth.

    - `file`: it was read from
    - `time` [s], (poses,)
    - `place` [m], (poses, 1, 3), of the tool
    - `turn`, (poses, 4): unit quaternions x y z w
    - `tool` [m], (2, 3): from the tool to both corners
    """

    file: Path
    time: Floats
    place: Floats
    turn: Floats
    tool: Floats

    @property
    def held(self) -> Floats:
        """Return where the held corners were [m], (poses, 2, 3)."""
        return self.place + _turned(self.tool, self.turn)


def read_arm_path(path: Path, *, anyway: bool | None = None) -> ArmPath:
    """Return the path in a file.

    anyway: accept times that no robot has; None: refuse them, and name no option for it

    Raises:
        TakeError: the file is missing, or holds no such path.
    """
    data = load_arrays(path, SHAPES, most_bytes=MOST_BYTES, advice=WHAT_TO_GIVE)
    poses = data["tcp_t"].size
    for name, shape in SHAPES.items():
        needed = tuple(poses if size is None else size for size in shape)
        if data[name].shape != needed or data[name].dtype.kind not in "iuf":
            raise TakeError(
                f"the array {name!r} has shape {data[name].shape} of {data[name].dtype}, not {needed} numbers",
                where=path, advice=WHAT_TO_GIVE,
            )  # fmt: skip
        if not np.isfinite(data[name].astype(float)).all():
            raise TakeError(f"the array {name!r} holds what is no number", where=path, advice="export it again")
    time, pose = data["tcp_t"].astype(float), data["tcp_pose"].astype(float)
    if poses < 2 or not (np.diff(time) > 0).all():
        raise TakeError("its time does not increase from pose to pose", where=path, advice="mend 'tcp_t'")
    if not anyway:
        check_plausible_times(time, path, offers_anyway=anyway is not None)
    farthest = max(np.abs(pose[:, :3]).max(), np.abs(data["tcp_to_corner_m"]).max())
    if farthest > FARTHEST_PLACE:
        raise TakeError(
            f"a place lies {farthest:g} m away", where=path, advice=f"give metres, at most {FARTHEST_PLACE:g}"
        )  # fmt: skip
    length = np.linalg.norm(np.clip(pose[:, 3:], -2.0, 2.0), axis=1)
    if np.abs(length - 1).max() > UNIT_WITHIN:
        raise TakeError(
            "a rotation in 'tcp_pose' is no unit quaternion x y z w", where=path, advice="export it again"
        )  # fmt: skip
    return ArmPath(path, time, pose[:, None, :3], pose[:, 3:] / length[:, None], data["tcp_to_corner_m"].astype(float))


def check_arm_path(arm: ArmPath, time: Floats, corners: Floats) -> None:
    """Refuse a path that is not where a recording's pictures have the held corners.

    time [s], (frames,); corners [m], (frames, 2, 3), NaN where not seen; without any, nothing is checked

    Raises:
        TakeError: it is elsewhere.
    """
    away = _apart(arm, time, corners)
    if not np.isfinite(away).any():
        return
    best = float(np.nanmedian(away))
    _refuse_another_clock(arm, time, corners, best)
    if best <= FARTHEST:
        _refuse_a_stray(arm, time, away)
        return
    advice = "give the path of the same take, in metres, in the frame of its points, on a clock of the same zero"
    for other, found in _mistakes(arm):
        if np.nanmedian(_apart(other, time, corners)) <= FARTHEST:
            advice = found
            break
    raise TakeError(
        f"its held corners are {best:.3g} m from those of the recording's pictures, in the median and at any shift up "
        f"to {LARGEST_SHIFT:g} s", where=arm.file, advice=advice,
    )  # fmt: skip


def _refuse_another_clock(arm: ArmPath, time: Floats, corners: Floats, best: float) -> None:
    """Refuse a path that is much nearer at a large shift in time than, at `best` [m], at any small one."""
    some = slice(None, None, -(-len(time) // MOST_LOOKED_AT))
    shifts = SHIFT_STEP * np.arange(-round(FARTHEST_SHIFT / SHIFT_STEP), round(FARTHEST_SHIFT / SHIFT_STEP) + 1)
    far = shifts[np.abs(shifts) > LARGEST_SHIFT + SHIFT_STEP / 2]
    apart = [_median_apart(arm, time[some] + shift, corners[some]) for shift in far]
    least, shift = min(apart), float(far[int(np.argmin(apart))])
    if least <= FARTHEST and best > CLEARLY_NEARER * least and best - least > LEAST_NEARER:
        raise TakeError(
            f"its clock is {abs(shift):.2f} s {'ahead of' if shift > 0 else 'behind'} the recording's: its held "
            f"corners are {1e3 * least:.0f} mm from those of the pictures at that shift, {1e3 * best:.0f} mm at any up "
            f"to {LARGEST_SHIFT:g} s", where=arm.file,
            advice=f"{'subtract' if shift > 0 else 'add'} {abs(shift):.2f} s {'from' if shift > 0 else 'to'} 'tcp_t'",
        )  # fmt: skip


def _median_apart(arm: ArmPath, instants: Floats, corners: Floats) -> float:
    """Return the median distance [m] of a path from corners in the nearer order, infinite where few are known."""
    found = at_times(instants, arm.time, arm.held)
    known = np.isfinite(corners).all(2).sum()
    away = [np.linalg.norm(found - order, axis=2) for order in (corners, corners[:, ::-1])]
    if np.isfinite(away[0]).sum() < SEEN_AT_ALL * known:
        return float("inf")
    return min(float(np.nanmedian(one)) for one in away)


def _refuse_a_stray(arm: ArmPath, time: Floats, away: Floats) -> None:
    """Refuse a path that is elsewhere for a while, as of another take from some moment on.

    time [s], (frames,); away [m], (frames, 2): of the path from the corners, NaN where unknown
    """
    seen = np.flatnonzero(np.isfinite(away).any(1))
    if len(seen) < WHILE:
        return
    for_a_while = np.nanmedian(np.lib.stride_tricks.sliding_window_view(away[seen], WHILE, axis=0), axis=(1, 2))
    if for_a_while.max() > FARTHEST_FOR_A_WHILE:
        worst = int(for_a_while.argmax())
        first, last = time[seen[worst]] - time[0], time[seen[worst + WHILE - 1]] - time[0]
        raise TakeError(
            f"its held corners leave those of the recording's pictures: they are {for_a_while.max():.3g} m apart from "
            f"{first:.1f} to {last:.1f} s", where=arm.file,
            advice="give the path of the whole take, or cut both files before that",
        )  # fmt: skip


def _mistakes(arm: ArmPath) -> Iterator[tuple[ArmPath, str]]:
    """Yield the path as it would be without a common mistake, and what to do about that mistake."""
    for name, unit in (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254)):
        place, tool = unit * arm.place, unit * arm.tool
        yield replace(arm, place=place), f"give the places of 'tcp_pose' in metres: they seem to be {name}"
        yield replace(arm, tool=tool), f"give 'tcp_to_corner_m' in metres: they seem to be {name}"
        yield (
            replace(arm, place=place, tool=tool),
            f"give 'tcp_pose' and 'tcp_to_corner_m' in metres: they seem to be {name}",
        )
    yield (
        replace(arm, turn=arm.turn[:, [1, 2, 3, 0]]),
        "give the quaternions as x y z w: they seem to be w x y z",
    )
    yield (
        replace(arm, turn=arm.turn * [-1, -1, -1, 1]),
        "give rotations from the tool's frame: they seem to be their inverses",
    )


def _apart(arm: ArmPath, time: Floats, corners: Floats) -> Floats:
    """Return the distances [m] of a path from corners, (frames, 2), at the small shift in time with the least median.

    A distance is NaN where it is unknown.

    time [s], (frames,); corners [m], (frames, 2, 3), in either order
    """
    least, nearest, held = np.inf, np.full((len(time), 2), np.nan), arm.held
    for shift in np.arange(-LARGEST_SHIFT, LARGEST_SHIFT + SHIFT_STEP / 2, SHIFT_STEP):
        found = at_times(time + shift, arm.time, held)
        after = np.searchsorted(arm.time, time + shift).clip(1, len(arm.time) - 1)
        found[arm.time[after] - arm.time[after - 1] > LONGEST_STEP] = np.nan
        for order in (corners, corners[:, ::-1]):
            away = np.linalg.norm(found - order, axis=2)
            if np.isfinite(away).any() and (median := float(np.nanmedian(away))) < least:
                least, nearest = median, away
    return nearest


def _turned(places: Floats, turns: Floats) -> Floats:
    """Return places, (k, 3), after each of the turns, (n, 4), unit quaternions x y z w: (n, k, 3).

    v + 2 u x (u x v + w v), with u = (x, y, z) (O. Rodrigues, 1840)
    """
    axis, real = turns[:, None, :3], turns[:, None, 3:]
    return np.asarray(places + 2 * np.cross(axis, np.cross(axis, places) + real * places))
