"""Import of the path of a robot arm that swung a cloth, on the arm's own clock, for takes of `swung_cloth`.

Each take has one `.npz` file with these arrays. Their clock has the zero of the recording's `t`.

- `tcp_t` [s], (poses,)
- `tcp_pose`, (poses, 7): place [m] and rotation, a quaternion x y z w, of the tool in the frame of the points
- `tcp_to_corner_m` [m], (2, 3): from the tool to both held corners, in the tool's frame
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError
from formats.importers.npz import load_arrays
from formats.plausible import check_plausible_times

SHAPES = {"tcp_t": (None,), "tcp_pose": (None, 7), "tcp_to_corner_m": (2, 3)}
MOST_BYTES = 1 << 26  # of all arrays: ten hours at 20 poses a second are half of it
UNIT_WITHIN = 1e-2  # of a quaternion's length: printed with two decimals it still passes
WHAT_TO_GIVE = "give a .npz with tcp_t, tcp_pose and tcp_to_corner_m, see docs/reference/file-formats.md"


def path_beside(hanger: Path, recording: Path) -> Path:
    """Return the file with the hanger's path for a recording: `hanger` itself, or its file of the recording's name."""
    return hanger / recording.name if hanger.is_dir() else hanger


def read_arm_path(path: Path, *, anyway: bool | None = None) -> tuple[Floats, Floats]:
    """Return when the hanger was measured [s], (poses,), and where the held corners were [m], (poses, 2, 3).

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
    length = np.linalg.norm(pose[:, 3:], axis=1)
    if np.abs(length - 1).max() > UNIT_WITHIN:
        raise TakeError(
            "a rotation in 'tcp_pose' is no unit quaternion x y z w", where=path, advice="export it again"
        )  # fmt: skip
    return time, pose[:, None, :3] + _turned(data["tcp_to_corner_m"].astype(float), pose[:, 3:] / length[:, None])


def _turned(places: Floats, turns: Floats) -> Floats:
    """Return places, (k, 3), after each of the turns, (n, 4), unit quaternions x y z w: (n, k, 3).

    v + 2 u x (u x v + w v), with u = (x, y, z) (O. Rodrigues, 1840)
    """
    axis, real = turns[:, None, :3], turns[:, None, 3:]
    return np.asarray(places + 2 * np.cross(axis, np.cross(axis, places) + real * places))
