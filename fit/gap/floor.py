"""Noise floor: the error that a perfect model would have, from the noise of the takes alone.

The method is simulation-extrapolation: add the noise to the data once more and score again with the same parameters.
The growth of the squared error is the noise's own share, as seen by the whole pipeline. It is never below the points'
own noise:

    floor^2 = max(mean of E^2(one more) - E^2(0), mean of 3 sigma_p^2)

The noise sigma_p of each point is measured on the takes judged on. White noise w shows in sixth differences of the
frames, and of slow takes in the points at rest. On a grid of points, noise of any colour shows. Noise is independent
from point to point, while the error of a model is smooth over the cloth. With the residual r and the mean of opposite
neighbours M r,

    s^2 = median_p  mean (r - M r)_p^2 / (1 + sum_q M_pq^2),   sigma = max(w, min(s, max(LARGEST_RATIO w, stated)))

Wrinkles too fine for the mesh are no noise, hence the limit. Without a grid, slow noise is not measurable, and the
figure that the take states is a fallback (`fit.recordings.noise`). The verdict reports a contradicted figure. The
measured path of the hanger, which drives the cloth, also receives its own noise once more, before the smoothing. The
noise that passes the smoothing shakes the cloth, by millimetres in the free motion of a noisy take. No model of the
cloth can follow it. Sixth differences measure the path's noise, because a stated figure may be the error of a constant.
A silhouette's camera leaves more than noise. Its held row follows the hanger whatever the cloth does, and keeps an
error across the cloth after the camera's faults are corrected. All points of a frame share this error, which is added
in squares. Sources: J. R. Cook & L. A. Stefanski, "Simulation-extrapolation estimation ...", JASA 89 (1994); T. Gasser,
L. Sroka, C. Jennen-Steinmetz, "Residual variance and residual pattern in nonlinear regression", Biometrika 73 (1986).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fit.effects.tracker_smoothing import opposite_neighbours
from fit.observer.residuals import Observer, residuals_together
from fit.recordings.noise import held_noise, point_noise, white_noise
from fit.recordings.recording import Recording
from formats.arrays import Floats

# Draws of the noise; our choice: each costs a simulation, and two degrees of freedom give a deviation.
NOISE_REPLICAS = 3
# Of noise of any colour over white noise; our choice: beyond, a model's error would pass for noise.
LARGEST_COLOUR_RATIO = 1.5
# Points with opposite neighbours, below which no estimate is made. Our choice: the inner points of a grid of 5 by 5, of
# which a median is taken. Half and double were not tried.
FEWEST_NEIGHBOURS = 9
# Ratio of stated to measured noise, or its inverse, from which they contradict. Our choice: its square, 1.56, would
# decide whether there is a gap (`SIGNIFICANT_GAP`).
CONTRADICTED = 1.25


@dataclass(frozen=True)
class Floor:
    """Noise floor, its standard error over replicas, and the measured and stated noise of the points; all in mm."""

    mm: float
    error_mm: float
    measured_mm: float
    stated_mm: float

    @property
    def is_contradicted(self) -> bool:
        """Return whether the takes state much more or much less noise than was measured."""
        return not 1 / CONTRADICTED <= self.stated_mm / max(self.measured_mm, 1e-9) <= CONTRADICTED


def noise_floor(observer: Observer, vector: Floats, amplitudes: Floats, rng: np.random.Generator) -> Floor:
    """Return the noise floor of the observer's error."""
    residual = observer.residuals(vector[None], amplitudes[None])[0]
    noise = measured_noise(observer, residual)
    given = list(zip(observer.recordings, noise, strict=True))
    every = [observer.of([noisier(*one, rng) for one in given]) for _ in range(NOISE_REPLICAS)]
    found = [r[0] for r in residuals_together([(o, vector[None], amplitudes[None]) for o in every])]
    grown = np.array([float(o.in_mm(r)) ** 2 for o, r in zip(every, found, strict=True)])
    # If a model explains little of the motion, added noise may reduce an error by chance. The points' noise is the
    # limit.
    own = own_noise_mm(observer, noise)
    shown, row = grown - float(observer.in_mm(residual)) ** 2, row_off_mm(observer) ** 2
    floors = np.sqrt(np.maximum(shown, own**2) + row)
    floor = float(np.sqrt(max(shown.mean(), own**2) + row))
    stated = own_noise_mm(observer, [recording.point_sd for recording in observer.recordings])
    return Floor(floor, float(floors.std(ddof=1) / np.sqrt(NOISE_REPLICAS)), own, stated)


def measured_noise(observer: Observer, residual: Floats) -> list[Floats]:
    """Return the noise of each point per axis [m], (points,) a take, as a standard deviation.

    Slow takes show noise only at rest. A take without rest gets the noise of the other takes.
    """
    any_colour = neighbour_noise(observer, residual)
    every_white = [white_noise(recording) for recording in observer.recordings]
    shown = [white for white in every_white if white is not None]
    found = []
    for recording, white, independent in zip(observer.recordings, every_white, any_colour, strict=True):
        if independent is None or not shown:
            found.append(point_noise(recording))
            continue
        least = np.full(len(recording.point_sd), np.median(np.concatenate(shown))) if white is None else white
        most = np.maximum(LARGEST_COLOUR_RATIO * least, recording.point_sd)
        found.append(np.maximum(least, np.minimum(independent, most)))
    return found


def own_noise_mm(observer: Observer, noise: list[Floats]) -> float:
    """Return the root mean square error [mm] of the judged points due to their noise [m], (points,) a take."""
    seen = [recording.counted.sum(0) for recording in observer.recordings]
    squares = sum(float((3 * own**2 * n).sum()) for own, n in zip(noise, seen, strict=True))
    return 1e3 * float(np.sqrt(squares / sum(int(n.sum()) for n in seen)))


def row_off_mm(observer: Observer) -> float:
    """Return the root mean square error [mm] that the held row of silhouettes keeps; 0 for other points."""
    off = [(recording.camera.row_off, int(recording.counted.sum())) for recording in observer.recordings]
    return 1e3 * float(np.sqrt(sum(value**2 * n for value, n in off) / sum(n for _, n in off)))


def noisier(recording: Recording, noise: Floats, rng: np.random.Generator) -> Recording:
    """Return a recording with noise added to its points, of deviations [m], (points,), and to its hanger path."""
    points = recording.points + rng.normal(size=recording.points.shape) * noise[:, None]
    held = recording.held_seen + rng.normal(size=recording.held_seen.shape) * held_noise(recording)
    return recording.with_points(points).with_held(held)


def neighbour_noise(observer: Observer, residual: Floats) -> list[float | None]:
    """Return the noise per axis [m] that is independent between points; None if too few points form a grid."""
    grids = observer.by_place(observer.layout.metres(residual))
    found: list[float | None] = []
    for recording, grid in zip(observer.recordings, grids, strict=True):
        judged = np.flatnonzero(recording.judged)
        mixing = opposite_neighbours(np.array([recording.garment.points[k].at_m for k in judged]))
        has_neighbours = np.diag(mixing) == 0.0
        if has_neighbours.sum() < FEWEST_NEIGHBOURS:
            found.append(None)
            continue
        missing = np.isnan(grid[:, judged])
        apart = grid[:, judged] - np.einsum("pq,fqc->fpc", mixing, np.nan_to_num(grid[:, judged]))
        broken = missing | (np.einsum("pq,fqc->fpc", (mixing > 0).astype(float), missing.astype(float)) > 0)
        apart[broken] = np.nan
        counted = np.maximum((~broken).sum((0, 2)), 1)
        per_point = np.nansum(apart**2, axis=(0, 2)) / counted / (1 + (mixing**2).sum(1))
        found.append(float(np.sqrt(np.median(per_point[has_neighbours & (counted > 1)]))))
    return found
