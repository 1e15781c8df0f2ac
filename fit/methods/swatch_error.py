"""Error E of the motion capture method: averaged position, speed and curvature of each marker of a swatch.

    E = sum_i { alpha |<x_i>^R - <x_i>^S| + beta |<v_i>^R - <v_i>^S|
                + gamma (|<kappa_1i>^R - <kappa_1i>^S| + |<kappa_2i>^R - <kappa_2i>^S|) }

<.> is the average over all frames, kappa_1 and kappa_2 the curvatures of the marker's column and row, alpha = 1, beta =
0.5, gamma = 2.

Source: "Optimization of Cloth Simulation Parameters by Considering Static and Dynamic Features", eq. 1.

The paper leaves five points open. We chose:

- Units are metres, so the parts are in m, m/s and 1/m.
- v is the speed |v|. The average of the velocity vector depends only on the marker's first and last position.
- The same smoothing spline (`fit.recordings.recording`) smooths both sides before differentiation.
- A frame in which a marker is not seen counts for neither side. It also does not count for any curvature whose spline
  uses this marker.
- E is divided by the number of markers.

Through the markers of a row or column runs a uniform Catmull-Rom spline. At marker p_0 with neighbours p_-2 .. p_2

    p' = (p_1 - p_-1) / 2,    p''_right = 2 p_-1 - 5 p_0 + 4 p_1 - p_2,    p''_left = -p_-2 + 4 p_-1 - 5 p_0 + 2 p_1,
    kappa = |p' x p''| / |p'|^3

The second derivative is the mean of both segments' at p_0. If one segment runs beyond the edge, the other one counts
alone. Markers at the ends of a line have no curvature.

White noise of deviation s per axis, after the smoothing, makes straight lines of markers h apart look curved. The
apparent curvature is sqrt(2 (1/4 + 9 + 25 + 9 + 1/4)) s / h^2 (root mean square, two directions across the line). If
that exceeds half of the measured curvature, E sees the noise and not the cloth, and `remark` says so. Take a circle of
radius R with markers an angle phi apart. There kappa R = (5 + cos 2 phi - 6 cos phi) / sin^2 phi, that is 1 + 3/4 phi^2
and smaller terms. Both sides share this factor.

Source: E. Catmull, R. Rom, "A class of local interpolating splines" (1974); M. P. do Carmo, "Differential Geometry of
Curves and Surfaces", section 1-5.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from fit.errors import FitError
from fit.recordings.recording import FEWEST_SIGHTINGS, Recording
from fit.recordings.smoothing import CUT_OFF, low_pass
from formats.arrays import Booleans, Floats, Integers
from formats.plain_text import shortened
from formats.swatch import FEWEST_MARKERS

ALPHA, BETA, GAMMA = 1.0, 0.5, 2.0  # section 3
# Section 2 used 500. Our choice: 100 frames are 3.3 s at 30 Hz, three swings. Half and double were not tried.
NEEDED_FRAMES = 100
RISES_BY = 1e-3  # m; our choice: lower points count as one
NOISE_GAIN = float(np.sqrt(2 * (0.25 + 9 + 25 + 9 + 0.25)))  # curvature times pitch squared per deviation of positions
MOST_NOISE = 0.5  # of the measured curvature; our choice: beyond, most of it may be noise


class SwatchError:
    """E of eq. 1, divided by the number of markers, against one recording of a full grid of markers."""

    name: ClassVar[str] = "E/N"
    unit: ClassVar[str] = "1"
    parts: ClassVar[tuple[str, ...]] = ("position", "velocity", "curvature down", "curvature across")

    def __init__(self, recording: Recording) -> None:
        """Average the recording's own side.

        Raises:
            FitError: the points are no full grid, or there are too few frames.
        """
        if len(recording.time) < NEEDED_FRAMES:
            raise FitError(
                f"the take has {len(recording.time)} frames, mocap-swatch needs {NEEDED_FRAMES}",
                where=recording.take_id,
                advice="record for longer; the published method used 500",
            )
        self._grid = marker_grid(np.array([p.at_m for p in recording.garment.points]), recording.take_id)
        self._time = recording.time
        self._smooth = low_pass(recording.time, np.eye(len(recording.time)), CUT_OFF)
        wanted, _ = recording.targets(recording.time)
        self._seen = recording.valid
        counts = self._seen.sum(0)
        if counts.min() < FEWEST_SIGHTINGS:
            absent = recording.garment.points[int(np.argmin(counts))].name
            shown = f"the marker {absent!r} was seen"
            if recording.camera.is_placed:  # the tracked point is seen, and its place on the cloth is not
                shown = f"the material position of {absent!r} lies within the silhouette"
            raise FitError(
                f"{shown} in {counts.min()} frames, at least {FEWEST_SIGHTINGS} are needed",
                where=recording.take_id,
                advice="fit with --method si, or leave the marker's whole row or column out of the garment",
            )
        self._weights = _weights(self._seen)
        self._down, self._across = np.zeros(self._seen.shape), np.zeros(self._seen.shape)
        lines = self._seen[:, self._grid]
        self._down[:, self._grid] = _weights(curvature_seen(lines.swapaxes(1, 2)).swapaxes(1, 2))
        self._across[:, self._grid] = _weights(curvature_seen(lines))
        self._real = self._averages(wanted[..., :3])
        self.remark = self._noise_remark(recording)

    def _noise_remark(self, recording: Recording) -> str:
        """Return a warning if the stated noise explains most of the measured curvature, else nothing."""
        places = np.array([p.at_m for p in recording.garment.points])[self._grid]
        pitch = float(np.linalg.norm(places[0, 1] - places[0, 0]))
        passed = float(np.sqrt((self._smooth**2).sum(1).mean()))
        noise = NOISE_GAIN * passed * float(np.median(recording.point_sd)) / pitch**2
        inner = self._grid[1:-1, 1:-1]
        measured = float(np.mean([self._real[2][inner].mean(), self._real[3][inner].mean()]))
        if noise <= MOST_NOISE * measured:
            return ""
        return (
            f"Warning: {shortened(recording.take_id)}: the stated noise of its points alone looks like a curvature of "
            f"{noise:.1f} 1/m, {measured:.1f} 1/m were measured: E fits noise here. Use a method that minimises D "
            "(si, kinect-skirt)."
        )

    def terms(self, simulated: Floats) -> Floats:
        """Return the weighted parts of E/N, (candidates, 4), of points [m], (candidates, frames, points, 3)."""
        return np.stack([self._of_one(points) for points in simulated])

    def _of_one(self, points: Floats) -> Floats:
        """Return the four parts of one candidate; single candidates fit into the processor's cache."""
        smooth = (self._smooth @ points.reshape(len(points), -1)).reshape(points.shape)
        place, speed, down, across = self._averages(smooth)
        real_place, real_speed, real_down, real_across = self._real
        return np.array(
            [
                ALPHA * np.linalg.norm(place - real_place, axis=1).mean(),
                BETA * np.abs(speed - real_speed).mean(),
                GAMMA * np.abs(down - real_down).mean(),
                GAMMA * np.abs(across - real_across).mean(),
            ]
        )

    def _averages(self, points: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return mean position [m], (points, 3), speed [m/s], curvatures [1/m], (points,), of (frames, points, 3)."""
        speed = np.linalg.norm(np.gradient(points, self._time, axis=0), axis=2)
        grid = points[:, self._grid]
        down, across = np.zeros(speed.shape), np.zeros(speed.shape)
        down[:, self._grid] = line_curvature(grid.swapaxes(1, 2)).swapaxes(1, 2)
        across[:, self._grid] = line_curvature(grid)
        place = np.einsum("fpc,fp->pc", points, self._weights)
        return place, (speed * self._weights).sum(0), (down * self._down).sum(0), (across * self._across).sum(0)


def _weights(counted: Booleans) -> Floats:
    """Return weights of the frames that count, (frames, ...), zero if none does."""
    return np.asarray(counted / np.maximum(counted.sum(0), 1))


def curvature_seen(seen: Booleans) -> Booleans:
    """Return whether all markers of each curvature are seen, (..., n), for a line of n markers."""
    found = seen.copy()
    found[..., 1:] &= seen[..., :-1]
    found[..., :-1] &= seen[..., 1:]
    found[..., 2:-1] &= seen[..., :-3]
    found[..., 1:-2] &= seen[..., 3:]
    return found


def marker_grid(places: Floats, where: object) -> Integers:
    """Return the indices of a full grid of markers, (rows, columns), top row first, from flat positions, (points, 2).

    Raises:
        FitError: the points are no full grid, or too few.
    """
    columns, rows = (_levels(places[:, axis]) for axis in (0, 1))
    full = len(rows) * len(columns)
    grid = np.full((len(rows), len(columns)), -1)
    for k, (x, y) in enumerate(places):
        grid[len(rows) - 1 - int(np.argmin(np.abs(rows - y))), int(np.argmin(np.abs(columns - x)))] = k
    if full != len(places) or (grid < 0).any() or min(grid.shape) < FEWEST_MARKERS:
        raise FitError(
            f"its {len(places)} points are not a full grid of {FEWEST_MARKERS} x {FEWEST_MARKERS} markers or more",
            where=where,
            advice="mocap-swatch needs rows and columns of markers; `hangtime swatch` describes such a garment",
        )
    return grid


def _levels(values: Floats) -> Floats:
    """Return distinct values in rising order; nearly equal ones are merged."""
    rising = np.sort(values)
    return np.asarray(rising[np.concatenate([[True], np.diff(rising) > RISES_BY])])


def line_curvature(points: Floats) -> Floats:
    """Return the curvature [1/m], (..., n), along lines of points [m], (..., n, 3); 0 at both ends."""
    count = points.shape[-2]
    second = np.zeros_like(points)
    segments = np.zeros(count)
    before, at, after, next_after = points[..., :-3, :], points[..., 1:-2, :], points[..., 2:-1, :], points[..., 3:, :]
    second[..., 1:-2, :] = 2 * before - 5 * at + 4 * after - next_after
    second[..., 2:-1, :] += -before + 4 * at - 5 * after + 2 * next_after
    segments[1:-2] = 1
    segments[2:-1] += 1
    inner = slice(1, count - 1)
    first = 0.5 * (points[..., 2:, :] - points[..., :-2, :])
    bend = second[..., inner, :] / segments[inner, None]
    # |a x b|^2 = |a|^2 |b|^2 - (a.b)^2, several times faster than the cross product
    along, size, mixed = ((a * b).sum(-1) for a, b in ((first, first), (bend, bend), (first, bend)))
    curvature = np.zeros(points.shape[:-1])
    curvature[..., inner] = np.sqrt(np.maximum(along * size - mixed**2, 0.0)) / np.maximum(along, 1e-18) ** 1.5
    return curvature
