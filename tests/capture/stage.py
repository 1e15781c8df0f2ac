"""Rendered scenes for tests of the hanger: flat plates in front of a wall, seen by a depth camera with its faults.

World frame: x right, y down along gravity, z away, metres, origin in the camera. The camera may be rotated.
Colour is rendered at three times the size and averaged. Depth is exact for each pixel's ray, plus the camera's noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import cv2
import numpy as np

from firmware_host.depth_sensor import DepthSensor, SensorFrame, SensorInfo
from firmware_host.synthetic.depth_noise import spoil
from formats.rig import Sensor

CAMERA = Sensor(width=640, height=480, fx=575.8, fy=575.8, cx=319.5, cy=239.5)
FINE = 3  # samples a side, per pixel of colour
TEXEL = 12  # texture pixels per bit of a marker
WALL = 2.6  # m
LEVEL = np.eye(3)


@dataclass(frozen=True)
class Plate:
    """A rectangle square to its own z, centre [m], (3,), in the world, with a picture, (h, w, 3), or one colour."""

    at: np.ndarray
    size: tuple[float, float]
    picture: np.ndarray
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))

    def moved(self, by):
        return Plate(self.at + by, self.size, self.picture, self.rotation)


def marker_plate(number, at, size=0.06, dictionary="DICT_4X4_50", rotation=LEVEL):
    """A marker with a quiet zone of one bit: the plate is 8/6 of the marker for 4 x 4 bits."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    bits = known.markerSize + 2
    image = cv2.aruco.generateImageMarker(known, number, bits * TEXEL)
    image = cv2.copyMakeBorder(image, TEXEL, TEXEL, TEXEL, TEXEL, cv2.BORDER_CONSTANT, value=235)
    image = np.clip(image, 22, 235)
    side = size * (bits + 2) / bits
    return Plate(np.array(at, float), (side, side), np.repeat(image[..., None], 3, axis=2), rotation)


def dot_plate(at, diameter, colour, ground=(225, 222, 210), rotation=LEVEL):
    """A round dot in the middle of a square plate, one and a half times as wide."""
    picture = np.full((96, 96, 3), ground, np.uint8)
    cv2.circle(picture, (384 - 8, 384 - 8), 256, colour, cv2.FILLED, cv2.LINE_AA, shift=3)
    return Plate(np.array(at, float), (1.5 * diameter, 1.5 * diameter), picture, rotation)


def plain_plate(at, size, colour, rotation=LEVEL):
    return Plate(np.array(at, float), size, np.full((4, 4, 3), colour, np.uint8), rotation)


def camera_rotation(pitch, roll):
    """World to sensor for a camera that looks down by `pitch` and is rolled clockwise by `roll` [rad]."""
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    return np.array([[cr, sr, 0], [-sr, cr, 0], [0, 0, 1.0]]) @ np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])


@cache
def backdrop():
    """A wall with a faint pattern, (480, 640, 3), and each pixel's ray, (480, 640, 3)."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(float)
    wall = 128 + 14 * np.sin(u / 23.0) * np.sin(v / 31.0)
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], -1)
    return np.repeat(wall[..., None], 3, axis=2).astype(np.float32), rays


def covered_centres(quad, size):
    """Mark the pixels, (height, width), of an image of a size whose centres a convex quadrilateral, (4, 2), covers.

    `cv2.fillConvexPoly` also marks the pixels that the outline touches, half a pixel too far out.
    """
    v, u = np.mgrid[0 : size[1], 0 : size[0]]
    sides = [(x1 - x0) * (v - y0) >= (y1 - y0) * (u - x0)
             for (x0, y0), (x1, y1) in zip(quad, np.roll(quad, -1, axis=0), strict=True)]  # fmt: skip
    return (np.all(sides, axis=0) | ~np.any(sides, axis=0)).astype(np.float32)


def true_view(plates, turn=LEVEL):
    """True depth [m], (480, 640), and colour 0 to 255, (480, 640, 3), of plates before a wall."""
    height, width = CAMERA.height, CAMERA.width
    depth = np.full((height, width), WALL)
    wall, rays = backdrop()
    colour = wall.copy()
    for plate in sorted(plates, key=lambda p: -(turn @ p.at)[2]):
        at, rotation = turn @ plate.at, turn @ plate.rotation
        half = 0.5 * np.array([*plate.size, 0.0])
        corners = at + (np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half) @ rotation.T
        pixels = corners[:, :2] / corners[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]
        low = np.maximum(np.floor(pixels.min(0)).astype(int) - 2, 0)
        high = np.minimum(np.ceil(pixels.max(0)).astype(int) + 3, [width, height])
        if (high <= low).any():
            continue
        (left, top), (right, bottom) = low, high
        h, w = plate.picture.shape[:2]
        source = np.array([[-0.5, -0.5], [w - 0.5, -0.5], [w - 0.5, h - 0.5], [-0.5, h - 0.5]], np.float32)
        target = ((pixels - low + 0.5) * FINE - 0.5).astype(np.float32)
        warp = cv2.getPerspectiveTransform(source, target)
        size = (int(right - left) * FINE, int(bottom - top) * FINE)
        share = covered_centres(target, size)
        shape = (bottom - top, FINE, right - left, FINE)
        covered = share.reshape(shape).mean((1, 3))[..., None]
        if (plate.picture == plate.picture[0, 0]).all():
            painted = covered * plate.picture[0, 0].astype(np.float32)
        else:
            drawn = cv2.warpPerspective(
                plate.picture, warp, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE
            )  # fmt: skip
            painted = (drawn * share[..., None]).reshape(*shape, 3).sum((1, 3)) / (FINE**2)
        behind = colour[top:bottom, left:right]
        behind[:] = behind * (1 - covered) + painted
        z = (at @ rotation[:, 2]) / (rays[top:bottom, left:right] @ rotation[:, 2])
        patch = depth[top:bottom, left:right]
        patch[:] = np.where(covered[..., 0] > 0.5, z, patch)
    return depth, colour


def pictures(plates, rng, *, turn=LEVEL, scale=1.0, shift=(0, 0), exposures=None):
    """Return depth [mm] and RGB of one frame; depth is `scale` times too long and shifted by `shift` px right and down.

    exposures: plates at several instants of the exposure, over which colour is averaged.
    """
    depth, colour = true_view(plates, turn)
    if exposures is not None:
        colour = sum(true_view(instant, turn)[1] for instant in exposures) / np.float32(len(exposures))
    seen = np.roll(scale * depth, (shift[1], shift[0]), axis=(0, 1))
    colour = colour + 2.0 * rng.standard_normal((CAMERA.height, CAMERA.width, 1), np.float32)
    return spoil(seen, CAMERA, rng), np.clip(np.rint(colour), 0, 255).astype(np.uint8)


class StageSensor(DepthSensor):
    """A sensor that gives the frames of a list of (depth, colour)."""

    def __init__(self, frames, camera=CAMERA, fps=30.0):
        self._frames, self._next, self._fps = list(frames), 0, fps
        self._info = SensorInfo(
            name="stage", uri="stage", width=camera.width, height=camera.height, fps=fps, intrinsics=camera,
            is_live=False, frame_count=len(self._frames),
        )  # fmt: skip

    @property
    def info(self):
        return self._info

    def read(self, timeout_s=1.0):
        if self._next >= len(self._frames):
            return None
        depth, colour = self._frames[self._next]
        self._next += 1
        time = self._next / self._fps
        return SensorFrame(index=self._next - 1, time_s=time, host_time_s=time, depth=depth, colour=colour)

    def close(self):
        self._next = len(self._frames)
