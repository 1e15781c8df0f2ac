"""Diagnose undetected fiducial markers: mirrored, inverted, of other ids or of another dictionary.

A mirrored marker does not belong to its dictionary, so a mirrored image shows no marker at all.
"""

from __future__ import annotations

import numpy as np

from capture.hanger.marker_detection import MarkerDetector, ids_in
from formats.arrays import Bytes
from formats.rig import Hanger

OTHERS = (
    "DICT_4X4_50", "DICT_5X5_50", "DICT_6X6_50", "DICT_7X7_50", "DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h11",
)  # fmt: skip  # printed most; a larger set of one size begins with the same markers


def seen_otherwise(colour: Bytes | None, hanger: Hanger) -> str:
    """Return how both markers appear in an RGB image, (H, W, 3), and the remedy; "" if they do not appear.

    Dots look the same in a mirror.
    """
    if colour is None or hanger.marker == "dot":
        return ""
    if _finds(np.ascontiguousarray(colour[:, ::-1]), hanger, hanger.dictionary):
        return "both are seen in the picture's mirror image: switch the sensor's mirror off"
    if _finds(255 - colour, hanger, hanger.dictionary):
        return "both are seen white on black: print them black on white"
    if len(others := sorted(ids_in(colour, hanger.dictionary) - set(hanger.ids))) >= len(hanger.ids):
        return f"markers {', '.join(map(str, others[:-1]))} and {others[-1]} are seen: set the rig's hanger.ids"
    for name in OTHERS:
        if name != hanger.dictionary and _finds(colour, hanger, name):
            return f"markers {hanger.ids[0]} and {hanger.ids[1]} of {name} are seen: set the rig's hanger.dictionary"
    return ""


def _finds(colour: Bytes, hanger: Hanger, dictionary: str) -> bool:
    return bool(np.isfinite(MarkerDetector(dictionary, hanger.ids).in_picture(colour)).all())
