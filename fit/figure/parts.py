"""Body of a figure: rounded boxes and tapering capsules between its joints, sized to fit its garment.

Hips and thighs fill a cross-section of two half circles of radius r and two straight sides of 2 a. Its girth is G = 4 a
+ 2 pi r. The skirt's band is this curve, with the half width a + r and the depth r in the ratio DEPTH. The hips fill
the band except for the cloth's clearance. Further down the skirt widens, and hips and thighs widen by SHARE of it.
Other widths are shares of the height, and those of the legs follow the thighs.

In a T-shirt the hips are those of a figure in a plain skirt. Arms are as thick as the sleeves allow.

Source: A. R. Tilley, Henry Dreyfuss Associates, "The Measure of Man and Woman" (2002): widths in round numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.errors import FitError
from fit.figure import collar as neckline
from fit.figure.dressmaking import girth, usual_skirt
from fit.figure.shirt import chest_at, collar_girth, cuff_girth
from fit.figure.skeleton import FOOT_RADIUS, HEEL_BEHIND, SIDES, SkeletonMotion, unit
from fit.recordings.bodies import Body, BodyMotion
from formats.arrays import Floats
from formats.garment import Garment

BAND = 0.05  # of the height, above the hips' joints: where the skirt's band sits
DEPTH = 0.58  # of half of the width, at the band
SHARE = 0.6  # of the skirt's flare: flare of the hips
CLEARANCE = 0.004  # m between body and cloth; our choice: twice the distance of layers, half and double were not tried
THIGH_RADIUS, KNEE_RADIUS, CALF_RADIUS, ANKLE_RADIUS = 0.050, 0.033, 0.032, 0.021  # of the height, Tilley 2002
THINNEST, WIDEST_FIGURE = 0.6, 1.5  # times the usual thigh: range of widths of a plausible figure
WAIST, CHEST = 0.92, 1.12  # times the radius at the band; our choice: by eye. Half and double are no figure
NECK_RADIUS, HEAD_RADIUS = 0.030, 0.047  # of the height, Tilley 2002
TRAPEZIUS_RADIUS, SLOPE_RADIUS = 0.020, 0.022  # of the height; our choice: a slope from neck to shoulders
SLOPE_HIGH, SLOPE_LOW = 0.016, 0.008  # above and below the shoulders' joints: shoulders fall by 14 degrees
SHOULDER_RADIUS, ELBOW_RADIUS, WRIST_RADIUS, FINGER_RADIUS = 0.028, 0.022, 0.016, 0.012  # of the height, Tilley 2002
LEAST_EASE = 1.02  # times the chest's girth: least girth of a shirt
ELBOW_AT = 0.6  # of the upper arm's widths, counted from the shoulder, at a short sleeve's end
TOUCHING_PARTS = ("hips", *(f"{s}_{part}" for s in SIDES for part in ("thigh", "shank", "foot", "forearm", "hand")))
TOUCHING_SHIRTS = (
    "hips", "belly", "trunk", "shoulders", "neck",
    *(f"{s}_{part}" for s in SIDES for part in ("thigh", "shoulder", "upper_arm", "forearm", "hand")),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Figure:
    """A body in motion.

    - `names`, `bodies`: its parts in their poses at the first instant
    - `motion` of the parts
    - `band`: (n,) instants' centre of the skirt's band or the shirt's collar and its axes, as poses, (instants, 12)
    - `half_side` [m]: a of that curve
    - `touching`: names of the parts that the garment may touch
    """

    names: tuple[str, ...]
    bodies: tuple[Body, ...]
    motion: BodyMotion
    band: Floats
    half_side: float
    touching: tuple[str, ...] = TOUCHING_PARTS

    def only(self, names: tuple[str, ...]) -> tuple[tuple[Body, ...], BodyMotion]:
        """Return the figure with some of its parts only."""
        which = [self.names.index(name) for name in names]
        return tuple(self.bodies[k] for k in which), BodyMotion(self.motion.spacing, self.motion.poses[:, which])


def round_of(girths: Floats, half_side: float) -> Floats:
    """Return the radius r [m] of cross-sections of given girths [m]."""
    return np.asarray((girths - 4 * half_side) / (2 * np.pi))


def figure_in_shirt(garment: Garment, skeleton: SkeletonMotion) -> Figure:
    """Return a body on a skeleton, sized to fit into a sewn T-shirt.

    Raises:
        FitError: the T-shirt is too narrow for the neck, the chest or the arms of such a figure.
    """
    height, joints = skeleton.height, skeleton.joints
    usual = 2 * np.pi * height * (SHOULDER_RADIUS + ELBOW_AT * (ELBOW_RADIUS - SHOULDER_RADIUS))
    arms = min(1.0, (cuff_girth(garment) / LEAST_EASE - 2 * np.pi * CLEARANCE) / usual)
    figure = figure_in(usual_skirt(height), skeleton, arms)
    trunk = figure.bodies[figure.names.index("trunk")]
    chest = 4 * figure.half_side + 2 * np.pi * (trunk.radius + abs(trunk.taper) * trunk.half_size[2])
    there = float(girth(garment, np.array([chest_at(garment)]))[0])
    collar = collar_girth(garment)
    half_side = neckline.half_side(garment, NECK_RADIUS * height + neckline.APART)
    faults = [
        (f"a T-shirt {there:.2f} m round its chest", there < LEAST_EASE * chest + 2 * np.pi * CLEARANCE),
        (f"a T-shirt with sleeves {cuff_girth(garment):.2f} m round", arms < THINNEST),
        (f"a T-shirt {collar:.2f} m round its neck", half_side < 0),
    ]
    for what, is_narrow in faults:
        if is_narrow:
            raise FitError(
                f"{what} fits no figure {height:.2f} m tall", where=garment.name,
                advice="give a --height that goes with it, or leave out --take for a T-shirt of the fabric",
            )  # fmt: skip
    up = np.array([0.0, 0.0, 1.0])
    left = unit(joints["left_shoulder"] - joints["right_shoulder"])
    back = np.cos(neckline.TILT) * unit(np.cross(up, left)) + np.sin(neckline.TILT) * up
    axes = np.stack([left, back, np.cross(left, back)], 1)
    centre = joints["chest"] + neckline.COLLAR_HEIGHT * height * up
    band = np.concatenate([centre, axes.reshape(-1, 9)], 1)
    return replace(figure, band=band, half_side=half_side, touching=TOUCHING_SHIRTS)


def figure_in(garment: Garment, skeleton: SkeletonMotion, arms: float = 1.0) -> Figure:
    """Return a body on a skeleton, sized to fit into a sewn skirt; arms: times the usual thickness.

    Raises:
        FitError: the skirt fits no grown figure.
    """
    height, joints = skeleton.height, skeleton.joints
    band = BAND * height
    at_band, at_hips = girth(garment, np.array([0.0, band]))
    radius = at_band / (4 / DEPTH - 4 + 2 * np.pi)
    half_side = radius * (1 / DEPTH - 1)
    top = radius - CLEARANCE
    flare = max(float(round_of(at_hips, half_side)) - radius, 0.0)
    hips = top + SHARE * flare
    size = hips / (THIGH_RADIUS * height)
    if not THINNEST <= size <= WIDEST_FIGURE:
        raise FitError(
            f"a skirt {at_band:.2f} m round at its top fits no figure {height:.2f} m tall", where=garment.name,
            advice="give a --height that goes with it, or leave out --take for a skirt of the fabric",
        )  # fmt: skip
    axes = skeleton.pelvis
    pelvis = joints["pelvis"]
    up = axes[:, 2]
    parts: dict[str, tuple[Body, Floats]] = {}

    def boxed(name: str, low: Floats, high: Floats, half: float, radii: tuple[float, float], turn: Floats) -> None:
        way = high - low
        long = float(np.linalg.norm(way, axis=1).mean())
        third = unit(way)
        first = unit(turn - (turn * third).sum(1, keepdims=True) * third)
        parts[name] = _part((low + high) / 2, first, third, (half, 0.0, long / 2), radii)

    boxed("hips", pelvis, pelvis + band * up, half_side, (hips, top), axes[:, 0])
    waist, chest = pelvis + 0.11 * height * up, joints["chest"] - np.array([0, 0, 0.07 * height])
    boxed("belly", pelvis + band * up, waist, half_side, (top, WAIST * top), axes[:, 0])
    up_of_trunk = np.array([0.0, 0.0, 1.0])
    shoulders = joints["left_shoulder"] - joints["right_shoulder"]
    boxed("trunk", waist, chest, half_side, (WAIST * top, CHEST * top), shoulders)
    boxed("shoulders", joints["chest"] - [0, 0, 0.035 * height], joints["chest"] - [0, 0, 0.03 * height],
          0.075 * height, (0.04 * height, 0.04 * height), shoulders)  # fmt: skip
    boxed("neck", joints["chest"], joints["neck"] + [0, 0, 0.02 * height], 0.0, (NECK_RADIUS * height,) * 2, shoulders)
    face = joints["head"] - joints["neck"]
    boxed("head", joints["neck"] + 0.36 * face, joints["neck"] + 0.64 * face, 0.0,
          (0.92 * HEAD_RADIUS * height, HEAD_RADIUS * height), shoulders)  # fmt: skip
    for side in SIDES:
        hip, knee, ankle, toe, shoulder, elbow, wrist, finger = (
            joints[f"{side}_{part}"] for part in ("hip", "knee", "ankle", "toe", "shoulder", "elbow", "wrist", "finger")
        )
        across = axes[:, 0]
        # The thigh begins at the height where its cross-section equals that of the hips.
        sign = 1.0 if side == "left" else -1.0
        hip = pelvis + sign * half_side * axes[:, 0]
        boxed(f"{side}_thigh", hip, knee, 0.0, (hips, size * KNEE_RADIUS * height), across)
        calf, thin = size * CALF_RADIUS * height, min(size, 1.2) * ANKLE_RADIUS * height
        boxed(f"{side}_shank", knee, ankle, 0.0, (calf * 1.03, thin), across)
        heel = ankle - (HEEL_BEHIND - FOOT_RADIUS) * height * unit(toe - ankle)
        heel = heel + (toe - ankle) * 0.0 + _down(ankle, toe, 0.35 * FOOT_RADIUS * height)
        boxed(
            f"{side}_foot", heel, toe, 0.012 * height, (1.05 * FOOT_RADIUS * height, 0.7 * FOOT_RADIUS * height), across
        )
        slope = joints["chest"] + SLOPE_HIGH * height * up_of_trunk + sign * 0.025 * height * unit(shoulders)
        boxed(
            f"{side}_shoulder",
            slope,
            shoulder - SLOPE_LOW * height * up_of_trunk,
            0.0,
            (TRAPEZIUS_RADIUS * height, SLOPE_RADIUS * height),
            across,
        )
        boxed(f"{side}_upper_arm", shoulder - 0.03 * height * unit(shoulder - elbow), elbow, 0.0,
              (arms * SHOULDER_RADIUS * height, arms * ELBOW_RADIUS * height), across)  # fmt: skip
        boxed(f"{side}_forearm", elbow, wrist, 0.0, (arms * ELBOW_RADIUS * height, WRIST_RADIUS * height), across)
        boxed(f"{side}_hand", wrist, wrist + 0.7 * (finger - wrist), 0.0,
              (0.018 * height, FINGER_RADIUS * height), across)  # fmt: skip
    names = tuple(parts)
    poses = np.stack([pose for _, pose in parts.values()], 1)
    centre = pelvis + band * up
    return Figure(
        names, tuple(body for body, _ in parts.values()), BodyMotion(skeleton.spacing, poses),
        np.concatenate([centre, axes.reshape(-1, 9)], 1), float(half_side),
    )  # fmt: skip


def _down(ankle: Floats, toe: Floats, far: float) -> Floats:
    """Return the vector from an ankle to its sole [m], (n, 3), perpendicular to the foot."""
    ahead = unit(toe - ankle)
    level = np.array([0.0, 0.0, -1.0]) - (ahead @ np.array([0.0, 0.0, -1.0]))[:, None] * ahead
    return far * unit(level)


def _part(
    centre: Floats, first: Floats, third: Floats, half: tuple[float, float, float], radii: tuple[float, float]
) -> tuple[Body, Floats]:
    """Return a body with a linearly changing radius along its third axis, and its poses, (n, 12)."""
    axes = np.stack([first, np.cross(third, first), third], 1)
    poses = np.concatenate([centre, axes.reshape(len(centre), 9)], 1)
    body = Body(
        centre=tuple(centre[0].tolist()), axes=tuple(tuple(a) for a in axes[0].tolist()), half_size=half,
        radius=(radii[0] + radii[1]) / 2, taper=(radii[1] - radii[0]) / (2 * half[2]),
    )  # fmt: skip
    return body, poses
