"""The sensor's view, as one line of text and as a small picture, for setting the appliance up."""

from __future__ import annotations

import base64
from typing import Any

import cv2
import numpy as np

from capture.recording.condition import condition_of
from capture.recording.tracking import Tracked
from firmware_host.depth_sensor import SensorFrame
from formats.arrays import Bytes, Unsigned
from formats.plain_text import with_advice

PICTURE_WIDTH = 320  # px of the picture; our choice: half of the sensor's, a quarter of the bytes over the air
# RGB. Our choice: three hues that differ from one another; with equal hues a line would hide its points.
MARKER_COLOUR, POINT_COLOUR, LINE_COLOUR = (0, 200, 0), (255, 160, 0), (0, 120, 255)


class Preview:
    """The image of the last processed frame, and the markers and garment found in it."""

    def __init__(self) -> None:
        self._picture: Bytes | Unsigned | None = None
        self._sight: Tracked | None = None

    def keep(self, frame: SensorFrame, sight: Tracked) -> None:
        """Keep the colour image of a frame until the next, or its depth image if it has no colour."""
        self._picture = frame.depth if frame.colour is None else frame.colour
        self._sight = sight

    def answer(self) -> dict[str, Any]:
        """Return the line and the image, base64; without an image before the first frame."""
        if self._picture is None or self._sight is None:
            return {"line": "no frame yet", "png": ""}
        return {"line": self._line(self._sight), "png": base64.b64encode(_png(self._picture, self._sight)).decode()}

    @staticmethod
    def _line(sight: Tracked) -> str:
        condition = condition_of(sight.state, are_read=bool(np.isfinite(sight.hanger.centres).all()))
        said = condition.value
        if not sight.hanger.is_found:
            return with_advice(said.words, said.advice)
        away = float(sight.hanger.positions[:, 2].mean())
        points = f"{int(sight.cloth.valid.sum())} of {len(sight.cloth.valid)} points"
        return with_advice(f"{said.words}: hanger {away:.2f} m away, {points}", said.advice)


def _png(seen: Bytes | Unsigned, sight: Tracked) -> bytes:
    if seen.ndim == 3:
        picture = seen.astype(np.uint8)  # a copy, to draw into
    else:
        picture = cv2.cvtColor(np.clip(seen // 16, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2RGB)
    for corners in sight.hanger.corners[np.isfinite(sight.hanger.corners).all((1, 2))]:
        cv2.polylines(picture, [np.rint(corners).astype(np.int32)], True, MARKER_COLOUR, 2)
    if len(sight.cloth.outline):
        cv2.polylines(picture, [np.rint(sight.cloth.outline).astype(np.int32)], True, LINE_COLOUR, 1)
    for pixel in sight.cloth.pixels[sight.cloth.valid]:
        cv2.circle(picture, tuple(int(v) for v in np.rint(pixel)), 5, POINT_COLOUR, 2)
    height = round(picture.shape[0] * PICTURE_WIDTH / picture.shape[1])
    small = cv2.resize(picture, (PICTURE_WIDTH, height), interpolation=cv2.INTER_AREA)
    done, content = cv2.imencode(".png", cv2.cvtColor(small, cv2.COLOR_RGB2BGR))
    return content.tobytes() if done else b""
