"""The surroundings of the synthetic garment: a wall, a floor, and panels behind, beside and in front of it.

Everything is a flat, upright rectangle that faces the sensor, and a floor,

    z_floor(v) = fy h / (v - cy),     h the floor below the sensor

This suffices for a depth image, which shows the position, size and near side of each jump in depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_host.synthetic.scene import CAMERA
from formats.arrays import Floats

FLOOR_BELOW = 1.1  # m below the sensor; our choice: as on a table


@dataclass(frozen=True)
class Panel:
    """A rectangle that faces the sensor [m], sensor frame, and its grey value."""

    left: float
    right: float
    top: float
    bottom: float
    z: float
    grey: float


@dataclass(frozen=True)
class Surroundings:
    """Wall distance [m], whether there is a floor, and panels, anywhere."""

    wall: float
    has_floor: bool = False
    panels: tuple[Panel, ...] = ()

    def draw(self, depth: Floats, colour: Floats) -> None:
        """Draw floor and panels into a depth [m], (height, width), and a colour image, (height, width, 3)."""
        if self.has_floor:
            below = np.arange(CAMERA.height) - CAMERA.cy
            floor = CAMERA.fy * FLOOR_BELOW / np.maximum(below, 1e-9)
            near = floor < self.wall
            depth[near] = floor[near, None]
            colour[near] = 95.0 + 20.0 * (np.floor(6.0 * floor[near, None, None]) % 2)
        for panel in self.panels:
            draw_panel(panel, depth, colour)


def draw_panel(panel: Panel, depth: Floats, colour: Floats) -> None:
    """Draw one rectangle where it is nearer than the existing depth: in the pixels whose centres it covers."""
    columns = CAMERA.fx * np.array([panel.left, panel.right]) / panel.z + CAMERA.cx
    rows = CAMERA.fy * np.array([panel.top, panel.bottom]) / panel.z + CAMERA.cy
    left, right = np.clip(np.ceil(columns), 0, CAMERA.width).astype(int)
    top, bottom = np.clip(np.ceil(rows), 0, CAMERA.height).astype(int)
    patch = depth[top:bottom, left:right]
    is_near = patch > panel.z
    colour[top:bottom, left:right][is_near] = panel.grey
    patch[is_near] = panel.z
