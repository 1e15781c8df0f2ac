"""New motions of a hanger, to show a fitted garment in a motion that was not recorded.

A motion of one kind (`formats.motion`) is A s(t) sin(2 pi f t). The kinds are along the held edge, through the cloth,
up and down, and a rotation about the vertical. `mixed` has all four at different rates. s(t) rises within
RISE_TIME. It falls within RISE_TIME and then rests for LAST_REST. It is 10 u^3 - 15 u^4 + 6 u^5, whose speed and
acceleration vanish at both ends.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fit.errors import out_of_range, unknown_name
from fit.export.fabric import Fabric
from fit.recordings.recording import Recording, prepare
from formats.arrays import Floats
from formats.garment import Garment
from formats.meant_units import TIME_UNITS
from formats.rig import Rig
from formats.swatch import swatch
from formats.take import Take

NEW_MOTIONS = ("sideways", "face-on", "up-and-down", "twist", "mixed")
# s. Our choice: a ramp lasts half a swing at 0.9 Hz, and a second of rest shows how the motion decays. Half and double
# were not tried.
RISE_TIME, LAST_REST = 0.6, 1.0
# s. Our choice: at 2 s the rise, until 0.6 s, meets the fall, from 0.4 s; a minute bounds time and memory.
SHORTEST_MOTION, LONGEST_MOTION = 2.0, 60.0
AMPLITUDE = {"sideways": 0.10, "face-on": 0.10, "up-and-down": 0.05}  # m, swings of a hand
# of a twist. Our choice: a wrist's comfortable turn to either side. Half and double were not tried.
TWIST_TURN = np.radians(40.0)
RATES = {"sideways": 0.9, "face-on": 0.8, "up-and-down": 1.3, "twist": 0.7}  # 1/s
MOTION_FPS = 30.0  # frames a second of a new motion; our choice: as the sensors' 30
HUNG_SIDE = 0.4  # m: side of a swatch without a take


def displaced(ends: Floats, way: str, instants: Floats, seconds: float) -> Floats:
    """Return the held ends [m], (n, 6), at instants [s] of a motion that starts from `ends`, (2, 3)."""
    ways = NEW_MOTIONS[:4] if way == "mixed" else (way,)
    share = 0.6 if way == "mixed" else 1.0
    middle, half = ends.mean(0), 0.5 * (ends[1] - ends[0])
    along = half * np.array([1.0, 1.0, 0.0])
    along = along / np.linalg.norm(along)
    axes = {"sideways": along, "face-on": np.cross([0.0, 0.0, 1.0], along), "up-and-down": np.array([0.0, 0.0, 1.0])}
    size = _smooth(instants / RISE_TIME) * _smooth((seconds - LAST_REST - instants) / RISE_TIME)
    shift, turn = np.zeros((len(instants), 3)), np.zeros(len(instants))
    for one in ways:
        wave = share * size * np.sin(2 * np.pi * RATES[one] * instants)
        if one == "twist":
            turn += TWIST_TURN * wave
        else:
            shift += AMPLITUDE[one] * wave[:, None] * axes[one]
    cos, sin = np.cos(turn), np.sin(turn)
    turned = np.stack([cos * half[0] - sin * half[1], sin * half[0] + cos * half[1], np.full(len(turn), half[2])], 1)
    centre = middle + shift
    return np.concatenate([centre - turned, centre + turned], 1)


def _smooth(share: Floats) -> Floats:
    u = np.clip(share, 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def check_motion(way: str, seconds: float) -> None:
    """Refuse an unknown kind of motion, or a length that cannot be simulated in reasonable time.

    Raises:
        FitError: kind or length is refused.
    """
    if way not in NEW_MOTIONS:
        raise unknown_name("motion", way, NEW_MOTIONS, where="--motion", listed="known")
    if not SHORTEST_MOTION <= seconds <= LONGEST_MOTION:
        raise out_of_range(
            seconds, SHORTEST_MOTION, LONGEST_MOTION, f"{seconds:g} s is no length for a motion", where="--seconds",
            unit="s", units=TIME_UNITS,
        )  # fmt: skip


def new_motion(recording: Recording, way: str, seconds: float) -> Recording:
    """Return a recording of the same garment on a hanger with a new motion, without tracked points.

    Raises:
        FitError: an unknown kind of motion, or a length that cannot be simulated in reasonable time.
    """
    check_motion(way, seconds)
    ends = recording.held(np.zeros(1)).reshape(2, 3)
    time = np.arange(round(seconds * MOTION_FPS) + 1) / MOTION_FPS
    count = recording.points.shape[1]
    return replace(
        recording, time=time, held=lambda instants: displaced(ends, way, instants, seconds),
        held_seen=displaced(ends, way, time, seconds), points=np.full((len(time), count, 3), np.nan),
        valid=np.zeros((len(time), count), bool),
        edge_turn=lambda instants: np.zeros((len(instants), 2)), windows=None,
    )  # fmt: skip


def hung_swatch(fabric: Fabric) -> Recording:
    """Return a recording of a swatch of the fabric at rest, held at its top corners."""
    garment = swatch(fabric["areal_density"].value * HUNG_SIDE**2, side=HUNG_SIDE, markers=5)
    # The corners are 8 % nearer to each other, as in hands, because cloth under a straight edge hardly folds.
    return hung_still(garment, "swatch", 0.92)


def hung_still(garment: Garment, name: str, wide: float = 1.0) -> Recording:
    """Return a recording of a garment at rest, held at its held edge; wide: distance of the ends over its length."""
    time = np.arange(0, 1, 1 / MOTION_FPS)
    top = garment.outline_m[:2]
    held = np.tile([[wide * top[0][0], 0.0, 0.0], [wide * top[1][0], 0.0, 0.0]], (len(time), 1, 1))
    points = np.tile([[wide * p.at_m[0], 0.0, p.at_m[1]] for p in garment.points], (len(time), 1, 1))
    frames, count = len(time), len(garment.points)
    take = Take(
        take_id=name, created="", rig=Rig(format="hangtime-rig/1", name="none", gravity=(0.0, 0.0, -1.0)),
        garment=garment, time=time, held=held, held_valid=np.ones((frames, 2), bool),
        held_sd=np.full((frames, 2, 3), 1e-4), points=points, points_valid=np.ones((frames, count), bool),
        points_sd=np.full((frames, count, 3), 1e-3), state=np.zeros(frames, np.uint16), markers=held,
    )  # fmt: skip
    return prepare(take)
