"""Diagnose undetected fiducial markers: doubled, mirrored, upside down, inverted, of other ids or another dictionary.

A mirrored marker does not belong to its dictionary, so a mirrored image shows no marker at all.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from capture.hanger.marker_detection import MarkerDetector, times_seen
from formats.arrays import Bytes
from formats.plain_text import joined
from formats.rig import Hanger

OTHERS = (
    "DICT_4X4_50", "DICT_5X5_50", "DICT_6X6_50", "DICT_7X7_50", "DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h11",
)  # fmt: skip  # printed most; a larger set of one size begins with the same markers


def seen_otherwise(colour: Bytes | None, hanger: Hanger, *, is_turned: bool = False) -> str:
    """Return how both markers appear in an RGB image, (H, W, 3), and the remedy; "" if they do not appear.

    Dots look the same in a mirror.

    is_turned: the recording says that its pictures are mirrored, and this one was turned round
    """
    if colour is None or hanger.marker == "dot":
        return ""
    seen = times_seen(colour, hanger.dictionary)
    if doubled := _doubled(seen, hanger):
        return _seen_twice(doubled, [number for number in hanger.ids if not seen[number]])
    mirrored = np.ascontiguousarray(colour[:, ::-1])
    if _finds(mirrored, hanger, hanger.dictionary):
        return _seen_mirrored(is_on_its_head=is_upside_down(mirrored, hanger), is_turned=is_turned)
    if _finds(255 - colour, hanger, hanger.dictionary):
        return "both are seen white on black: print them black on white"
    if len(others := sorted(set(seen) - set(hanger.ids))) >= len(hanger.ids):
        return f"markers {joined(list(map(str, others)))} are seen: set the rig's hanger.ids"
    for name in OTHERS:
        if name != hanger.dictionary and _finds(colour, hanger, name):
            return f"markers {hanger.ids[0]} and {hanger.ids[1]} of {name} are seen: set the rig's hanger.dictionary"
    return ""


def is_seen_twice(colour: Bytes | None, hanger: Hanger) -> bool:
    """Return whether a marker of the hanger appears more than once in an RGB image, (H, W, 3)."""
    if colour is None or hanger.marker == "dot":
        return False
    return bool(_doubled(times_seen(colour, hanger.dictionary), hanger))


def _doubled(seen: Counter[int], hanger: Hanger) -> list[int]:
    return [number for number in hanger.ids if seen[number] > 1]


def is_upside_down(colour: Bytes | None, hanger: Hanger) -> bool:
    """Return whether both markers stand on their heads in an RGB image, (H, W, 3); dots never do."""
    if colour is None or hanger.marker == "dot":
        return False
    corners = MarkerDetector(hanger.dictionary, hanger.ids).in_picture(colour)  # clockwise from the top left one
    across, down = (corners[:, 3] - corners[:, 0]).T
    return bool((down < -np.abs(across)).all())


def _seen_mirrored(*, is_on_its_head: bool, is_turned: bool) -> str:
    if is_turned:
        step = "set its xnMirror to 0" + " and turn the sensor over" * is_on_its_head
        return f"the file says that its pictures are mirrored, and both are read without that: {step}"
    if is_on_its_head:
        return (
            "both are seen with the picture's rows turned round: record the top row first, or turn the sensor over "
            "and switch off its mirror"
        )
    return "both are seen in the picture's mirror image: switch the sensor's mirror off"


def _seen_twice(doubled: list[int], absent: list[int]) -> str:
    if absent:
        return f"marker {doubled[0]} is seen twice, and marker {absent[0]} is not: print both markers of the rig"
    which = " and ".join(map(str, doubled))
    named = f"marker {which} is" if len(doubled) == 1 else f"markers {which} are"
    return f"{named} seen twice: leave only the hanger's own in view"


def _finds(colour: Bytes, hanger: Hanger, dictionary: str) -> bool:
    return bool(np.isfinite(MarkerDetector(dictionary, hanger.ids).in_picture(colour)).all())
