"""Scenes of a towel on a hanger in front of the camera, with objects that may cover it."""

from __future__ import annotations

import numpy as np

from formats.rig import Rig
from tests.capture.garment.towel import HANGER
from tests.capture.stage import CAMERA, marker_plate, pictures, plain_plate

RIG = Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0), hanger=HANGER, sensor=CAMERA)
SIDES = np.array([[-0.15, 0, 0], [0.15, 0, 0]])
BELOW = np.array([0, 0.09 + 0.2, 0])
SKIN = (205, 160, 140)
BODY = plain_plate([0.0, 0.1, 0.9], (0.5, 1.4), SKIN)
LEGS = plain_plate([0.0, 0.24, 0.9], (0.5, 0.45), SKIN)


def hung(at=(0.0, -0.2, 1.6), markers=(0, 1)):
    """A hanger with a flat towel below it."""
    middle = np.array(at)
    plates = [marker_plate(i, middle + SIDES[i]) for i in markers]
    return [*plates, plain_plate(middle + BELOW, (0.4, 0.4), (60, 70, 150))]


def nothing():
    """Return two frames of a plain wall, in which the search for markers is quick."""
    return [(np.full((480, 640), 2600, np.uint16), np.full((480, 640, 3), 128, np.uint8))] * 2


def scenes(*plates, seed=9):
    """Two frames of a scene."""
    rng = np.random.default_rng(seed)
    return [pictures(list(plates), rng) for _ in range(2)]
