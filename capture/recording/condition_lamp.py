"""Show a recording's condition on the status lamp (`capture.recording.condition.Lamp`: steady, slow, fast)."""

from __future__ import annotations

from capture.recording.condition import Condition, Lamp
from firmware_host.lamp import StatusLamp

BLINKS = {Lamp.SLOW: 500, Lamp.FAST: 125}  # ms on and again off: one and four blinks a second


def show_condition(lamp: StatusLamp, condition: Condition) -> None:
    """Show a recording's condition on the lamp.

    Raises:
        LampError: the LED was removed or may not be set.
    """
    half = BLINKS.get(condition.value.lamp)
    if half is None:
        lamp.steady()
    else:
        lamp.blink(half, half)
