"""The daemon's button and lamps: opened as soon as they are present; the daemon also runs without them."""

from __future__ import annotations

from contextlib import suppress

from capture.appliance.config_tables import Config
from capture.appliance.faults import FaultBook
from capture.appliance.showing import Lamps, Light
from firmware_host.button import STUCK, ButtonContact, Presses, open_contact
from firmware_host.errors import ButtonError, LampError
from firmware_host.lamp import StatusLamp

# s between two attempts to open the button or the lamp. Our choice: half and double change only how late a replugged
# button or lamp works.
REOPENING = 2.0


class Panel:
    """The button and the lamps of the configuration."""

    def __init__(self, config: Config, faults: FaultBook) -> None:
        self._config, self._faults = config, faults
        self._contact: ButtonContact | None = None
        self._presses = Presses()
        self._lamps: Lamps | None = None
        self._tried_button = self._tried_lamp = -float("inf")

    def presses(self, now: float) -> int:
        """Return how often the button was pressed since the last call; now [s], monotonic."""
        if not self._config.button.device:
            return 0
        try:
            if self._contact is None:
                if now - self._tried_button < REOPENING:
                    return 0
                self._tried_button = now
                self._contact = open_contact(self._config.button.device)
                self._presses = Presses(is_down=self._contact.is_down())
                self._faults.clear("button")
            count = self._presses.take(self._contact.changes(), now)
        except ButtonError as error:
            self._drop_button()
            self._faults.set("button", error, now)
            return 0
        if self._presses.is_stuck:
            stuck = ButtonError(
                f"the button has been down for {STUCK:g} s or more", where=self._config.button.device,
                advice="free it; until then use `hangtime start` and `hangtime stop`",
            )  # fmt: skip
            self._faults.set("button_stuck", stuck, now)
        else:
            self._faults.clear("button_stuck")
        return count

    def show(self, light: Light, now: float) -> None:
        """Show a light on the lamps."""
        part = self._config.lamp
        if not part.led:
            return
        try:
            if self._lamps is None:
                if now - self._tried_lamp < REOPENING:
                    return
                self._tried_lamp = now
                red = StatusLamp(part.fault_led, part.leds) if part.fault_led else None
                self._lamps = Lamps(StatusLamp(part.led, part.leds), red)
                self._faults.clear("lamp")
            self._lamps.show(light)
        except LampError as error:
            self._lamps = None
            self._faults.set("lamp", error, now)

    def close(self) -> None:
        """Release the button and the lamps."""
        self._drop_button()
        if self._lamps is not None:
            self._lamps.close()

    def _drop_button(self) -> None:
        if self._contact is not None:
            with suppress(OSError):
                self._contact.close()
        self._contact = None
