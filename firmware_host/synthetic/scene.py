"""The scene of the synthetic world: camera, hanger, markers and skirt, with their positions.

Sensor frame: x right, y down, z away from the sensor, metres; gravity along +y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formats.arrays import Floats
from formats.garment import Garment, TrackedPoint
from formats.rig import Calibration, Hanger, Rig, Sensor

# PS1080 at VGA: OpenNI's factory focal length.
CAMERA = Sensor(width=640, height=480, fx=575.8, fy=575.8, cx=319.5, cy=239.5)
FPS = 30  # frames a second, of the PS1080 at VGA
# m, midway between the markers. Our choice: the skirt's 0.45 m below it and its swing stay in view at this distance.
HANGER_REST = (0.0, -0.27, 1.6)
WALL_DISTANCE = 2.6  # m; our choice: a metre behind the cloth, within the sensor's 3.5 m; half would touch a swing
PLATE_SIZE = 0.076  # m, white plate that carries a marker; our choice: leaves a quiet zone around the marker
BAR_SIZE = (0.44, 0.022)  # m, clamp bar along the held edge; our choice: 20 mm beyond either held corner

HANGER = Hanger(
    dictionary="DICT_4X4_50", ids=(0, 1), marker_size_m=0.06, marker_distance_m=0.30,
    held_m=((-0.20, 0.09, 0.0), (0.20, 0.09, 0.0)),
)  # fmt: skip
RIG = Rig(
    format="hangtime-rig/1", name="synthetic rig", gravity=(0.0, 1.0, 0.0), hanger=HANGER, sensor=CAMERA,
    calibration=Calibration(  # known exactly, as the scene is drawn by it
        gravity_sd_degrees=0.0, depth_scale_sd=0.0, depth_offset_sd_px=(0.0, 0.0), held_sd_m=((0.0,) * 3, (0.0,) * 3)
    ),
)  # fmt: skip

# Bits of the first two markers of OpenCV's DICT_4X4_50; 1 is white, rows from the top. Source: opencv
# `predefined_dictionaries.hpp`, DICT_4X4_1000_BYTES; the tests of `capture` check them against OpenCV.
MARKER_BITS = {
    0: ((1, 0, 1, 1), (0, 1, 0, 1), (0, 0, 1, 1), (0, 0, 1, 0)),
    1: ((0, 0, 0, 0), (1, 1, 1, 1), (1, 0, 0, 1), (1, 0, 1, 0)),
}

TOP_WIDTH, BOTTOM_WIDTH, PANEL_LENGTH = 0.40, 0.50, 0.45  # m, the skirt's front panel


def central_place() -> tuple[float, float]:
    """Return the skirt's centre: the point that maximises the least straight distance to the four corners."""
    # By symmetry on the middle line at depth d: (TOP_WIDTH/2)^2 + d^2 = (BOTTOM_WIDTH/2)^2 + (PANEL_LENGTH - d)^2.
    depth = ((BOTTOM_WIDTH / 2) ** 2 - (TOP_WIDTH / 2) ** 2 + PANEL_LENGTH**2) / (2 * PANEL_LENGTH)
    return 0.0, -depth


def demo_garment() -> Garment:
    """The front panel of a short skirt in a clamp hanger."""
    outline = (
        (-TOP_WIDTH / 2, 0.0),
        (TOP_WIDTH / 2, 0.0),
        (BOTTOM_WIDTH / 2, -PANEL_LENGTH),
        (-BOTTOM_WIDTH / 2, -PANEL_LENGTH),
    )
    names = ("top_left", "top_right", "bottom_right", "bottom_left")
    points = [TrackedPoint(name=n, at_m=p) for n, p in zip(names, outline, strict=True)]
    points.append(TrackedPoint(name="centre", at_m=central_place()))
    return Garment(
        format="hangtime-garment/1", name="demo skirt", kind="skirt", mass_kg=0.035, outline_m=outline, held="edge",
        points=tuple(points),
    )  # fmt: skip


@dataclass(frozen=True)
class Placement:
    """The hanger's pose: origin, (n, 3), and rotation, (n, 3, 3), from the hanger's frame to the sensor's."""

    origin: Floats
    rotation: Floats

    def to_sensor(self, offsets: Floats) -> Floats:
        """Transform points of the hanger's frame, (k, 3), to the sensor's, (n, k, 3)."""
        return np.asarray(self.origin[:, None] + np.einsum("nij,kj->nki", self.rotation, offsets))

    @property
    def markers(self) -> Floats:
        """Marker centres [m], (n, 2, 3)."""
        half = HANGER.marker_distance_m / 2
        return self.to_sensor(np.array([[-half, 0.0, 0.0], [half, 0.0, 0.0]]))

    @property
    def held(self) -> Floats:
        """Ends of the held edge [m], (n, 2, 3)."""
        return self.to_sensor(np.array(HANGER.held_m))


def place(displacement: Floats, yaw: Floats, roll: Floats) -> Placement:
    """Return hanger poses: displaced, (n, 3), rotated about the vertical and about the depth axis, (n,) each."""
    cy, sy, cr, sr = np.cos(yaw), np.sin(yaw), np.cos(roll), np.sin(roll)
    zero = np.zeros_like(yaw)
    rotation = np.stack(
        [
            np.stack([cy * cr, -cy * sr, sy], -1),
            np.stack([sr, cr, zero], -1),
            np.stack([-sy * cr, sy * sr, cy], -1),
        ],
        axis=1,
    )
    return Placement(np.asarray(HANGER_REST) + displacement, rotation)
