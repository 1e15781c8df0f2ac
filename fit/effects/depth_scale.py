"""Depth scale: the sensor reads every distance too long or too short by the same share.

    y = c + (1 + s) (x - c)        c: the camera

The error concerns the points alone if the hanger was measured by other means. Otherwise it concerns the whole scene,
hanger included. In that case the path scaled back drives the cloth, and the simulated points are scaled. The camera is
in the origin of the sensor's frame. The rig of an imported take states its place (`camera_at_m`). Without a statement
it is the origin there as well.

The amplitude is s, of the points alone and of the whole scene; positive reads distances too long.

Believe it when the error grows with the distance from the sensor and is there at rest. A tape measure to the hanger
settles the question.

Source: pinhole geometry; structured-light sensors are off by 0.3 to 3 % (K. Khoshelham & S. Oude Elberink, Sensors 12
(2012), section 4).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Curve, Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats


@dataclass(frozen=True)
class DepthScale(Effect):
    """Relative error of distances, of the points alone and of the whole scene."""

    name: ClassVar[str] = "depth_scale"
    title: ClassVar[str] = "a wrong depth scale"
    acts_on: ClassVar[str] = "measurement"
    unit: ClassVar[str] = "1"
    low: ClassVar[float] = -0.06  # our choice: as far as `high`
    high: ClassVar[float] = 0.06  # our choice: twice the largest error of the source, 3 %
    typical: ClassVar[float] = 0.01  # our choice: within the source's 0.3 to 3 %
    # Errors of disparity grow with the distance; the size is that of `Effect`. Errors in proportion to it leave 0.002
    # of the squared effect in swings of 0.10 m at 1.6 m, (0.07 / 1.6)^2. Laws may leave 0.06.
    law_spread: ClassVar[float] = 0.08
    components: ClassVar[tuple[str, ...]] = ("points", "scene")

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the true path of the held ends behind the scaled one."""
        camera = np.tile(recording.viewpoint, 2)
        return lambda instants: camera + (path(instants) - camera) / (1.0 + amplitude[1])

    def observe(self, points: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return the points as the sensor scales them."""
        scale = (1.0 + amplitude[0]) * (1.0 + amplitude[1])
        return np.asarray(points * scale + np.array(recording.viewpoint) * (1.0 - scale))

    def unobserved(self, targets: Floats, recording: Recording, amplitude: Floats) -> Floats:
        """Return targets scaled back."""
        scale = (1.0 + amplitude[0]) * (1.0 + amplitude[1])
        camera = np.concatenate([recording.viewpoint, np.zeros(3)])
        return np.asarray(targets / scale + camera * (1.0 - 1.0 / scale))
