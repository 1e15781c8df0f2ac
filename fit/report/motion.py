"""Real and simulated motion for the report, and the error measure of all its figures.

The error of a frame is the root mean square distance of the free points that are seen in it. The hanger does not hold
a free point. A point of a silhouette lies a constant few millimetres beside the cloth. Its mean offset over the take
is taken out, as in the diagnosis (`fit.observer.residuals`). So figures, curves, player and verdict agree.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fit.errors import FitError
from formats.arrays import Booleans, Floats, Integers

RUNS = ("before", "after", "base", "with_effect", "fit")  # runs in the order of display


@dataclass(frozen=True, kw_only=True)
class Run:
    """One simulation: tracked points [m], (frames, points, 3), and its cloth [m], (frames, vertices, 3), or None."""

    points: Floats
    mesh: Floats | None = None


@dataclass(frozen=True, kw_only=True)
class ReportMotion:
    """Real and simulated motion of one take, in a world frame with z up.

    - `time` [s], (frames,)
    - `real` [m], (frames, points, 3), NaN where not seen
    - `runs`: simulations, by the names in `RUNS`
    - `triangles`, (triangles, 3): indices of vertices; two that follow one another make a quadrilateral
    - `held` [m], (frames, 2, 3): the two ends of the held edge, left first
    - `free`, (points,): whether a point counts; None: every point
    - `is_material`: whether points stay on the cloth; else each point's mean offset is no error
    - `outline` [m], (corners, 2): the flat garment
    - `pull_hz`: natural frequency of the pull that drew the simulated cloth to the real points, 0 where it moved freely
    """

    take_id: str
    is_held_out: bool
    time: Floats
    real: Floats
    point_names: tuple[str, ...]
    runs: Mapping[str, Run] = field(default_factory=dict)
    triangles: Integers | None = None
    pull_hz: float = 0.0
    held: Floats | None = None
    free: Booleans | None = None
    is_material: bool = True
    outline: Floats | None = None

    def __post_init__(self) -> None:
        frames, points = len(self.time), len(self.point_names)
        if frames < 2:
            raise FitError("a motion needs two frames or more", where=self.take_id, advice="record a longer take")
        tracks = {"real": self.real, **{name: run.points for name, run in self.runs.items()}}
        for name, track in tracks.items():
            if track.shape != (frames, points, 3):
                raise FitError(
                    f"{name} points have shape {track.shape}, not {(frames, points, 3)}", where=self.take_id,
                    advice="give each frame all points",
                )  # fmt: skip
        for name, run in self.runs.items():
            if run.mesh is not None and (run.mesh.ndim != 3 or run.mesh.shape[0] != frames or run.mesh.shape[2] != 3):
                raise FitError(
                    f"the mesh of {name} has shape {run.mesh.shape}, not ({frames}, vertices, 3)", where=self.take_id,
                    advice="give each frame all vertices",
                )  # fmt: skip

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of the motion's runs, in the order of `RUNS`."""
        return tuple(name for name in RUNS if name in self.runs)

    @property
    def counted(self) -> Booleans:
        """Which points count in which frames, (frames, points): those seen and free."""
        free = np.ones(len(self.point_names), bool) if self.free is None else self.free
        return np.asarray(np.isfinite(self.real).all(2) & free)

    def offset(self, name: str) -> Floats:
        """Return the mean offset between real and simulated points that does not count as error [m], (points, 3)."""
        seen = self.counted[..., None]
        if self.is_material:
            return np.zeros(self.real.shape[1:])
        apart = np.where(seen, self.real - self.runs[name].points, 0.0)
        return np.asarray(apart.sum(0) / np.maximum(seen.sum(0), 1))

    def compared(self, name: str) -> Floats:
        """Return a run's points, shifted for comparison with the real ones [m], (frames, points, 3)."""
        return self.runs[name].points + self.offset(name)

    def errors(self, name: str) -> Floats:
        """Return the distance of each free point from the real one [m], (frames, points), NaN where not seen."""
        return np.where(self.counted, np.linalg.norm(self.compared(name) - self.real, axis=2), np.nan)

    def rms(self, name: str) -> Floats:
        """Return the error of each frame [m], (frames,), NaN where no free point is seen."""
        return _rms(self.errors(name), axis=1)

    @property
    def worst_frame(self) -> int:
        """Return the frame with the largest error of the first run, or 0 without any error; see `judged`."""
        judged = self.judged(self.shown[0]) if self.shown else np.full(1, np.nan)
        return int(np.nanargmax(judged)) if np.isfinite(judged).any() else 0

    def judged(self, name: str) -> Floats:
        """Return a run's error in each frame that may be its worst [m], (frames,), NaN in all others.

        Frames with less than half of the largest number of seen free points do not count.
        """
        count = self.counted.sum(1)
        return np.where(2 * count >= count.max(), self.rms(name), np.nan)


def rms_of(motions: list[ReportMotion], name: str) -> float | None:
    """Return the error of a run over all frames of some motions [m]; None if no motion contains the run."""
    errors = [motion.errors(name).ravel() for motion in motions if name in motion.runs]
    whole = float(_rms(np.concatenate(errors), axis=0)) if errors else np.nan
    return whole if np.isfinite(whole) else None


def _rms(values: Floats, axis: int) -> Floats:
    known = np.isfinite(values)
    total = np.where(known, values, 0.0) ** 2
    count = known.sum(axis)
    return np.where(count > 0, np.sqrt(total.sum(axis) / np.maximum(count, 1)), np.nan)
