"""Show the condition of a recording on the status lamp (`capture.recording.condition.Lamp`: steady, slow, fast)."""

from __future__ import annotations

from capture.recording.condition import Condition, Lamp
from firmware_host.lamp import StatusLamp

BLINKS = {Lamp.SLOW: 500, Lamp.FAST: 125}  # ms of light and again of dark: one and four blinks a second


def show_condition(lamp: StatusLamp, condition: Condition) -> None:
    """Let the lamp say how a recording is.

    Raises:
        LampError: the LED went away or may not be changed.
    """
    half = BLINKS.get(condition.value.lamp)
    if half is None:
        lamp.steady()
    else:
        lamp.blink(half, half)
