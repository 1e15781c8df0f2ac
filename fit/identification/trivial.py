"""Trivial predictors of a take's points, the reference of every fit: a fit that hardly beats them is worth little.

    vertical   a rigid sheet that hangs straight down from the held edge
    pendulum   a rigid sheet on a hinge at the held edge, of length L and damping c:
               th'' = -((g + a_z) sin th + a_n cos th) / L - c th'

The held edge's middle has the acceleration a, up (z) and along the level normal n of the edge. The angle th is measured
from the downward vertical towards n. The two numbers are fitted to the takes used for fitting, on a grid. Both get the
same takes, hanger path and error as the fit: the mean distance of the points in a frame.
Source: Newton's law about a moving hinge, L. D. Landau & E. M. Lifshitz, "Mechanics" (1976), section 39.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from fit.methods.distance import distance
from fit.recordings.hanger_path import level_normal
from fit.recordings.recording import Recording
from formats.arrays import Floats
from formats.fit_records import TRIVIAL_NAMES, ErrorFigure, TrivialFigure
from formats.nature import GRAVITY

TIME_STEP = 0.005  # s of the pendulum: a two-hundredth of its period
LENGTHS = np.round(np.arange(0.1, 1.01, 0.05), 2)  # m, from a handkerchief to a curtain
DAMPINGS = np.array([0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0])  # 1/s: a real hanging cloth had 2 x 1.25
# Share of the trivial predictor's error that a useful fit removes at least. Our choice: it only words a warning, and no
# result depends on it. Half and double were not tried.
HARDLY = 0.1


class Judge(Protocol):
    """Interface of a set of takes that can compute the error of simulated points."""

    @property
    def recordings(self) -> list[Recording]:
        """Return the takes as recordings."""
        ...

    def errors_of(self, points: list[Floats]) -> tuple[ErrorFigure, list[ErrorFigure]]:
        """Return the mean error over all takes, and each take's, of points [m], (frames, points, 3) per take."""
        ...


def trivial_figures(training: Judge, held_out: Judge | None) -> list[TrivialFigure]:
    """Return the errors of the trivial predictors on the fitted and on the held-out takes."""
    best = fitted_pendulum(training.recordings)
    made: tuple[tuple[str, dict[str, float], Callable[[Recording], Floats]], ...] = (
        ("vertical", {}, vertical),
        ("pendulum", {"length_m": best[0], "damping_per_s": best[1]}, lambda r: pendulum(r, *best)),
    )
    return [
        TrivialFigure(
            name=name, parameters=numbers, train=_error(training, of),
            held_out=_error(held_out, of) if held_out else None,
        )
        for name, numbers, of in made
    ]  # fmt: skip


def describe_trivial(after: float, figures: Sequence[TrivialFigure], *, is_held_out: bool) -> str:
    """Compare a fit's mean error [m] with the better trivial predictor, as a warning if the fit hardly beats it."""
    errors = [(one.held_out.mean_m if is_held_out and one.held_out else one.train.mean_m, one.name) for one in figures]
    if not errors:
        return ""
    least, name = min(errors)
    where = "held out" if is_held_out else "on the takes it was fitted to"
    sheet = f"{TRIVIAL_NAMES[name]} {1e3 * least:.1f} mm"
    words = f"{1e3 * after:.1f} mm {where}, {sheet} (mean distance of all points)"
    if after > least:
        return f"Warning: the fit does not beat a trivial predictor: {words}. Its parameters tell nothing of the cloth."
    if after > (1 - HARDLY) * least:
        return f"Warning: the fit hardly beats a trivial predictor: {words}. Its parameters tell little of the cloth."
    return f"The fit misses by {words}."


def vertical(recording: Recording) -> Floats:
    """Return the points of a sheet that hangs straight down [m], (frames, points, 3)."""
    return _sheet(recording)(np.zeros(len(recording.time)))


def pendulum(recording: Recording, length: float, damping: float) -> Floats:
    """Return the points of a sheet that swings as a pendulum [m], (frames, points, 3)."""
    return _sheet(recording)(swing(recording, np.array([length]), np.array([damping]))[0])


def fitted_pendulum(recordings: Sequence[Recording]) -> tuple[float, float]:
    """Return length [m] and damping [1/s] of the pendulum with the smallest error on the grid."""
    lengths, dampings = (grid.ravel() for grid in np.meshgrid(LENGTHS, DAMPINGS))
    errors = np.zeros(len(lengths))
    for recording in recordings:
        sheet = _sheet(recording)
        for k, angle in enumerate(swing(recording, lengths, dampings)):
            errors[k] += float(distance(recording.points, sheet(angle)))
    best = int(errors.argmin())
    return float(lengths[best]), float(dampings[best])


def swing(recording: Recording, lengths: Floats, dampings: Floats) -> Floats:
    """Return the angles of pendulums at the frames [rad], (pendulums, frames), which start at rest."""
    instants = np.arange(0.0, recording.duration + TIME_STEP, TIME_STEP)
    ends = recording.held(instants)
    middle = ends.reshape(-1, 2, 3).mean(1)
    acceleration = np.gradient(np.gradient(middle, TIME_STEP, axis=0), TIME_STEP, axis=0)
    across, up = (acceleration * level_normal(ends)).sum(1), acceleration[:, 2]
    angle, rate = np.zeros(len(lengths)), np.zeros(len(lengths))
    found = np.empty((len(instants), len(lengths)))
    for k in range(len(instants)):
        found[k] = angle
        pull = -((GRAVITY + up[k]) * np.sin(angle) + across[k] * np.cos(angle)) / lengths
        rate = rate + (pull - dampings * rate) * TIME_STEP
        angle = angle + rate * TIME_STEP
    return np.stack([np.interp(recording.time, instants, one) for one in found.T])


def _sheet(recording: Recording) -> Callable[[Floats], Floats]:
    """Return points of a rigid sheet [m], (frames, points, 3), for its angle about the held edge [rad], (frames,)."""
    ends = np.asarray(recording.garment.outline_m[:2], float)
    edge = ends[1] - ends[0]
    along = edge / np.linalg.norm(edge)
    positions = np.array([p.at_m for p in recording.garment.points]) - ends[0]
    share, below = positions @ along / np.linalg.norm(edge), positions @ np.array([along[1], -along[0]])
    ends = recording.held(recording.time)
    normal, held = level_normal(ends), ends.reshape(-1, 2, 3)
    on_edge = held[:, None, 0] + share[None, :, None] * (held[:, None, 1] - held[:, None, 0])

    def turned(angle: Floats) -> Floats:
        down = np.sin(angle)[:, None] * normal - np.cos(angle)[:, None] * np.array([0.0, 0.0, 1.0])
        return np.asarray(on_edge + below[None, :, None] * down[:, None])

    return turned


def _error(judge: Judge, of: Callable[[Recording], Floats]) -> ErrorFigure:
    return judge.errors_of([of(recording) for recording in judge.recordings])[0]
