"""Detect the hanger's two coloured dots in a whole image, without an initial position.

A dot is a region of one hue (CIE L*a*b*, chroma above `LEAST_CHROMA`). Its size is that of a disc of its diameter at
its depth. It is as wide as high, and fills its box as a disc does (pi / 4). Two dots are the hanger's if their distance
in space is the rig's. If several pairs qualify, none is chosen, and the user has to pick.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from formats.arrays import Booleans, Bytes, Floats, Unsigned
from formats.rig import Hanger, Sensor

LEAST_CHROMA = 22.0  # of L*a*b*: paper and skin in shade have less, stickers of a colour with a name have 40 and more
HUES = 12  # directions of hue; each takes in a sixth of the circle, so that no dot falls between two
AREAS = (0.55, 1.6)  # of the expected disc's area: blur at its edge, and the share of one hue
LONGEST_BOX = 1.7  # long over short side: blurred by less than its own size
# Of its bounding box. Our choice: a disc fills 0.79, and an aslant ellipse as long as `LONGEST_BOX` 0.69. A triangle
# fills 0.5 and an upright rectangle 1.
FILLS = (0.6, 0.98)
DOT_TOLERANCE = 0.08  # of the hanger's distance: depth at a small dot is accurate to a centimetre
# in a*b*, between a dot and its expected colour. Our choice: half and double find the dots of `test_colour_dots.py`
# as well.
LARGEST_COLOUR_DISTANCE = 28.0
# times better than the next pair. Our choice: two pairs as good within noise are left undecided. Half would decide
# each of them; double was not tried.
CLEARLY = 2.0


@dataclass(frozen=True)
class Dot:
    """A dot in an image: centre [px], (2,), diameter [px], colour RGB, (3,), 0 to 255."""

    centre: Floats
    diameter: float
    colour: Floats


@dataclass(frozen=True)
class _Candidate:
    dot: Dot
    place: Floats  # m, (3,), sensor frame
    tint: Floats  # a*, b*
    fault: float  # deviation from an ideal dot, 0 is perfect


def find_pair(
    colour: Bytes, depth: Unsigned, hanger: Hanger, sensor: Sensor, colours: list[Floats | None]
) -> tuple[Dot, Dot] | None:
    """Return the left and the right dot of a hanger, or None if no pair or several pairs qualify.

    colour RGB, (H, W, 3); depth [mm], (H, W); colours: of the left and of the right dot, if known
    """
    return _best_pair(_candidates(colour, depth, hanger, sensor), hanger.marker_distance_m, colours)


def _best_pair(
    candidates: list[_Candidate], distance: float, colours: list[Floats | None]
) -> tuple[Dot, Dot] | None:  # fmt: skip
    """Return the pair at a distance [m] with the least fault, or None if another is nearly as good."""
    wanted = [None if mark is None else _tint(mark) for mark in colours]
    pairs: list[tuple[float, Dot, Dot]] = []
    for i, one in enumerate(candidates):
        for other in candidates[i + 1 :]:
            left, right = (one, other) if one.dot.centre[0] <= other.dot.centre[0] else (other, one)
            tints = (left.tint, right.tint)
            if any(
                w is not None and np.linalg.norm(t - w) > LARGEST_COLOUR_DISTANCE
                for t, w in zip(tints, wanted, strict=True)
            ):
                continue
            apart = float(np.linalg.norm(right.place - left.place)) / distance - 1.0
            if abs(apart) <= DOT_TOLERANCE:
                fault = left.fault + right.fault + abs(apart) / DOT_TOLERANCE
                pairs.append((fault, left.dot, right.dot))
    pairs.sort(key=lambda pair: pair[0])
    if not pairs or (len(pairs) > 1 and pairs[1][0] < CLEARLY * pairs[0][0]):
        return None
    return pairs[0][1], pairs[0][2]


def _candidates(colour: Bytes, depth: Unsigned, hanger: Hanger, sensor: Sensor) -> list[_Candidate]:
    lab = cv2.cvtColor(colour, cv2.COLOR_RGB2LAB)
    a, b = np.float32(lab[..., 1]) - 128.0, np.float32(lab[..., 2]) - 128.0
    chroma = np.hypot(a, b)
    found: list[_Candidate] = []
    for k in range(HUES):
        angle = 2.0 * np.pi * k / HUES
        along = a * np.float32(np.cos(angle)) + b * np.float32(np.sin(angle))
        mask = ((chroma > LEAST_CHROMA) & (along > chroma * np.float32(np.cos(np.pi / 6)))).astype(np.uint8)
        _, labels, stats, middles = cv2.connectedComponentsWithStats(mask, connectivity=8)
        for label in range(1, len(stats)):
            left, top, width, height, area = (int(value) for value in stats[label])
            if area < 16 or max(width, height) > LONGEST_BOX * min(width, height):
                continue
            box = np.s_[top : top + height, left : left + width]
            inside = labels[box] == label
            candidate = _judge(inside, colour[box], depth[box], middles[label], hanger, sensor)
            if candidate is not None:
                found.append(candidate)
    return _best_of_each_place(found)


def _judge(
    inside: Booleans, colour: Bytes, depth: Unsigned, middle: Floats, hanger: Hanger,
    sensor: Sensor,
) -> _Candidate | None:  # fmt: skip
    measured = depth[inside & (depth > 0)]
    if measured.size < 0.3 * np.count_nonzero(inside):
        return None
    z = 1e-3 * float(np.median(measured))
    diameter = sensor.fx * hanger.marker_size_m / z
    area = np.count_nonzero(inside) / (0.25 * np.pi * diameter**2)
    fill = np.count_nonzero(inside) / inside.size
    if not (AREAS[0] <= area <= AREAS[1] and FILLS[0] <= fill <= FILLS[1]):
        return None
    mark = np.median(colour[inside], axis=0).astype(float)
    ray = np.array([(middle[0] - sensor.cx) / sensor.fx, (middle[1] - sensor.cy) / sensor.fy, 1.0])
    fault = abs(np.log(area)) + abs(fill - 0.25 * np.pi)
    return _Candidate(Dot(np.array(middle), diameter, mark), z * ray, _tint(mark), float(fault))


def _best_of_each_place(candidates: list[_Candidate]) -> list[_Candidate]:
    """Remove candidates that overlap a better one, because neighbouring hues detect the same dot."""
    kept: list[_Candidate] = []
    for candidate in sorted(candidates, key=lambda c: c.fault):
        if all(np.linalg.norm(candidate.dot.centre - k.dot.centre) > 0.5 * k.dot.diameter for k in kept):
            kept.append(candidate)
    return kept


def _tint(mark: Floats) -> Floats:
    """Return a* and b* of an RGB colour, (3,)."""
    pixel = np.clip(np.rint(mark), 0, 255).astype(np.uint8).reshape(1, 1, 3)
    return np.asarray(cv2.cvtColor(pixel, cv2.COLOR_RGB2LAB)[0, 0, 1:], float) - 128.0
