"""Import the trajectory of a robot arm that swung a cloth, on the arm's own clock, for takes of `swung_cloth`.

Each take has one `.npz` file with these arrays. Their clock has the same zero as the recording's `t`.

- `tcp_t` [s], (poses,)
- `tcp_pose`, (poses, 7): position [m] and rotation, a quaternion x y z w, of the tool in the frame of the points
- `tcp_to_corner_m` [m], (2, 3): from the tool to both held corners, in the tool's frame

The recording also has the corners, as its pictures show them. A trajectory may be far from these corners at every small
time shift. Then it belongs to another take, is in another unit, or has another order of quaternion components. The
import refuses such a trajectory, and names the unit or order that would fit. It also refuses a trajectory that leaves
the corners for a second, and says when.

`clock_shift` estimates the offset of the arm's clock. The import reports an offset that a fit can find by itself, and
refuses a larger one. For a periodic motion, the smallest offset counts, and the import names the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.blocks import FARTHEST_PLACE
from formats.errors import TakeError
from formats.importers.clock_shift import LEAST_NEARER, SHIFT_STEP, find_clock_shift
from formats.importers.npz import kind_of, load_arrays
from formats.missing import span_words
from formats.plausible import check_plausible_times
from formats.sights import LARGEST_SHIFT
from formats.two_clocks import at_times

ARM_SHAPES = {"tcp_t": (None,), "tcp_pose": (None, 7), "tcp_to_corner_m": (2, 3)}
MOST_ARM_BYTES = 1 << 26  # of all arrays: ten hours at 20 poses a second are half of it
FARTHEST_ARM = 0.03  # m, median over the pictures: 2 mm in the public recordings, 100 mm in a wrong take
FARTHEST_FOR_A_WHILE = 0.1  # m, median over WHILE pictures: the corners that a camera saw are up to 60 mm off
LONGEST_POSE_STEP = 0.2  # s between poses that are interpolated linearly: four steps of the public paths
WHILE = 9  # pictures: a second of the public recordings
SMALLEST_SHOWN = 1e-3  # s, standard error; our choice: half and double were not tried
MOST_OTHERS = 2  # equally good shifts that one note names; our choice: more would hide the sentence's advice
NORM_WITHIN = 1e-2  # deviation of a quaternion's norm from 1: one printed with two decimals still passes
ARM_TO_GIVE = "give a .npz with tcp_t, tcp_pose and tcp_to_corner_m, see docs/reference/file-formats.md"


def path_beside(hanger: Path, recording: Path) -> Path:
    """Return the file with a recording's hanger trajectory.

    It is `hanger` itself, or the file in the folder `hanger` with the recording's name.
    """
    return hanger / recording.name if hanger.is_dir() else hanger


@dataclass(frozen=True)
class ArmPath:
    """The trajectory of a tool that holds a cloth.

    - `file`: file that it was read from
    - `time` [s], (poses,)
    - `place` [m], (poses, 1, 3): positions of the tool
    - `turn`, (poses, 4): unit quaternions x y z w
    - `tool` [m], (2, 3): from the tool to both corners
    """

    file: Path
    time: Floats
    place: Floats
    turn: Floats
    tool: Floats

    @cached_property
    def held(self) -> Floats:
        """Return the positions of the held corners [m], (poses, 2, 3)."""
        return self.place + _turned(self.tool, self.turn)

    def at(self, instants: Floats) -> Floats:
        """Return the positions of the held corners [m], (n, 2, 3), at times [s], (n,).

        Positions are NaN in gaps and outside the trajectory.
        """
        found = at_times(instants, self.time, self.held)
        after = np.searchsorted(self.time, instants).clip(1, len(self.time) - 1)
        found[self.time[after] - self.time[after - 1] > LONGEST_POSE_STEP] = np.nan
        return found


def read_arm_path(path: Path, *, anyway: bool | None = None) -> ArmPath:
    """Read the trajectory in a file.

    anyway: accept implausible times; None: refuse them, and do not offer --anyway in the error

    Raises:
        TakeError: the file is missing or malformed.
    """
    data = load_arrays(path, ARM_SHAPES, most_bytes=MOST_ARM_BYTES, advice=ARM_TO_GIVE)
    poses = data["tcp_t"].size
    for name, shape in ARM_SHAPES.items():
        needed = tuple(poses if size is None else size for size in shape)
        if data[name].shape != needed or data[name].dtype.kind not in "iuf":
            raise TakeError(
                f"the array {name!r} has shape {data[name].shape} of {kind_of(data[name])}, "
                f"not {needed} of real numbers", where=path, advice=ARM_TO_GIVE,
            )  # fmt: skip
        if not np.isfinite(data[name].astype(float)).all():
            raise TakeError(
                f"the array {name!r} holds a value that is not finite", where=path, advice="export it again"
            )
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
    if np.abs(length - 1).max() > NORM_WITHIN:
        raise TakeError(
            "a rotation in 'tcp_pose' is no unit quaternion x y z w", where=path, advice="export it again"
        )  # fmt: skip
    return ArmPath(path, time, pose[:, None, :3], pose[:, 3:] / length[:, None], data["tcp_to_corner_m"].astype(float))


def check_arm_path(arm: ArmPath, time: Floats, corners: Floats) -> str:
    """Return a note on the clock's offset; refuse a trajectory that is not at the held corners in the pictures.

    time [s], (frames,); corners [m], (frames, 2, 3), NaN where not seen; if no corner was seen, nothing is checked

    Raises:
        TakeError: the trajectory is elsewhere, or its clock is off by more than a fit can find.
    """
    away = _apart(arm, time, corners)
    if not np.isfinite(away).any():
        return ""
    best = float(np.nanmedian(away))
    note = check_clock(arm, time, corners, best)
    if best <= FARTHEST_ARM:
        _refuse_a_stray(arm, time, away)
        return note
    advice = "give the path of the same take, in metres, in the frame of its points, on a clock of the same zero"
    for other, found in _mistakes(arm):
        if np.nanmedian(_apart(other, time, corners)) <= FARTHEST_ARM:
            advice = found
            break
    raise TakeError(
        f"its held corners are {best:.3g} m from those of the recording's pictures, in the median and at any shift up "
        f"to {LARGEST_SHIFT:g} s", where=arm.file, advice=advice,
    )  # fmt: skip


def check_clock(arm: ArmPath, time: Floats, seen: Floats, best: float | None = None) -> str:
    """Return a note on a clock offset that a fit can find, '' where none is significant; refuse a larger offset.

    - `time` [s], (frames,); `seen` [m], (frames, 2, 3): the held ends, in either order, NaN where not seen
    - `best` [m]: median distance from the held corners at any small time shift; None where the ends are not at the hand

    Raises:
        TakeError: the offset is larger.
    """
    if not (np.isfinite(seen).all(2).any(0)).all():
        return ""
    directions = [np.nanmedian(ends[:, 1] - ends[:, 0], axis=0) for ends in (seen, arm.held)]
    seen = seen[:, ::-1] if directions[0] @ directions[1] < 0 else seen
    shift = find_clock_shift(time, seen, arm.at)
    if shift is None or not shift.is_significant:
        return ""
    by, is_ahead = abs(shift.seconds), shift.seconds > 0
    how = f"its clock is {by:.2f} s {'ahead of' if is_ahead else 'behind'} the recording's"
    others = [f"{abs(other):.2f} s {'ahead' if other > 0 else 'behind'}" for other in shift.others[:MOST_OTHERS]]
    how += f" (or {' or '.join(others)}: the motion repeats itself)" * bool(others)
    mend = f"{'subtract' if is_ahead else 'add'} {by:.2f} s {'from' if is_ahead else 'to'} 'tcp_t'"
    error = f"of {shift.error:.3f}" if shift.error >= SMALLEST_SHOWN else f"below {SMALLEST_SHOWN}"
    if by <= LARGEST_SHIFT + SHIFT_STEP / 2:
        return f"{how}, with a standard error {error} s; {mend}, or leave the shift to fit and diagnosis"
    if best is not None:
        least = float(np.nanmedian(np.linalg.norm(arm.at(time + shift.seconds) - seen, axis=2)))
        if least > FARTHEST_ARM:
            return ""
        if best - least < LEAST_NEARER:
            return f"{how}, with a standard error {error} s; {mend}"
        how += (
            f": its held corners are {1e3 * least:.0f} mm from those of the pictures at that shift, "
            f"{1e3 * best:.0f} mm at any up to {LARGEST_SHIFT:g} s"
        )
    raise TakeError(how, where=arm.file, advice=mend)


def _refuse_a_stray(arm: ArmPath, time: Floats, away: Floats) -> None:
    """Refuse a trajectory that leaves the corners for a while, such as one of another take from some time on.

    time [s], (frames,); away [m], (frames, 2): distance of the trajectory from the corners, NaN where unknown
    """
    seen = np.flatnonzero(np.isfinite(away).any(1))
    if len(seen) < WHILE:
        return
    for_a_while = np.nanmedian(np.lib.stride_tricks.sliding_window_view(away[seen], WHILE, axis=0), axis=(1, 2))
    if for_a_while.max() > FARTHEST_FOR_A_WHILE:
        worst = int(for_a_while.argmax())
        first, last = time[seen[worst]] - time[0], time[seen[worst + WHILE - 1]] - time[0]
        raise TakeError(
            f"its held corners leave those of the recording's pictures: both are {for_a_while.max():.3g} m apart "
            f"{span_words(first, last, 1, 'from ')}", where=arm.file,
            advice="give the path of the whole take, or cut both files before that",
        )  # fmt: skip


def _mistakes(arm: ArmPath) -> Iterator[tuple[ArmPath, str]]:
    """Yield the trajectory with a common mistake corrected, and the advice about that mistake."""
    for name, unit in (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254)):
        place, tool = unit * arm.place, unit * arm.tool
        yield replace(arm, place=place), f"give the places of 'tcp_pose' in metres: the values seem to be {name}"
        yield replace(arm, tool=tool), f"give 'tcp_to_corner_m' in metres: the values seem to be {name}"
        yield (
            replace(arm, place=place, tool=tool),
            f"give 'tcp_pose' and 'tcp_to_corner_m' in metres: the values seem to be {name}",
        )
    yield (
        replace(arm, turn=arm.turn[:, [1, 2, 3, 0]]),
        "give the quaternions as x y z w: the file's order seems to be w x y z",
    )
    yield (
        replace(arm, turn=arm.turn * [-1, -1, -1, 1]),
        "give rotations from the tool's frame: the file seems to hold their inverses",
    )


def _apart(arm: ArmPath, time: Floats, corners: Floats) -> Floats:
    """Return the distances [m] of a trajectory from corners, (frames, 2), NaN where unknown.

    The trajectory is shifted in time by the small shift with the least median distance.

    time [s], (frames,); corners [m], (frames, 2, 3), in either order
    """
    least, nearest = np.inf, np.full((len(time), 2), np.nan)
    for shift in np.arange(-LARGEST_SHIFT, LARGEST_SHIFT + SHIFT_STEP / 2, SHIFT_STEP):
        found = arm.at(time + shift)
        for order in (corners, corners[:, ::-1]):
            away = np.linalg.norm(found - order, axis=2)
            if np.isfinite(away).any() and (median := float(np.nanmedian(away))) < least:
                least, nearest = median, away
    return nearest


def _turned(places: Floats, turns: Floats) -> Floats:
    """Return positions, (k, 3), rotated by each of the quaternions, (n, 4), unit x y z w: (n, k, 3).

    v + 2 u x (u x v + w v), with u = (x, y, z) (O. Rodrigues, 1840)
    """
    axis, real = turns[:, None, :3], turns[:, None, 3:]
    return np.asarray(places + 2 * np.cross(axis, np.cross(axis, places) + real * places))
