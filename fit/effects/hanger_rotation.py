"""Hanger rotation: the cloth's held edge turns against the markers.

    held_k(t) = m(t) + Rot_n(phi) Rot_z(psi) (measured_k(t) - m(t))
    psi = a_1 p_psi(t) / s_1,   phi = a_2 p_phi(t) / s_2

The edge turns about its middle m. The yaw psi turns it about the vertical z. The roll phi turns it about the edge's
level normal n, in the plane of the hanging cloth.

The tracked points along the held edge give both angles p [rad] relative to the measured path, over time. Each angle is
the slope of a least-squares line through the points' displacements along the edge. The same 6 Hz smoothing as the
path's acts on these displacements. The root mean square of p over the fitted takes is s, so the amplitude is the
rotation in those takes. A take that turns twice as much gets twice the rotation. Points on the held edge measure the
boundary and are not judged.

The amplitude is a, of yaw and of roll; positive turns the way that the tracked edge shows.

Believe it when the tracked points along the held edge turn and the markers do not. Without points on that edge this
effect is not identifiable.

Source: small rotations, H. Goldstein, "Classical Mechanics" (1980), section 4.8.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Curve, Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats


@dataclass(frozen=True)
class HangerRotation(Effect):
    """Yaw and roll of the held edge relative to the markers, root mean square over the fitted takes."""

    name: ClassVar[str] = "hanger_rotation"
    title: ClassVar[str] = "a rotation of the hanger that was not captured"
    acts_on: ClassVar[str] = "boundary"
    unit: ClassVar[str] = "rad"
    low: ClassVar[float] = -0.3  # our choice: as far as `high`
    high: ClassVar[float] = 0.3  # our choice: 17 degrees, ten times the typical size
    typical: ClassVar[float] = 0.03  # our choice: 1.7 degrees
    components: ClassVar[tuple[str, ...]] = ("yaw", "roll")

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends, turned about their middle."""
        if not amplitude.any():
            return path

        def drive(instants: Floats) -> Floats:
            ends = path(instants).reshape(-1, 2, 3)
            yaw, roll = (recording.edge_turn(instants) / recording.turn_rms * amplitude).T
            middle = ends.mean(1, keepdims=True)
            arm = ends - middle
            c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
            x, y, z = arm[..., 0], arm[..., 1], arm[..., 2]
            x, y = c * x - s * y, s * x + c * y
            level = np.stack([x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]], 1)
            level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-9)
            along = x * level[:, :1] + y * level[:, 1:]
            c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
            along, z = c * along - s * z, s * along + c * z
            return np.asarray((middle + np.stack([*along[None] * level.T[:, :, None], z], 2)).reshape(-1, 6))

        return drive
