"""Planted effects of the boundary: differences between the markers' path and the true held edge.

    hanger_compliance   e'' + 2 zeta w e' + w^2 e = -a for the level parts only, w^2 = 1/c, zeta = 0.06, velocity Verlet
    hanger_rotation     yaw and roll about the middle that the markers do not show, slow random courses of given rms;
                        roll in the upright plane through the bar
    attachment_offset   a constant shift in the hanger's frame (along the bar, down, out)
    clip_slip           one end slides down when the hanger's acceleration is largest, d (1 - e^(-t / 40 ms))
    clip_slack          the ends are nearer to each other than measured

Source: J. P. Den Hartog, "Mechanical Vibrations" (1956), section 2.6; H. Goldstein, "Classical Mechanics" (1980), 4.8.
"""

from __future__ import annotations

import numpy as np

from fit.blind.engine import SAMPLES_A_SECOND
from fit.blind.hands import course, step
from fit.blind.plants import Planted
from formats.arrays import Floats

# Of a bare rod or hook. Our choice: within the 3 to 20 % that rods ring with, and not the library's 10 %. Half and
# double are also within; they were not tried.
ZETA = 0.06
SLIP_TIME = 0.04  # s; our choice: hardly more than a frame at 30 a second, half and double were not tried
ROTATION_BAND = (0.3, 1.5)  # Hz; our choice: the rates at which hands swing, half and double were not tried


def real_ends(ends: Floats, planted: tuple[Planted, ...], take: int) -> Floats:
    """Return the true ends of the held edge [m], (samples, 6), from those of the markers; `SAMPLES` a second."""
    for one in planted:
        change = {
            "hanger_compliance": _compliance, "hanger_rotation": _rotation, "attachment_offset": _offset,
            "clip_slip": _slip, "clip_slack": _slack,
        }.get(one.id)  # fmt: skip
        if change is not None:
            ends = change(ends, one, take)
    return ends


def acceleration(ends: Floats) -> Floats:
    """Return the acceleration of the middle of the bar [m/s^2], (samples, 3)."""
    middle = (ends[:, :3] + ends[:, 3:]) / 2
    return np.asarray(np.gradient(np.gradient(middle, axis=0), axis=0) * SAMPLES_A_SECOND**2)


def _compliance(ends: Floats, planted: Planted, take: int) -> Floats:
    finer, omega = 10, 1 / np.sqrt(planted.amplitude)
    dt = 1 / (finer * SAMPLES_A_SECOND)
    pushes = -acceleration(ends)
    pushes[:, 2] = 0.0
    bent, speed = np.zeros(3), np.zeros(3)
    moved = np.zeros((len(ends), 3))
    kept = np.exp(-ZETA * omega * dt)
    for k in range(len(ends) - 1):
        for part in range(finer):
            push = pushes[k] + (pushes[k + 1] - pushes[k]) * part / finer
            speed = kept * speed + 0.5 * dt * (push - omega**2 * bent)
            bent = bent + dt * speed
            speed = kept * (speed + 0.5 * dt * (push - omega**2 * bent))
        moved[k + 1] = bent
    return ends + np.tile(moved, 2)


def _rotation(ends: Floats, planted: Planted, take: int) -> Floats:
    rng = np.random.default_rng([planted.seed, take])
    still_at_first = step(np.arange(len(ends)) / SAMPLES_A_SECOND, 0.1, 0.5)[:, None]
    turns = still_at_first * np.stack([course(rng, len(ends), ROTATION_BAND) for _ in range(2)], 1)
    turns /= np.sqrt((turns**2).mean(0))
    yaw, roll = planted.components["yaw"] * turns[:, 0], planted.components["roll"] * turns[:, 1]
    middle, arm = (ends[:, :3] + ends[:, 3:]) / 2, (ends[:, 3:] - ends[:, :3]) / 2
    return turned(middle, arm, yaw, roll)


def turned(middle: Floats, arm: Floats, yaw: Floats, roll: Floats) -> Floats:
    """Return the ends, (samples, 6), of a bar with this middle and half arm, (samples, 3), after yaw and roll.

    The yaw is about z. The roll is in the vertical plane through the bar, about its level normal.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = c * arm[:, 0] - s * arm[:, 1], s * arm[:, 0] + c * arm[:, 1], arm[:, 2]
    level = np.hypot(x, y)
    c, s = np.cos(roll), np.sin(roll)
    share, z = c - s * z / level, s * level + c * z
    arm = np.stack([share * x, share * y, z], 1)
    return np.concatenate([middle - arm, middle + arm], 1)


def _offset(ends: Floats, planted: Planted, take: int) -> Floats:
    along = ends[:, 3:] - ends[:, :3]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    down = np.array([0.0, 0.0, -1.0]) + along[:, 2:] * along
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    frame = np.stack([along, down, np.cross(along, down)], 1)
    shift = np.einsum("k,nkc->nc", np.array(list(planted.components.values())), frame)
    return np.asarray(ends + np.tile(shift, 2))


def _slip(ends: Floats, planted: Planted, take: int) -> Floats:
    at = int(np.argmax(np.linalg.norm(acceleration(ends), axis=1)))
    since = np.maximum(np.arange(len(ends)) - at, 0) / SAMPLES_A_SECOND
    ends = ends.copy()
    for column, side in ((2, "left"), (5, "right")):
        ends[:, column] -= planted.components[side] * (1 - np.exp(-since / SLIP_TIME))
    return ends


def _slack(ends: Floats, planted: Planted, take: int) -> Floats:
    along = ends[:, 3:] - ends[:, :3]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    nearer = 0.5 * planted.components[""] * along
    return np.concatenate([ends[:, :3] + nearer, ends[:, 3:] - nearer], 1)
