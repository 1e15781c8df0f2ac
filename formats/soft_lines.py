"""Draw lines with soft edges on a picture: drawn three times as large, then made small."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

FINER_LINES = 3  # times: nine shades an edge

Places = Sequence[tuple[float, float]]


class SoftLines:
    """White paper of so many pixels, on which lines are drawn."""

    def __init__(self, width: int, height: int) -> None:
        """Take new paper.

        Raises:
            ModuleNotFoundError: Pillow is not installed.
        """
        from PIL import Image, ImageDraw

        self._size = width, height
        self._paper = Image.new("RGB", (FINER_LINES * width, FINER_LINES * height), "white")
        self._pen = ImageDraw.Draw(self._paper)

    def draw(self, places: Places, colour: str, width: int = 1) -> None:
        """Draw a line along places [px], its width in pixels; whole places are the middle of a pixel."""
        fine = [(FINER_LINES * x + FINER_LINES // 2, FINER_LINES * y + FINER_LINES // 2) for x, y in places]
        self._pen.line(fine, fill=colour, width=FINER_LINES * width, joint="curve" if len(fine) > 2 else None)

    def picture(self) -> Any:
        """Return the lines as a picture of Pillow's."""
        return self._paper.reduce(FINER_LINES)
