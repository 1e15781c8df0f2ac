"""Hand-swung hanger paths: still, swung by name, stopped, still; with the jitter of a hand.

A motion is a sum of sines in displacement, yaw and roll under quintic ramps s^3 (10 - 15 s + 6 s^2). So accelerations
are continuous (T. Flash, N. Hogan, J. Neurosci. 5 (1985): hands move with least jerk).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_host.errors import SensorAddressError
from formats.arrays import Floats

# s. Our choice: a second at rest shows the first shape, and a hand starts and stops within half a swing. Half and
# double were not tried.
START, RAMP = 1.0, 0.5
SHORTEST_MOVING = 1.0  # s; our choice: half a swing of the slowest motion, 0.5 Hz
STOP_SHARE, STOP_TIME = 0.65, 0.3  # of the recording; s; our choice: a third is left in which the swing decays
# m, root mean square of the jitter. Our choice: below a pixel at 1.6 m, 2.8 mm. It was not measured, and half and
# double were not tried.
HAND_JITTER = 1e-3


@dataclass(frozen=True)
class Sine:
    """One part of a motion: along x, y, z [m], yaw or roll [rad], from and to shares of the moving time."""

    axis: str
    hertz: float
    amplitude: float
    first: float = 0.0
    last: float = 1.0  # the whole moving time


@dataclass(frozen=True)
class HangerPose:
    """Displacement [m], (n, 3), sensor frame; yaw about the vertical and roll about z [rad], (n,)."""

    displacement: Floats
    yaw: Floats
    roll: Floats


HANGER_MOTIONS: dict[str, tuple[Sine, ...]] = {
    "swing": (Sine("z", 0.6, 0.05, 0.0, 0.55), Sine("z", 0.85, 0.09, 0.45, 1.0)),
    "mixed": (
        Sine("z", 0.5, 0.10), Sine("z", 1.1, 0.03, 0.3, 1.0), Sine("x", 0.7, 0.03), Sine("yaw", 0.4, np.radians(5.0)),
        Sine("roll", 0.6, np.radians(1.0)),
    ),
    "gentle": (Sine("z", 0.7, 0.04),),
    "twist": (Sine("yaw", 0.6, np.radians(20.0)), Sine("z", 0.5, 0.03)),
    # Up to 1.5 m/s at the hanger; hems whip, corners fold under.
    "hard": (Sine("z", 1.1, 0.18), Sine("x", 0.9, 0.12), Sine("yaw", 0.8, np.radians(15.0))),
}  # fmt: skip


def hanger_pose(motion: str, time: Floats, seed: int, seconds: float, rest: float = START) -> HangerPose:
    """Return the hanger's pose of a named motion at times [s], (n,), in a recording of so many seconds.

    rest: the seconds before the hand begins

    Raises:
        SensorAddressError: there is no such motion.
    """
    if motion not in HANGER_MOTIONS:
        raise SensorAddressError(
            f"there is no motion {motion!r}",
            where="--motion",
            advice=f"choose one of {', '.join(sorted(HANGER_MOTIONS))}",
        )
    stop = STOP_SHARE * seconds
    moving = stop - rest
    parts = {axis: np.zeros_like(time) for axis in ("x", "y", "z", "yaw", "roll")}
    for sine in HANGER_MOTIONS[motion]:
        begin, end = rest + sine.first * moving, rest + sine.last * moving
        parts[sine.axis] += sine.amplitude * np.sin(2 * np.pi * sine.hertz * (time - begin)) * _window(time, begin, end)
    rng = np.random.default_rng([seed, 77])
    for axis in ("x", "y", "z"):
        for _ in range(3):
            hertz, phase = rng.uniform(2, 4), rng.uniform(0, 2 * np.pi)
            wave = np.sin(2 * np.pi * hertz * time + phase)
            parts[axis] += HAND_JITTER * np.sqrt(2 / 9) * wave * _window(time, rest, stop)
    return HangerPose(np.stack([parts["x"], parts["y"], parts["z"]], 1), parts["yaw"], parts["roll"])


def _window(time: Floats, begin: float, end: float) -> Floats:
    """One between begin and end, zero outside, with quintic flanks."""

    def flank(share: Floats) -> Floats:
        s = np.clip(share, 0.0, 1.0)
        return np.asarray(s**3 * (10 - 15 * s + 6 * s * s))

    return flank((time - begin) / RAMP) * flank((end - time) / STOP_TIME)
