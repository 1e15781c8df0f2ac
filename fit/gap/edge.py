"""What the tracked points on the held edge say of the boundary and of the measurement, against simulated ones.

A simulated edge is where hanger and effects put it, whatever the cloth: it moves with no parameter of the cloth. In
each frame, by least squares over its points at places s_p from their middle, displacements d_p = y_p - x_p are

    d_p = m + s_p q,   four numbers: m (3), and the stretch q . b along the bar b, times the rms of s_p

Turning is left out: `hanger_rotation` takes its course from it (`fit.held_edge`). Like the cloth's residuals the
numbers are split in what varies, known by the noise of points and path, and the mean over a take, known as well as the
points' own offsets:

    dynamic  (d - mean d) / sqrt(sigma^2 + path^2)      static  mean d / sqrt(offset^2 + (sigma^2 + path^2) / n)

The path's noise is what its spline leaves of white noise. A steady spline of cut-off f_c at n frames a second keeps of
its variance (2 / n) integral df / (1 + (f / f_c)^6)^2 = (5 pi / 9) f_c / n (`fit.smoothing`).
Source: the integral: I. S. Gradshteyn & I. M. Ryzhik, "Table of Integrals, Series, and Products" (2007), 3.241.5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fit.gap.noise import held_noise, point_noise
from fit.recording import Recording

Floats = NDArray[np.float64]

OFFSET_SD = 1e-3  # m, prior of a marker's constant offset: glue, and where its middle is taken to be
KEPT = 5 * np.pi / 9  # of the variance of white noise, per cut-off over rate
FEWEST_POINTS = 2  # of which one stretch can be told
NUMBERS = 4  # of a frame: three of the middle, one of the stretch


class EdgeResiduals:
    """Residuals of one recording's held edge; none where it is not tracked or its points are judged like the others.

    frame, (frames,): indices of the frames that count; sd [m], (frames, NUMBERS), of the numbers; static_sd [m] of
    their means, (NUMBERS,) or, where no frame counts, (0,)
    """

    def __init__(self, recording: Recording) -> None:
        on_edge = np.flatnonzero(~recording.judged)
        across = np.array([recording.garment.points[k].at_m[0] for k in on_edge])
        arm = across - across.mean() if len(across) else across
        seen = recording.valid[:, on_edge]
        weight = seen.astype(float)
        count, first, second = weight.sum(1), weight @ arm, weight @ arm**2
        determinant = count * second - first**2
        spread = float((arm**2).sum())
        self.frame = np.flatnonzero((count >= FEWEST_POINTS) & (determinant > 0.1 * count * spread))
        weight, determinant = weight[self.frame], determinant[self.frame, None]
        self._points = on_edge
        self._middle = weight * (second[self.frame, None] - first[self.frame, None] * arm) / determinant
        self._slope = weight * (count[self.frame, None] * arm - first[self.frame, None]) / determinant
        self._arm = float(np.sqrt(spread / max(len(arm), 1)))
        held = recording.held(recording.time[self.frame]).reshape(-1, 2, 3)
        self._bar = held[:, 1] - held[:, 0]
        self._bar /= np.linalg.norm(self._bar, axis=1, keepdims=True)
        self._measured = np.nan_to_num(recording.points[self.frame][:, on_edge])
        rate = (len(recording.time) - 1) / recording.duration
        path = float(np.sqrt((held_noise(recording) ** 2).mean() * KEPT * recording.held_cut_off / rate / 2))
        squared = point_noise(recording)[on_edge] ** 2
        weights = np.stack([*[self._middle] * 3, self._arm * self._slope], 1)
        self.sd = np.sqrt(weights**2 @ squared + path**2)
        offsets = OFFSET_SD * np.linalg.norm(weights.sum(0) / max(len(weights), 1), axis=1)
        static = np.sqrt(offsets**2 + (self.sd**2).sum(0) / max(len(weights), 1) ** 2)
        self.static_sd = static if len(weights) else np.zeros(0)

    def of(self, simulated: Floats) -> tuple[Floats, Floats]:
        """Return dynamic and static residuals, (candidates, 4 frames) and (candidates, 4), of (..., points, 3) [m]."""
        if not len(self.frame):
            return np.zeros((len(simulated), 0)), np.zeros((len(simulated), 0))
        apart = self._measured - simulated[:, self.frame][:, :, self._points]
        middle = np.einsum("fp,cfpx->cfx", self._middle, apart)
        stretch = self._arm * np.einsum("fp,cfpx,fx->cf", self._slope, apart, self._bar)
        numbers = np.concatenate([middle, stretch[..., None]], 2)
        mean = numbers.mean(1)
        return ((numbers - mean[:, None]) / self.sd).reshape(len(simulated), -1), mean / self.static_sd
