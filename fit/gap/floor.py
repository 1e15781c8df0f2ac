"""The noise floor: the error that would be left if the model were perfect.

Simulation-extrapolation: add the estimated noise to the data once more and score again with the same parameters; the
growth of the squared error is the noise's own share, as seen by the whole pipeline, never below the points' own noise:

    floor^2 = max(E^2(one more) - E^2(0), mean of 3 sigma_p^2)

The noise of each point is the larger of what the take states and what sixth differences show. The hanger's measured
path, which drives the cloth, gets its own noise once more as well, through the same smoothing: what is left of it
shakes the cloth, by millimetres in the free motion of a noisy take, and no model of the cloth can know of it. It is
what sixth differences show, since what a take states of its hanger may be the error of a constant. Noise that a take
states too large makes a floor that a model can fall below: the diagnosis takes the best model's error then.

Where points lie on a grid, noise that is slow in time shows too: it is independent from point to point, while a model's
error is smooth over the cloth. With the residual r and the mean of opposite neighbours M r,

    sigma^2 = median_p  mean (r - M r)_p^2 / (1 + sum_q M_pq^2)

The larger of both counts, the second at most LARGEST_RATIO times the first: wrinkles that the mesh lacks are not noise.
Sources: J. R. Cook & L. A. Stefanski, "Simulation-extrapolation estimation ...", JASA 89 (1994); T. Gasser, L. Sroka,
C. Jennen-Steinmetz, "Residual variance and residual pattern in nonlinear regression", Biometrika 73 (1986).
"""

from __future__ import annotations

import numpy as np

from fit.effects.tracker_smoothing import opposite_neighbours
from fit.observer.residuals import Observer, residuals_together
from fit.recordings.noise import held_noise, point_noise
from fit.recordings.recording import Recording
from formats.arrays import Floats

REPLICAS = 3
LARGEST_RATIO = 1.5  # of slow and fast noise together over fast noise alone
FEWEST_NEIGHBOURS = 9  # points with opposite neighbours below which nothing is said


def noise_floor(
    observer: Observer, vector: Floats, amplitudes: Floats, rng: np.random.Generator
) -> tuple[float, float]:
    """Return the noise floor of the observer's error [mm] and its standard error over replicas."""
    every = [observer, *(observer.of([noisier(r, rng) for r in observer.recordings]) for _ in range(REPLICAS))]
    residuals = [found[0] for found in residuals_together([(o, vector[None], amplitudes[None]) for o in every])]
    residual = residuals[0]
    before, *after = (float(o.in_mm(r)) ** 2 for o, r in zip(every, residuals, strict=True))
    grown = np.array(after) - before
    # Where little of the motion is explained, chance may make an error smaller by noise; the points' own noise stays.
    floors = np.sqrt(np.maximum(grown, own_noise_mm(observer) ** 2))
    fast = float(floors.mean())
    slow = neighbour_noise(observer, residual)
    # Cut off as they are: below the points' own noise, which is known well, they tell of the misfit and not of noise.
    return max(fast, min(slow, LARGEST_RATIO * fast)), float(floors.std(ddof=1) / np.sqrt(REPLICAS))


def own_noise_mm(observer: Observer) -> float:
    """Root mean square distance [mm] by which the judged points are off by their own noise alone."""
    seen = [recording.counted.sum(0) for recording in observer.recordings]
    squares = sum(float((3 * point_noise(r) ** 2 * n).sum()) for r, n in zip(observer.recordings, seen, strict=True))
    return 1e3 * float(np.sqrt(squares / sum(int(n.sum()) for n in seen)))


def noisier(recording: Recording, rng: np.random.Generator) -> Recording:
    """Return a recording whose points and hanger have their noise twice."""
    points = recording.points + rng.normal(size=recording.points.shape) * point_noise(recording)[:, None]
    held = recording.held_seen + rng.normal(size=recording.held_seen.shape) * held_noise(recording)
    return recording.with_points(points).with_held(held)


def neighbour_noise(observer: Observer, residual: Floats) -> float:
    """Root mean square distance [mm] of noise that is independent from point to point; 0 where points are too few."""
    grids = observer.by_place(observer.layout.metres(residual))
    squares = []
    for recording, grid in zip(observer.recordings, grids, strict=True):
        judged = np.flatnonzero(recording.judged)
        mixing = opposite_neighbours(np.array([recording.garment.points[k].at_m for k in judged]))
        has_neighbours = np.diag(mixing) == 0.0
        if has_neighbours.sum() < FEWEST_NEIGHBOURS:
            continue
        missing = np.isnan(grid[:, judged])
        apart = grid[:, judged] - np.einsum("pq,fqc->fpc", mixing, np.nan_to_num(grid[:, judged]))
        broken = missing | (np.einsum("pq,fqc->fpc", (mixing > 0).astype(float), missing.astype(float)) > 0)
        apart[broken] = np.nan
        factor = 1 + (mixing**2).sum(1)
        with np.errstate(invalid="ignore"):
            counted = np.maximum((~broken).sum((0, 2)), 1)
            per_point = np.nansum(apart**2, axis=(0, 2)) / counted / factor
        squares.append(per_point[has_neighbours & (counted > 1)])
    return 1e3 * float(np.sqrt(3 * np.median(np.concatenate(squares)))) if squares else 0.0
