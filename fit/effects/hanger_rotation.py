"""Hanger rotation: the cloth's held edge turns against the markers.

    held_k(t) = m(t) + Rot_z(psi) Rot_y(phi) (measured_k(t) - m(t)),   psi = a_1 p_psi(t),  phi = a_2 p_phi(t)

about the middle m of the held edge: psi is yaw (about the vertical), phi roll (in the plane of the cloth). Their
courses
p are what the tracked points along the held edge show against the measured path (least squares of displacement on the
place along the edge, through the same 6 Hz smoothing as the path), scaled to a root mean square of 1 rad, so that the
amplitude is the rotation's root mean square. Points on the held edge measure the boundary and are not judged.
Source: small rotations, H. Goldstein, "Classical Mechanics" (1980), section 4.8.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.effects.base import Curve, Effect, Floats
from fit.recording import Recording


@dataclass(frozen=True)
class HangerRotation(Effect):
    """Yaw and roll of the held edge against the markers, root mean square over the take."""

    name: ClassVar[str] = "hanger_rotation"
    title: ClassVar[str] = "a rotation of the hanger that was not captured"
    acts_on: ClassVar[str] = "boundary"
    unit: ClassVar[str] = "rad"
    low: ClassVar[float] = -0.3
    high: ClassVar[float] = 0.3
    typical: ClassVar[float] = 0.03
    components: ClassVar[tuple[str, ...]] = ("yaw", "roll")

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends, turned about their middle."""
        if not amplitude.any():
            return path

        def drive(instants: Floats) -> Floats:
            ends = path(instants).reshape(-1, 2, 3)
            yaw, roll = (recording.edge_turn(instants) * amplitude).T
            middle = ends.mean(1, keepdims=True)
            arm = ends - middle
            c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
            x, y, z = arm[..., 0], arm[..., 1], arm[..., 2]
            x, y = c * x - s * y, s * x + c * y
            c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
            x, z = c * x - s * z, s * x + c * z
            return np.asarray((middle + np.stack([x, y, z], 2)).reshape(-1, 6))

        return drive
