"""Hanger compliance: rod or hook bend, so that the cloth's held edge lags behind the markers.

    e'' + 2 zeta w e' + w^2 e = -a(t),     held = measured + e,     c = 1 / w^2

Here a is the level part of the acceleration of the held edge's middle. A hanging rod bends sideways and is stiff along
itself. For a round rod the ratio of both stiffnesses is EA/L over 3EI/L^3 = 16/3 (L/d)^2. In slow motion e = -c a, and
c = 0 is rigid. The solution is exact for an acceleration that is constant over each millisecond.

The amplitude is the compliance c [s^2], never negative.

Believe it when the cloth's held edge goes on trembling after the markers have stopped, at a few swings a second.

Source: base-excited oscillator, J. P. Den Hartog, "Mechanical Vibrations" (1956), section 2.6; rods ring at 4 to 12 Hz.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fit.cloth.effect import Curve, Effect
from fit.recordings.recording import Recording
from formats.arrays import Floats

# 1, share of critical damping of a rod in a hand. Our choice: between the 3 and 20 % that rods ring with. On a rod of
# 4 Hz and motion below 3 Hz, these leave 0.06 and 0.03 of the squared bending (measured, at the best compliance).
ROD_DAMPING = 0.1
# s; the acceleration counts as constant over one. Our choice: that errs by 0.6 % of the bending of the same rod, and at
# twice by 1.2 % (measured). Half was not tried.
ROD_STEP = 1e-3


@dataclass(frozen=True)
class HangerCompliance(Effect):
    """Compliance of the hanger between markers and cloth."""

    name: ClassVar[str] = "hanger_compliance"
    title: ClassVar[str] = "a hanger that bends"
    acts_on: ClassVar[str] = "boundary"
    unit: ClassVar[str] = "s^2"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 4e-3  # 2.5 Hz
    typical: ClassVar[float] = 7e-4  # 6 Hz
    # Rods ring with 3 to 20 % of critical damping. Our choice: laws may leave 0.36 of a gap, six times what such a
    # damping leaves of one rod's bending (`ROD_DAMPING`). At half 0.09; double leaves more than a gap.
    law_spread: ClassVar[float] = 0.2
    probes: ClassVar[tuple[float, ...]] = (1.8e-4, 3e-4, 4.5e-4, 1e-3, 1.4e-3, 2e-3)  # a fifth apart in frequency

    def drive(self, path: Curve, recording: Recording, amplitude: Floats) -> Curve:
        """Return the path of the held ends with the bending of the rod."""
        if amplitude[0] == 0.0:
            return path
        time = np.arange(0.0, recording.duration + 0.1, ROD_STEP)
        middle = path(time).reshape(-1, 2, 3).mean(1)
        acceleration = np.gradient(np.gradient(middle, ROD_STEP, axis=0), ROD_STEP, axis=0)
        acceleration[:2] = acceleration[-2:] = 0.0
        acceleration[:, 2] = 0.0
        bent = respond(acceleration, ROD_STEP, 1.0 / np.sqrt(float(amplitude[0])))

        def drive(instants: Floats) -> Floats:
            aside = np.stack([np.interp(instants, time, bent[:, c]) for c in range(3)], 1)
            return np.asarray(path(instants) + np.tile(aside, 2))

        return drive


def respond(acceleration: Floats, dt: float, omega: float) -> Floats:
    """Return the deflection e [m], (n, 3), of a rod of natural frequency omega [rad/s] to accelerations, (n, 3)."""
    from scipy.linalg import expm
    from scipy.signal import lfilter, ss2tf

    system = np.array([[0.0, 1.0, 0.0], [-(omega**2), -2 * ROD_DAMPING * omega, -1.0], [0.0, 0.0, 0.0]])
    whole = expm(system * dt)
    gains, poles = ss2tf(whole[:2, :2], whole[:2, 2:], np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    return np.asarray(lfilter(gains[0], poles, acceleration, axis=0))
