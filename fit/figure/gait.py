"""Procedural walk: positions of pelvis, legs and arms, from speed and height.

A leg's phase is 0 when its heel meets the ground and 0.5 when the other heel does. The foot stays on the ground until
0.62. It first turns on its heel, then lies flat, then turns on its ball. In its swing the ankle follows cubics that
leave and meet the ground with its own speed. The lengths of thigh and shank determine the knee. So no foot slides after
the start of the walk.

Step length over cadence is constant, W = 0.006 m min: a speed v [m/s] has steps of sqrt(60 v W). The pelvis goes
steadily. It rises twice a stride, and moves over the leg that stands. It turns with the leg that goes ahead, and drops
on the side of the leg that swings. All of these, and the arms' swing, shrink with the step. The figure stands first,
and its steps grow within STEPS_RAMP.

Sources:

- J. B. Saunders, V. T. Inman, H. D. Eberhart, "The major determinants in normal and pathological gait", J. Bone Joint
  Surg. 35-A (1953): turn of the pelvis 4 degrees to either side, drop 5 degrees, rise 46 mm and shift 44 mm in all
- R. Murakami, Y. Otaka, "Estimated lower speed boundary at which the walk ratio constancy is broken in healthy adults",
  J. Phys. Ther. Sci. 29 (2017): the constant ratio of step length and cadence
- D. A. Winter, "Biomechanics and Motor Control of Human Movement" (4th edition 2009), chapters 1 and 3: phases, and the
  foot's angles in round numbers
- M. P. Murray, S. B. Sepic, E. J. Barnard, "Patterns of sagittal rotation of the upper limbs in walking", Phys. Ther.
  47 (1967): arms swing by some 30 degrees, against the legs
"""

from __future__ import annotations

import numpy as np

from fit.errors import out_of_range
from fit.figure.skeleton import (
    ANKLE_HEIGHT,
    BALL,
    FOOT_RADIUS,
    FOREARM,
    HAND,
    HEAD,
    HEEL_BEHIND,
    HIP_OFFSET,
    NECK,
    SHANK,
    SHOULDER_OFFSET,
    SIDES,
    STANDARD_HEIGHT,
    THIGH,
    TRUNK,
    UPPER_ARM,
    SkeletonMotion,
    knee_between,
    unit,
)
from formats.arrays import Floats
from formats.meant_units import SPEED_UNITS

BETWEEN_INSTANTS = 2e-3  # s: between instants a body at 2 m/s changes its speed by centimetres a second
# m/s, between a stroll and the change to running. Our choice: round numbers. Other bounds were not tried.
SLOWEST_WALK, NORMAL_SPEED, FASTEST_WALK = 0.4, 1.2, 1.8
WALK_RATIO = 0.006  # m min, step length over steps a minute
STANCE = 0.62  # of a stride: stance of a foot
NORMAL_STEP = 0.75  # m, of a man's normal walk, at which the pelvis moves as its source says
RISE, SHIFT = 0.046 / 2, 0.044 / 2  # m to either side
TURN, DROP = np.radians(4.0), np.radians(5.0)  # rad to either side
ARM, ARM_BACK, ELBOW = np.radians(16.0), np.radians(6.0), np.radians(20.0)  # rad: swing to either side, mean, bend
ARM_OUT = np.radians(12.0)  # rad to the side, past the skirt
LOWERED = 0.38  # of the arms' initial angle: sleeves that lie flat with arms raised fold under lowered ones
# Phase, and upward pitch of the toe [rad].
FOOT_PHASE = np.array([0.0, 0.10, 0.36, 0.45, 0.52, 0.62, 0.68, 0.84, 0.94, 1.0])
# rad, Winter 2009, in round numbers
FOOT_PITCH = np.radians([18.0, 0.0, 0.0, -6.0, -18.0, -52.0, -55.0, -4.0, 18.0, 18.0])
# Of a stride, standard deviation of the smoothing of a piecewise motion. Our choice: instants of `FOOT_PHASE` are four
# deviations apart at least. At twice two, which blurs one into the next; half was not tried.
SMOOTHED = 0.015
FOOT_OUT = 0.8  # times the hips' offset: distance of the ankles from the middle
CLEARED = 0.03  # m: lift of a foot in its swing, in addition to the lift by its rotation
LONGEST_LEG = 0.999  # of thigh and shank: largest length of a leg, as no knee is fully straight
STEPS_RAMP = 1.6  # s; our choice: about three steps, half and double were not tried


def step_length(speed: float) -> float:
    """Return the length of a step [m] at a speed [m/s]."""
    return float(np.sqrt(60 * speed * WALK_RATIO))


def check_speed(speed: float) -> None:
    """Refuse a speed [m/s] outside the range of walking.

    Raises:
        FitError: it is one.
    """
    if not SLOWEST_WALK <= speed <= FASTEST_WALK:
        raise out_of_range(
            speed, SLOWEST_WALK, FASTEST_WALK, f"nobody walks at {speed:g} m/s", where="--speed", unit="m/s",
            units=SPEED_UNITS,
        )  # fmt: skip


def walk(
    seconds: float, speed: float = NORMAL_SPEED, height: float = STANDARD_HEIGHT, arms_out: float = ARM_OUT
) -> SkeletonMotion:
    """Return a figure of a height [m] that stands, and then walks towards -y at a speed [m/s].

    arms_out [rad]: initial angle of the arms from the vertical, which shrinks as the steps grow

    Raises:
        FitError: nobody walks at such a speed.
    """
    check_speed(speed)
    time: Floats = np.asarray(np.arange(int(np.ceil(seconds / BETWEEN_INSTANTS)) + 2) * BETWEEN_INSTANTS, float)
    step = step_length(speed)
    share = np.clip(time / STEPS_RAMP, 0.0, 1.0)
    share = np.asarray(share**3 * (10 - 15 * share + 6 * share**2))
    phase = {"left": time * speed / (2 * step), "right": time * speed / (2 * step) + 0.5}
    ahead = np.concatenate([[0.0], np.cumsum(speed * 0.5 * (share[1:] + share[:-1]) * BETWEEN_INSTANTS)])
    size = share * step / NORMAL_STEP
    gone = 2 * np.pi * phase["left"]
    pelvis = _turned(size * TURN * np.cos(gone), size * DROP * np.cos(gone - 2 * np.pi * 0.2))
    # The pelvis is above the standing leg, and highest, in the middle of its stance, at 0.3 of its stride.
    sideways = size * SHIFT * np.cos(gone - 2 * np.pi * 0.3)
    rise = size**2 * RISE * np.cos(2 * (gone - 2 * np.pi * 0.3))
    feet = {side: _foot(phase[side], step, height) for side in SIDES}
    standing = height * (ANKLE_HEIGHT + LONGEST_LEG * (THIGH + SHANK))
    walking = _highest(phase, step, height)
    middle = np.stack([sideways, -ahead, (1 - share) * standing + share * walking + rise], 1)
    joints = {"pelvis": middle}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        ankle, pitch = feet[side]
        hip = middle + sign * height * HIP_OFFSET * pelvis[:, 0]
        ankle = np.stack(
            [np.full(len(time), sign * FOOT_OUT * height * HIP_OFFSET), -ahead - share * ankle[:, 0],
             height * ANKLE_HEIGHT + share * (ankle[:, 1] - height * ANKLE_HEIGHT)], 1
        )  # fmt: skip
        knee = knee_between(hip, ankle, -pelvis[:, 1], height * THIGH, height * SHANK)
        # A leg that is too short to reach its foot pulls the foot along.
        ankle = knee + height * SHANK * unit(ankle - knee)
        tilt = share * pitch - np.arctan2(ANKLE_HEIGHT - FOOT_RADIUS, BALL)
        far = height * np.hypot(ANKLE_HEIGHT - FOOT_RADIUS, BALL)
        toe = ankle + far * np.stack([0 * tilt, -np.cos(tilt), np.sin(tilt)], 1)
        joints |= {f"{side}_hip": hip, f"{side}_knee": knee, f"{side}_ankle": ankle, f"{side}_toe": toe}
    down = max(ARM_OUT, LOWERED * arms_out)
    out = down + (1 - share) * (arms_out - down)
    joints |= _upper(middle, size, gone, height, out)
    return SkeletonMotion(BETWEEN_INSTANTS, height, joints, pelvis)


def _turned(turn: Floats, drop: Floats) -> Floats:
    """Return axes, (n, 3, 3), after a rotation about the vertical [rad] and a drop of one side [rad]."""
    zero = 0 * turn
    left = np.stack([np.cos(drop) * np.cos(turn), -np.cos(drop) * np.sin(turn), np.sin(drop)], 1)
    back = np.stack([np.sin(turn), np.cos(turn), zero], 1)
    return np.stack([left, back, np.cross(left, back)], 1)


def _foot(phase: Floats, step: float, height: float) -> tuple[Floats, Floats]:
    """Return the ankle ahead of the pelvis and above the ground [m], (n, 2), and the foot's pitch [rad]."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator
    from scipy.ndimage import gaussian_filter1d

    pitches = PchipInterpolator(FOOT_PHASE, FOOT_PITCH)
    stride = 2 * step

    def on_ground(at: Floats) -> Floats:
        """Return the ankle of a foot on the ground, relative to the pelvis at phase 0."""
        pitch = pitches(at)
        pivot = np.where(pitch > 0, -HEEL_BEHIND, BALL) * height
        high = (ANKLE_HEIGHT - FOOT_RADIUS) * height
        ahead = step / 2 + pivot - pivot * np.cos(pitch) - high * np.sin(pitch)
        return np.stack([ahead, FOOT_RADIUS * height + high * np.cos(pitch) - pivot * np.sin(pitch)], -1)

    small = 1e-4
    places = on_ground(np.array([STANCE - small, STANCE, 0.0, small]))
    ends = np.stack([places[1], places[2] + [stride, 0.0]])
    speeds = np.stack([places[1] - places[0], places[3] - places[2]]) / small
    swing = CubicHermiteSpline(np.array([STANCE, 1.0]), ends, speeds)
    at = np.linspace(0, 1, 513)
    part = np.clip((at - STANCE) / (1 - STANCE), 0, 1)
    lifted = np.stack([0 * part, CLEARED * 16 * part**2 * (1 - part) ** 2], -1)
    where = np.where((at < STANCE)[:, None], on_ground(at), swing(np.maximum(at, STANCE)) + lifted)
    where[:, 0] -= stride * at
    every = np.column_stack([where, pitches(at)])
    every[:-1] = gaussian_filter1d(every[:-1], SMOOTHED * (len(at) - 1), axis=0, mode="wrap")
    every[-1] = every[0]
    found = CubicSpline(at, every, bc_type="periodic")(phase - np.floor(phase))
    return found[:, :2], found[:, 2]


def _highest(phase: dict[str, Floats], step: float, height: float) -> float:
    """Return the largest mean height of the pelvis [m] at which the legs always reach the ground."""
    one = np.linspace(0, 1, 401)
    size = step / NORMAL_STEP
    ankle, _ = _foot(one, step, height)
    rise = size**2 * RISE * np.cos(4 * np.pi * (one - 0.3))
    drop = size * DROP * np.cos(2 * np.pi * (one - 0.2)) * height * HIP_OFFSET
    reach = LONGEST_LEG * height * (THIGH + SHANK)
    aside = (1 - FOOT_OUT) * height * HIP_OFFSET + size * SHIFT
    high = ankle[:, 1] + np.sqrt(np.maximum(reach**2 - ankle[:, 0] ** 2 - aside**2, 0.0))
    return float((high - rise - drop)[one <= STANCE].min())


def _upper(middle: Floats, size: Floats, gone: Floats, height: float, aside: Floats) -> dict[str, Floats]:
    """Return chest, neck, head and arms: the shoulders turn against the pelvis, and the arms against the legs.

    aside [rad], (instants,): angle of the arms from the vertical
    """
    trunk = _turned(-size * TURN * np.cos(gone), 0 * gone)
    up = np.array([0.0, 0.0, 1.0])
    steady = middle * [0.6, 1.0, 1.0]
    chest = steady + height * TRUNK * up
    joints = {"chest": chest, "neck": chest + height * NECK * up, "head": chest + height * (NECK + HEAD) * up}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        shoulder = chest + sign * height * SHOULDER_OFFSET * trunk[:, 0]
        swing = -sign * size * ARM * np.cos(gone) - ARM_BACK * size
        bend = swing + ELBOW

        def hanging(angle: Floats, out: Floats) -> Floats:
            return np.stack([np.sin(out), -np.sin(angle) * np.cos(out), -np.cos(angle) * np.cos(out)], 1)

        # Lowered arms have forearms and hands that hang nearer to the body.
        nearer = np.minimum(np.abs(aside) / ARM_OUT - 1, 1.0)
        elbow = shoulder + height * UPPER_ARM * hanging(swing, sign * aside)
        wrist = elbow + height * FOREARM * hanging(bend, sign * aside * (0.6 + 0.4 * nearer))
        finger = wrist + height * HAND * hanging(bend, sign * aside * (0.2 + 0.8 * nearer))
        joints |= {
            f"{side}_shoulder": shoulder, f"{side}_elbow": elbow, f"{side}_wrist": wrist, f"{side}_finger": finger
        }  # fmt: skip
    return joints


def standing(height: float, arms_out: float = ARM_OUT) -> dict[str, Floats]:
    """Return the joints of a standing figure [m], (3,) each; arms_out [rad]: angle of its arms from the vertical."""
    motion = walk(BETWEEN_INSTANTS, NORMAL_SPEED, height, arms_out)
    return {name: places[0] for name, places in motion.joints.items()}
