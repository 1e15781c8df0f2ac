"""Whether the times of a recording that others made are in seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from formats.arrays import Floats
from formats.errors import TakeError

SLOWEST = 1.0  # s between frames: no swing shows at that pace, and milliseconds up to 1000 frames a second lie beyond


def check_seconds(time: Floats, path: Path) -> None:
    """Refuse times that increase, (frames,), but cannot be seconds.

    Raises:
        TakeError: in the median, frames are further apart than a second.
    """
    apart = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if apart > SLOWEST:
        raise TakeError(
            f"its frames are {apart:g} s apart in the median; is its time in seconds?", where=path,
            advice="divide milliseconds by 1e3, nanoseconds by 1e9",
        )  # fmt: skip
