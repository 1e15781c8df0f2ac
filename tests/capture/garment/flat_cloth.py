"""Silhouettes with known pixels, depth from a formula, and surfaces with known nodes."""

from __future__ import annotations

import math

import cv2
import numpy as np

from capture.garment.corners import BEND_SHARE, CURL_SD, OUTLINE_ALIKE
from capture.garment.silhouette import Silhouette, Window
from formats.rig import Sensor

LEFT, TOP = 200, 150  # px, where the window begins in the picture
LEFT_TOP = np.array([LEFT, TOP])
SQUARE = Sensor(width=640, height=480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)
PIXEL = 1.6 / 500.0  # m that a pixel of SQUARE spans 1.6 m away
H = 0.02  # m between nodes


def silhouette(mask, depth=1.6, raw=None):
    """The cloth where mask, (h, w), is 1, at a depth [m], one number or (h, w)."""
    mask = np.ascontiguousarray(mask, np.uint8)
    metres = (np.broadcast_to(depth, mask.shape) * mask).astype(np.float32)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(outlines, key=len).reshape(-1, 2).astype(float)
    h, w = mask.shape
    seen = np.rint(1e3 * metres).astype(np.uint16) if raw is None else raw
    return Silhouette(Window(LEFT, TOP, LEFT + w, TOP + h), mask, metres, seen, outline, False)


def rectangle(left, top, right, bottom, shape=(160, 200)):
    """A mask of the columns and rows from left, top to right, bottom, all of them included."""
    mask = np.zeros(shape, np.uint8)
    mask[top : bottom + 1, left : right + 1] = 1
    return mask


def sheet(rows=9, columns=12, slope=0.0):
    """A flat surface [m], (rows, columns, 3), whose depth rises by `slope` along x."""
    y, x = np.indices((rows, columns)) * H
    return np.stack([x, y, 1.6 + slope * x], axis=-1)


def line_sd(along, across=0.0):
    """The sd [px] of a side's line at its corner, 0 along it, by the covariance of numpy's least squares.

    along, across [px], (n,): the side's pixels
    """
    along, across = np.asarray(along, float), np.broadcast_to(across, np.shape(along))
    line = np.stack([np.ones(len(along)), along], axis=1)
    across = across - across.mean()
    solved = np.linalg.lstsq(line, along**2, rcond=None)[0]
    arch = along**2 - line @ solved
    bend = arch @ across / (arch @ arch)
    noise = OUTLINE_ALIKE * max(np.mean(across**2), 1 / 12)
    beyond_noise = max(0.0, bend**2 - 4 * noise / (arch @ arch)) * solved[0] ** 2
    return math.sqrt(noise * np.linalg.inv(line.T @ line)[0, 0] + CURL_SD**2 + BEND_SHARE * beyond_noise)


RECTANGLE = np.array([[20, 20], [179, 20], [179, 139], [20, 139]], float)  # px of the window
WHOLE = rectangle(20, 20, 179, 139)
