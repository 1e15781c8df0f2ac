"""Import of a figure's motion from a BVH file, the format of motion capture and animation programs.

The file's hierarchy gives every joint an offset from its parent. Every frame gives angles about named axes, and
positions. A joint's rotations follow the order of its channels: R = R_1 R_2 R_3, each about its own axis. Lengths are
scaled so that thighs and shanks are a figure's. The lower toe is on the floor, and the figure faces -y at first.

A figure begins standing, so that a skirt can hang round it. It takes up the file's motion within LEAD.

Source: M. Meredith, S. Maddock, "Motion Capture File Formats Explained" (2001), section 3.1.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fit.errors import FitError
from fit.figure.gait import ARM_OUT, BETWEEN_INSTANTS, standing
from fit.figure.skeleton import FOOT_RADIUS, SHANK, SIDES, THIGH, SkeletonMotion, unit
from formats.arrays import Floats
from formats.plain_text import encoding_of
from formats.system_causes import step_to_read
from formats.whole_files import check_ends

LEAD = 2.0  # s; our choice: hardly more than the `STEPS_RAMP` of a walk, half and double were not tried
ON_FLOOR = 0.2  # share of the frames in which the lower foot may be below the floor, because captured feet tremble
LARGEST_BVH = 50_000_000  # bytes; our choice: 9 minutes of 150 channels at 60 frames a second, ten letters a number
SHORTEST_STEP, LONGEST_STEP = 1e-3, 0.2  # s between frames: 5 to 1000 a second
LARGEST_IN_BVH = 1e7  # ten kilometres in millimetres; no walk turns 28,000 times
FASTEST_JOINT = 60.0  # m/s: a golfer's or pitcher's hand reaches 25 to 45
SHORTEST_ANIMATION = 1.0  # s; our choice: about a stride, half and double were not tried
MOST_JOINTS = 1000  # our choice: a file with more is no skeleton of a person
MOST_CHANNELS = 6  # three positions and three angles
CHANNEL = re.compile("[XYZ](position|rotation)", re.IGNORECASE)
# Names of joints, without sides, prefixes and signs; the first name that a file contains is used.
JOINT_NAMES = {
    "hip": ("upleg", "thigh", "hip", "upperleg", "femur"),
    "knee": ("leg", "lowerleg", "lowleg", "shin", "knee", "calf", "tibia"),
    "ankle": ("foot", "ankle"),
    "toe": ("toebase", "toe", "toes"),
    "shoulder": ("arm", "upperarm", "uparm", "shldr", "humerus", "shoulder"),
    "elbow": ("forearm", "lowerarm", "lowarm", "elbow", "radius"),
    "wrist": ("hand", "wrist"),
}
SUGGESTED = {
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand",
}  # fmt: skip
BONES = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
JOINTS_NEEDED = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")


@dataclass
class _Joint:
    name: str
    parent: int
    offset: Floats
    channels: list[str] = field(default_factory=list)


def read_bvh(path: Path, height: float, seconds: float | None = None, arms_out: float = ARM_OUT) -> SkeletonMotion:
    """Return the motion of a BVH file for a figure of a height [m], up to a length [s] or its end.

    arms_out [rad]: initial angle of the arms from the vertical

    Raises:
        FitError: no BVH file, or one without a person's legs and arms.
    """
    joints, times, places = _places(path)
    index = _named(path, joints)
    if times[-1] < SHORTEST_ANIMATION:
        raise FitError(
            f"lasts {times[-1]:.2f} s; at least {SHORTEST_ANIMATION:g} s are needed", where=path,
            advice="give a longer motion",
        )  # fmt: skip
    last = min(times[-1], seconds - LEAD / 2) if seconds is not None else times[-1]
    found = {name: places[:, k] for name, k in index.items()}
    for side in SIDES:
        for end, before in (("toe", "ankle"), ("finger", "wrist")):
            if f"{side}_{end}" not in found:
                found[f"{side}_{end}"] = _end_of(joints, places, index[f"{side}_{before}"])
    _check_bones(path, found)
    found = _upright(found, height)
    _check_speeds(path, found, float(times[1] - times[0]))
    return _led_in(found, times, float(last), height, arms_out)


def _places(path: Path) -> tuple[list[_Joint], Floats, Floats]:
    """Return the joints of a file, its times [s], and the joints' positions in its units, (frames, joints, 3)."""
    try:
        check_ends(path)
        if path.stat().st_size > LARGEST_BVH:
            raise FitError("the file is too large for a BVH file", where=path, advice="give a shorter motion")
        raw = path.read_bytes()
        text = raw.decode(encoding_of(raw[:4]), errors="replace")
    except OSError as error:
        raise FitError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    head, _, tail = text.partition("MOTION")
    joints = _hierarchy(path, head.split())
    found = re.match(r"\s*Frames:\s*(\d{1,9})\s*Frame Time:\s*(\S+)\s*(.*)", tail, re.DOTALL)
    width = sum(len(j.channels) for j in joints)
    if not joints or found is None:
        raise FitError("is no BVH file", where=path, advice="export the motion as BVH, with HIERARCHY and MOTION")
    try:
        frames, step = int(found[1]), float(found[2])
        numbers = np.array(found[3].split(), float)
    except ValueError:
        raise FitError("holds something else than numbers after MOTION", where=path, advice="export it again") from None
    if frames < 2 or len(numbers) != frames * width or not np.isfinite(numbers).all():
        raise FitError(
            f"says {frames} frames of {width} numbers, {step:g} s apart, and holds {len(numbers)} numbers", where=path,
            advice="export it again",
        )  # fmt: skip
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        raise FitError(
            f"says that its frames are {step:g} s apart, as no camera or program makes them", where=path,
            advice="write its Frame Time in seconds, as in 0.0333333",
        )  # fmt: skip
    wild = np.flatnonzero(np.abs(numbers) > LARGEST_IN_BVH)
    if len(wild):
        raise FitError(
            f"holds {numbers[wild[0]]:g} in frame {wild[0] // width}, which is no place and no angle", where=path,
            advice="mend that frame, or export it again",
        )  # fmt: skip
    return joints, np.asarray(np.arange(frames) * step, float), _forward(joints, numbers.reshape(frames, width))


def _hierarchy(path: Path, words: list[str]) -> list[_Joint]:
    joints: list[_Joint] = []
    open_: list[int] = []
    at = 0
    try:
        while at < len(words):
            word = words[at]
            if word in ("ROOT", "JOINT", "End"):
                joints.append(_Joint(words[at + 1], open_[-1] if open_ else -1, np.zeros(3)))
                at += 2
            elif word == "{":
                open_.append(len(joints) - 1)
                at += 1
            elif word == "}":
                open_.pop()
                at += 1
            elif word == "OFFSET":
                joints[open_[-1]].offset = np.array([float(w) for w in words[at + 1 : at + 4]])
                if joints[open_[-1]].offset.shape != (3,) or not np.isfinite(joints[open_[-1]].offset).all():
                    raise ValueError
                at += 4
            elif word == "CHANNELS":
                count = int(words[at + 1])
                joints[open_[-1]].channels = words[at + 2 : at + 2 + count]
                if not 0 <= count <= MOST_CHANNELS or not all(map(CHANNEL.fullmatch, joints[open_[-1]].channels)):
                    raise ValueError
                at += 2 + count
            else:
                at += 1
            if len(joints) > MOST_JOINTS:
                raise FitError(f"has more than {MOST_JOINTS} joints", where=path, advice="export fewer joints")
    except (IndexError, ValueError) as error:
        raise FitError("has a damaged hierarchy", where=path, advice="export it again") from error
    return joints


def _forward(joints: list[_Joint], rows: Floats) -> Floats:
    """Return the positions of all joints by forward kinematics, (frames, joints, 3)."""
    places, turns = np.zeros((len(rows), len(joints), 3)), np.zeros((len(rows), len(joints), 3, 3))
    at = 0
    for k, joint in enumerate(joints):
        offset, turn = np.tile(joint.offset, (len(rows), 1)), np.tile(np.eye(3), (len(rows), 1, 1))
        moved = False
        for channel in joint.channels:
            axis = "XYZ".find(channel[:1].upper())
            values = rows[:, at]
            at += 1
            if channel[1:].lower() == "position":
                if not moved:
                    offset, moved = np.zeros_like(offset), True
                offset[:, axis] = values
            elif channel[1:].lower() == "rotation":
                turn = turn @ _about(axis, np.radians(values))
        if joint.parent < 0:
            places[:, k], turns[:, k] = offset, turn
        else:
            above = turns[:, joint.parent]
            places[:, k] = places[:, joint.parent] + np.einsum("nij,nj->ni", above, offset)
            turns[:, k] = above @ turn
    return places


def _about(axis: int, angle: Floats) -> Floats:
    """Return rotations about one axis, (n, 3, 3)."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    turn = np.zeros((len(angle), 3, 3))
    turn[:, axis, axis] = 1.0
    turn[:, one, one] = turn[:, two, two] = np.cos(angle)
    turn[:, one, two], turn[:, two, one] = -np.sin(angle), np.sin(angle)
    return turn


def _plain(name: str) -> str:
    """Return a joint's name in lower case without prefix, digits and signs."""
    return re.sub(r"[^a-z]", "", name.rsplit(":", 1)[-1].lower())


def _named(path: Path, joints: list[_Joint]) -> dict[str, int]:
    """Return the file's joint for each joint of our skeleton."""
    plain = [_plain(j.name) for j in joints]
    index = {"pelvis": 0}
    for side in SIDES:
        for part, names in JOINT_NAMES.items():
            wanted = [w for n in names for w in (f"{side}{n}", f"{side[0]}{n}", f"{n}{side}", f"{n}{side[0]}")]
            match = next((plain.index(w) for w in wanted if w in plain), None)
            if match is not None:
                index[f"{side}_{part}"] = match
            elif part in JOINTS_NEEDED:
                raise FitError(
                    f"has no joint that is a {side} {part}", where=path,
                    advice=f"name it {side.capitalize()}{SUGGESTED[part]}; the file has {', '.join(_few(joints))}",
                )  # fmt: skip
    for ours, names in (("neck", ("neck",)), ("head", ("head",))):
        match = next((plain.index(n) for n in names if n in plain), None)
        if match is not None:
            index[ours] = match
    return index


def _few(joints: list[_Joint]) -> list[str]:
    names = [j.name for j in joints if j.name != "Site"]
    return [*names[:12], *(["..."] if len(names) > 12 else [])]


def _end_of(joints: list[_Joint], places: Floats, joint: int) -> Floats:
    """Return the positions of a joint's first child, or of an extrapolated end if there is none."""
    child = next((k for k, j in enumerate(joints) if j.parent == joint and np.linalg.norm(j.offset) > 0), None)
    if child is not None:
        return places[:, child]
    return places[:, joint] + 0.4 * (places[:, joint] - places[:, joints[joint].parent])


def _check_bones(path: Path, found: dict[str, Floats]) -> None:
    """Refuse a figure with a limb of zero length or hips of zero width, which no scaling corrects.

    Raises:
        FitError: two joints of a limb, or the two hips, coincide, or their distance is not finite.
    """
    bones = [(f"{s}_{a}", f"{s}_{b}") for s in SIDES for a, b in BONES] + [("left_hip", "right_hip")]
    for one, two in bones:
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.linalg.norm(found[one] - found[two], axis=1)
        if not np.isfinite(length).all() or not length.min() > 0:
            raise FitError(
                f"its {one.replace('_', ' ')} and {two.replace('_', ' ')} are not two places apart", where=path,
                advice="export it with the offsets of its joints",
            )  # fmt: skip


def _check_speeds(path: Path, found: dict[str, Floats], step: float) -> None:
    """Refuse a joint that jumps, which no cloth can follow; found: joint positions [m] at frames `step` [s] apart.

    Raises:
        FitError: a joint moves faster than any person can.
    """
    fastest = 0.0, "", 0
    for name, places in found.items():
        speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / step
        fastest = max(fastest, (float(speeds.max()), name, int(speeds.argmax()) + 1))
    speed, name, frame = fastest
    if speed > FASTEST_JOINT:
        raise FitError(
            f"its {name.replace('_', ' ')} leaps by {speed * step:.3g} m from frame {frame - 1} to frame {frame}",
            where=path, advice="mend these frames, cut the file there, or export it again",
        )  # fmt: skip


def _upright(found: dict[str, Floats], height: float) -> dict[str, Floats]:
    """Return joints in metres, z up, on the floor, at the origin and facing -y in the first frame."""
    leg = np.mean([
        np.linalg.norm(found[f"{s}_{a}"] - found[f"{s}_{b}"], axis=1).mean()
        for s in SIDES for a, b in (("hip", "knee"), ("knee", "ankle"))
    ])  # fmt: skip
    shoulders = (found["left_shoulder"] + found["right_shoulder"]) / 2
    ankles = (found["left_ankle"] + found["right_ankle"]) / 2
    rise = (shoulders - ankles).mean(0)
    axis = int(np.argmax(np.abs(rise)))
    up = np.sign(rise[axis]) * np.eye(3)[axis]
    across = (found["left_hip"] - found["right_hip"])[0]
    left = unit(across - (across @ up) * up)
    turn = np.stack([left, np.cross(up, left), up])
    scale = height * (THIGH + SHANK) / 2 / leg
    turned = {name: scale * (places @ turn.T) for name, places in found.items()}
    feet = np.min([turned[f"{s}_{p}"][:, 2] for s in SIDES for p in ("ankle", "toe")], 0)
    low = float(np.quantile(feet, ON_FLOOR)) - FOOT_RADIUS * height
    origin = np.array([*turned["pelvis"][0, :2], low])
    turned = {name: places - origin for name, places in turned.items()}
    middle = (turned["left_hip"] + turned["right_hip"]) / 2
    chest = (turned["left_shoulder"] + turned["right_shoulder"]) / 2
    top = unit(chest - middle)
    neck = turned.get("neck", chest + 0.05 * height * top)
    neck = chest + np.maximum(((neck - chest) * top).sum(1, keepdims=True), 0.05 * height) * top
    head = turned.get("head", neck + 0.10 * height * top)
    return turned | {"pelvis": middle, "chest": chest, "neck": neck, "head": neck + 0.13 * height * unit(head - chest)}


def _led_in(found: dict[str, Floats], times: Floats, last: float, height: float, arms_out: float) -> SkeletonMotion:
    """Return the motion at even instants, with a lead from standing, up to `last` [s] of the file.

    arms_out: as in `read_bvh`"""
    from scipy.interpolate import CubicSpline

    clock = np.arange(int((last + LEAD / 2) / BETWEEN_INSTANTS) + 1) * BETWEEN_INSTANTS
    u = np.clip(clock / LEAD, 0, 1)
    share = u**3 * (10 - 15 * u + 6 * u**2)
    # The file's clock starts from rest: the integral of the share, LEAD / 2 late in the end.
    at = np.where(u < 1, LEAD * (2.5 * u**4 - 3 * u**5 + u**6), clock - LEAD / 2)
    at = np.minimum(at, times[-1])
    still = standing(height, arms_out)
    moving = {name: CubicSpline(times, places)(at) for name, places in found.items()}
    floor = moving["pelvis"] * [1.0, 1.0, 0.0]
    left = unit((moving["left_hip"] - moving["right_hip"]) * [1.0, 1.0, 0.0])
    turn = np.stack([left, np.cross([0.0, 0.0, 1.0], left), np.tile([0.0, 0.0, 1.0], (len(clock), 1))], 1)
    joints = {}
    for name, places in moving.items():
        stood = floor + np.einsum("k,nkx->nx", still[name], turn)
        joints[name] = (1 - share)[:, None] * stood + share[:, None] * places
    side = unit(joints["left_hip"] - joints["right_hip"])
    up = joints["chest"] - joints["pelvis"]
    up = unit(up - (up * side).sum(1, keepdims=True) * side)
    return SkeletonMotion(BETWEEN_INSTANTS, height, joints, np.stack([side, np.cross(up, side), up], 1))
