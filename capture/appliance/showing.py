"""The table of the lamp's signals in order of priority: the lamp shows the first row whose condition is true."""

from __future__ import annotations

from dataclasses import dataclass

from capture.appliance.states import State
from firmware_host.errors import LampError
from firmware_host.lamp import StatusLamp


@dataclass(frozen=True)
class Light:
    """A signal: milliseconds on and off; steady if never off. With two LEDs, faults use the red one."""

    name: str
    meaning: str
    light_ms: int
    dark_ms: int
    is_red: bool = False


FAULT_LIGHT = Light("fault", "nothing can be recorded; `hangtime status` says why", 125, 125, is_red=True)
LOST_LIGHT = Light("tracking lost", "recording, but hanger or garment is not seen", 500, 500, is_red=True)
BEHIND_LIGHT = Light("behind", "recording, but the last two seconds are not on the disk yet", 250, 1000)
RECORDING = Light("recording", "recording; all but the last two seconds is on the disk", 1000, 0)
SAVING = Light("saving", "the end of the take is being put on the disk", 250, 250)
DOUBT = Light("look", "the last take has a flaw, or something needs a look: `hangtime status`", 60, 940, is_red=True)
KEPT_LIGHT = Light("kept", "the take is on the disk under its name; shown for three seconds", 3000, 0)
ARMED = Light("armed", "hanger in view: press", 1500, 500)
SYNCING = Light("syncing", "takes are on their way to the server", 60, 440)
READY_LIGHT = Light("ready", "waiting for the hanger", 60, 2940)
STARTING = Light("starting", "the sensor is being opened", 60, 60)

# s of a running take that may be lost. Our choice: a block is written every second, so one late block is no fault.
BEHIND_S = 2.0
# s for which the lamp signals a kept take. Our choice: time to look from the button to the lamp. Half and double were
# not tried.
KEPT_S = 3.0


def lamp_signal(state: State, *, is_tracking: bool, behind_s: float, kept_ago_s: float, has_complaint: bool) -> Light:
    """Return the lamp's signal.

    - `is_tracking`: hanger and garment are detected
    - `behind_s`: age of the oldest frame that is not on the disk
    - `kept_ago_s`: time since a take was kept
    - `has_complaint`: a fault that does not block recording, or a flaw of the last take
    """
    if state is State.RECORDING:
        if not is_tracking:
            return LOST_LIGHT
        return BEHIND_LIGHT if behind_s > BEHIND_S else RECORDING
    if state is State.FAULT:
        return FAULT_LIGHT
    if state in (State.STARTING, State.SAVING):
        return {State.STARTING: STARTING, State.SAVING: SAVING}[state]
    if kept_ago_s < KEPT_S:
        return KEPT_LIGHT
    if has_complaint:
        return DOUBT
    return {State.ARMED: ARMED, State.SYNCING: SYNCING, State.READY: READY_LIGHT}[state]


class Lamps:
    """One LED, or a green and a red one; written to only when something changes."""

    def __init__(self, lamp: StatusLamp | None, red: StatusLamp | None = None) -> None:
        self._lamp, self._red = lamp, red
        self._shown: Light | None = None

    def show(self, light: Light) -> None:
        """Show a signal.

        Raises:
            LampError: an LED was removed or cannot be set; the lamp then shows nothing.
        """
        if light is self._shown or self._lamp is None:
            return
        self._shown = light
        chosen, other = (self._lamp, self._red) if self._red is None or not light.is_red else (self._red, self._lamp)
        try:
            if other is not None:
                other.dark()
            if light.dark_ms:
                chosen.blink(light.light_ms, light.dark_ms)
            else:
                chosen.steady()
        except LampError:
            self._lamp = self._red = None
            raise

    def close(self) -> None:
        """Release the LEDs."""
        for lamp in (self._lamp, self._red):
            if lamp is not None:
                lamp.__exit__(None, None, None)
