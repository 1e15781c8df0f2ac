"""Characterise the missing force from the observer's pull alone, without the library of effects.

The pull per mass at the tracked points, a = w^2 (y - x) + 2 w (ydot - v), is the force that the model lacks. Sensor
noise dominates it above the motion's own frequencies, so pull and features alike pass the same 2 Hz low-pass. The force
is split into its part along the cloth's normal n and the rest. It is regressed on features of the observer's own
motion. Odd features under time reversal are velocities and dissipative. Even features are accelerations and constants,
and conservative:

    odd   v,  |v_n| v_n n          even   (dv/dt . n) n,  dv/dt,  a constant vector

The sign of its power, the mean of a . v, shows whether the force opposes the motion or drives it. A base fit that damps
more than the cloth does needs a force along the motion. The exponent p is the one for which -|v_n|^p sign(v_n) explains
most of the normal part.
Source: regression of increments on model terms as in
R. Mojgani, A. Chattopadhyay, P. Hassanzadeh, "Discovery of interpretable structural model errors", Chaos 32 (2022).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.cloth.simulator import Simulator
from fit.observer.residuals import Observer
from fit.recordings.smoothing import low_pass
from formats.arrays import Floats
from formats.diagnosis_records import VISIBLE_FORCE, ForceAt, MissingForce

FREQUENCY = 3.0  # Hz: simulations then follow the data, whatever the fabric (decision 15)
LOW_PASS = 2.0  # Hz; our choice: hanging cloth swings below 2 Hz, and the pull follows the data to 3 Hz
WITHIN_CLOTH = 0.2  # share along the normal, below which a force acts within the cloth; a random direction has a third
# Powers of the speed that are tried; our choice: dry friction has 0, air drag 1 to 2.
EXPONENTS = np.arange(0.0, 3.01, 0.25)


def find_missing_force(observer: Observer, vector: Floats) -> MissingForce:
    """Characterise the pull that the base model needs to follow the observer's recordings."""
    parts = [_pull(*one) for one in zip(*observer.asked(vector[None], observer.off[None]), strict=True)]
    pull, normal, below, odd, even, powers, point = (_joined([p[k] for p in parts]) for k in range(7))
    along = (pull * normal).sum(1)
    total = max(float((pull**2).sum()), 1e-12)
    both = _explained(pull, np.concatenate([odd, even], 1))
    odd_share = float(np.clip(both - _explained(pull, even), 0, 1))
    even_share = float(np.clip(both - _explained(pull, odd), 0, 1))
    gains = [_explained(along, powers[:, k : k + 1]) for k in range(len(EXPONENTS))]
    exponent = float(EXPONENTS[int(np.argmax(gains))]) if max(gains) > 0.05 else None
    power = (pull**2).sum(1)
    given = float((pull * odd[:, 0]).sum(1).mean())  # the first odd feature is the velocity
    shares = {name: float(power[below == k].sum() / total) for k, name in enumerate(("top", "middle", "bottom"))}
    normal_share = float((along**2).sum() / total)
    return MissingForce(
        normal_share=normal_share,
        odd_share=odd_share,
        even_share=even_share,
        amplitude_exponent=exponent,
        spatial_share=shares,
        sentence=sentence_of(normal_share, odd_share, even_share, exponent, shares, power=given),
        places=_places(observer, pull, along, point),
        power=given,
    )


def _places(observer: Observer, pull: Floats, along: Floats, point: Floats) -> list[ForceAt]:
    """Return the root mean square pull of each tracked point, along the normal and in the cloth's plane."""
    found = []
    for k, tracked in enumerate(observer.recordings[0].garment.points):
        mine = point == k
        if mine.any():
            whole, normal = float((pull[mine] ** 2).sum(1).mean()), float((along[mine] ** 2).mean())
            found.append(
                ForceAt(
                    at_m=tracked.at_m, normal=float(np.sqrt(normal)), in_plane=float(np.sqrt(max(whole - normal, 0.0)))
                )
            )
    return found


def _pull(simulator: Simulator, material: Floats, amplitudes: Floats) -> tuple[Floats, ...]:
    """Return pull [m/s^2], normal, third of the height, odd and even features, speed powers and point, row by row."""
    done = simulator.run(material, amplitudes, observer_hz=FREQUENCY, shapes=True)
    recording, mesh = simulator.recording, simulator.mesh
    time = recording.time
    places = done.points[0]
    velocity = np.gradient(places, time, axis=0)
    acceleration = np.gradient(velocity, time, axis=0)
    wanted, trust = recording.targets(time)
    omega = 2 * np.pi * FREQUENCY
    pull = omega**2 * (wanted[..., :3] - places) + 2 * omega * (wanted[..., 3:] - velocity)
    assert done.shapes is not None
    shapes = done.shapes[0].astype(float).swapaxes(0, 1)
    normal = np.cross(mesh.points.apply(shapes, 1), mesh.points.apply(shapes, 2)).swapaxes(0, 1)
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
    height = np.array([p.at_m[1] for p in recording.garment.points])
    third = np.clip(3 * (height.max() - height) / max(np.ptp(height), 1e-9), 0, 2.999).astype(int)
    chosen: NDArray[Any] = recording.valid & (trust > 0) & recording.judged  # points on the held edge have no pull
    chosen[:3] = chosen[-3:] = False  # one-sided differences
    normal_speed = (velocity * normal).sum(2, keepdims=True)
    pressed = (acceleration * normal).sum(2, keepdims=True) * normal
    odd = np.stack([velocity, np.abs(normal_speed) * normal_speed * normal], 2)
    constant = np.broadcast_to(np.eye(3), (*velocity.shape[:2], 3, 3))
    even = np.concatenate([np.stack([acceleration, pressed], 2), constant], 2)
    powers = np.abs(normal_speed) ** EXPONENTS * np.sign(normal_speed)
    slow = [low_pass(time, values, LOW_PASS) for values in (pull, odd, even, powers)]
    pull, odd, even, powers = (values[chosen] for values in slow)
    point = np.broadcast_to(np.arange(chosen.shape[1]), chosen.shape)[chosen]
    return pull, normal[chosen], np.broadcast_to(third, chosen.shape)[chosen], odd, even, powers, point


def _joined(parts: list[Floats]) -> Floats:
    return np.concatenate(parts)


def _explained(target: Floats, features: Floats) -> float:
    """Return the share of a target's power, (n,) or (n, 3), that features, (n, k) or (n, k, 3), explain."""
    matrix = np.moveaxis(features, 1, -1).reshape(target.size, -1)
    solution, *_ = np.linalg.lstsq(matrix, target.ravel(), rcond=None)
    rest = target.ravel() - matrix @ solution
    return float(1 - (rest @ rest) / max(float(target.ravel() @ target.ravel()), 1e-12))


def sentence_of(
    normal: float, odd: float, even: float, exponent: float | None, shares: dict[str, float], *, power: float
) -> str:
    """Describe the force in words: share along the normal, parity in velocity, and location of its maximum.

    power [W/kg]: power of the force on the cloth
    """
    if odd + even < VISIBLE_FORCE:
        return (
            "The sensor's noise hides the missing force that the base fit left: "
            f"features of the motion explain {100 * (odd + even):.0f} % of the pull."
        )
    direction = (
        "mostly along"
        if normal > 0.6
        else "within the cloth and hardly along"
        if normal < WITHIN_CLOTH
        else "in all directions, also along"
    )
    with_velocity = "opposes motion" if power < 0 else "drives motion, which the base model damps too much"
    kind = with_velocity if odd > 2 * even else "acts like inertia or a constant load" if even > 2 * odd else "is mixed"
    growth = f" and grows with speed to the power {exponent:g}" if exponent is not None and odd > even else ""
    where = max(shares, key=lambda name: shares[name])
    return (
        f"The missing force acts {direction} the cloth's normal ({100 * normal:.0f} %). The force {kind}{growth}: "
        f"features that change sign with velocity explain {100 * odd:.0f} %, others {100 * even:.0f} %. "
        f"The force is strongest in the {where} third of the cloth ({100 * shares[where]:.0f} %)."
    )
