"""The appliance's button: reads its changes of state and detects presses among them.

The kernel presents a GPIO button as an input device (device tree overlay `gpio-key`), which is read through evdev.
Without this overlay, gpiod reads the line itself. A named pipe that carries `struct input_event` can replace the
button.

Source: Linux, Documentation/input/input.rst and include/uapi/linux/input.h.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
from abc import ABC, abstractmethod
from datetime import timedelta
from pathlib import Path

from firmware_host.errors import ButtonError

EVENT = struct.Struct("llHHi")  # struct input_event: seconds, microseconds, type, code, value
KEY_EVENT = 1  # EV_KEY
UP, DOWN = 0, 1  # values of a key's event; 2 is the keyboard's own repetition
# s after a change in which contacts bounce. Our choice: a press counts at once, and only a change back waits. No
# button's bounce was measured, and half and double were not tried.
BOUNCE = 0.03
# s after a press in which a further press counts as an accidental repetition. Our choice: a take ends seconds after it
# began. Half and double were not tried.
REPEATED_WITHIN = 0.5
STUCK = 10.0  # s; a button held longer counts as stuck; our choice: a press counts at once, so nobody holds it as long
EVENTS_AT_ONCE = 64  # events per read; our choice: more than a bouncing button sends between two frames
KEYS = 96  # bytes: one bit for each of KEY_CNT = 768 keys
EVIOCGKEY = 0x80604518  # _IOR('E', 0x18, KEYS bytes): which keys are down
INPUTS, DEVICES = Path("/sys/class/input"), Path("/dev/input")


class ButtonContact(ABC):
    """A source of a button's changes of state."""

    @abstractmethod
    def changes(self) -> list[bool]:
        """Return the changes since the last call, True for a press; never block.

        Raises:
            ButtonError: the button was removed.
        """

    @abstractmethod
    def is_down(self) -> bool:
        """Return whether it is down now; False if the device cannot report this."""

    @abstractmethod
    def close(self) -> None:
        """Release the device."""


class EventContact(ButtonContact):
    """Changes of any key of a Linux input device, or from a named pipe whose writer may come and go.

    This reads the events without PyPI's evdev library, which loads asyncio, 7 MB of the appliance's memory, and has to
    be compiled at installation.
    """

    def __init__(self, path: Path) -> None:
        """Open an input device or a named pipe.

        Raises:
            ButtonError: there is no such device, or this user may not read it.
        """
        self._path = path
        try:
            self._handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise _gone(path, error) from error
        self._rest = b""

    def changes(self) -> list[bool]:
        """Return the changes since the last call."""
        try:
            content = self._rest + os.read(self._handle, EVENTS_AT_ONCE * EVENT.size)
        except BlockingIOError:
            return []
        except OSError as error:
            raise _gone(self._path, error) from error
        if not content and not self._path.exists():
            raise ButtonError("the button is gone", where=self._path, advice="plug it in again")
        whole = len(content) - len(content) % EVENT.size
        self._rest = content[whole:]
        events = EVENT.iter_unpack(content[:whole])
        return [value == DOWN for _, _, kind, _, value in events if kind == KEY_EVENT and value in (UP, DOWN)]

    def is_down(self) -> bool:
        """Return whether any key of the device is down; False for a pipe, which cannot report it."""
        keys = bytearray(KEYS)
        try:
            fcntl.ioctl(self._handle, EVIOCGKEY, keys)
        except OSError:
            return False
        return any(keys)

    def close(self) -> None:
        """Close the device."""
        os.close(self._handle)


class LineContact(ButtonContact):
    """Changes of a GPIO line that a button connects to ground; not tested on hardware."""

    def __init__(self, chip: str, line: int) -> None:
        """Request the line from the kernel.

        Raises:
            ButtonError: there is no such line, another program holds it, or this user may not use it.
        """
        import gpiod
        from gpiod.line import Bias, Direction, Edge, Value

        self._line, self._active, self._where = line, Value.ACTIVE, f"{chip}:{line}"
        self._rising = gpiod.EdgeEvent.Type.RISING_EDGE
        settings = gpiod.LineSettings(
            direction=Direction.INPUT, edge_detection=Edge.BOTH, bias=Bias.PULL_UP, active_low=True,
            debounce_period=timedelta(milliseconds=5),
        )  # fmt: skip
        try:
            self._request = gpiod.request_lines(chip, consumer="hangtime", config={line: settings})
        except OSError as error:
            raise _gone(Path(chip), error) from error

    def changes(self) -> list[bool]:
        """Return the changes since the last call."""
        try:
            if not self._request.wait_edge_events(timedelta(0)):
                return []
            return [event.event_type == self._rising for event in self._request.read_edge_events()]
        except OSError as error:
            raise ButtonError(
                f"cannot be read ({error.strerror})", where=self._where, advice="check its wires"
            ) from error

    def is_down(self) -> bool:
        """Return whether the line is at ground."""
        return bool(self._request.get_value(self._line) == self._active)

    def close(self) -> None:
        """Release the GPIO line."""
        self._request.release()


def open_contact(name: str) -> ButtonContact:
    """Open a button by its name: a path, an input device's name, or gpio:CHIP:LINE.

    Raises:
        ButtonError: there is none of this name.
    """
    if name.startswith("gpio:"):
        chip, _, line = name.removeprefix("gpio:").rpartition(":")
        if not chip or not line.isdecimal():
            raise ButtonError("is no line of a GPIO chip", where=name, advice="write gpio:/dev/gpiochip0:17")
        return LineContact(chip, int(line))
    return EventContact(Path(name) if name.startswith("/") else _named(name))


class Presses:
    """Detects presses among changes: ignores bounce and accidental double presses, and reports a stuck button.

    A press counts as soon as the button goes down. A change within `BOUNCE` is bounce. A press within
    `REPEATED_WITHIN` of the previous one does not count.
    """

    def __init__(self, *, is_down: bool = False) -> None:
        """Begin; is_down: the button is held already, which does not count as a press."""
        self._level = self._raw = is_down
        self._changed_at = -float("inf")
        self._pressed_at = -float("inf")
        self._down_since = 0.0 if is_down else None
        self._is_new = is_down
        self.is_stuck = False

    def take(self, changes: list[bool], now: float) -> int:
        """Process the changes since the last call and return the number of presses; now [s], monotonic."""
        if self._is_new:
            self._down_since, self._is_new = now, False
        presses = 0
        for raw in changes:
            self._raw = raw
            presses += self._settled(now)
        presses += self._settled(now)
        self.is_stuck = self._down_since is not None and now - self._down_since >= STUCK
        return presses

    def _settled(self, now: float) -> int:
        if self._raw == self._level or now - self._changed_at < BOUNCE:
            return 0
        self._level, self._changed_at = self._raw, now
        self._down_since = now if self._level else None
        if not self._level or now - self._pressed_at < REPEATED_WITHIN:
            return 0
        self._pressed_at = now
        return 1


def _named(name: str) -> Path:
    """Return the input device of this name."""
    there = {}
    for file in sorted(INPUTS.glob("event*/device/name")):
        with contextlib.suppress(OSError):
            there[file.read_text().strip()] = DEVICES / file.parts[-3]
    if name not in there:
        known = f"choose one of {', '.join(sorted(there))}" if there else "this machine shows none; check its overlay"
        known += "; a path begins with /"
        raise ButtonError(f"there is no input device {name!r}", where=DEVICES, advice=known)
    return there[name]


def _gone(path: Path, error: OSError) -> ButtonError:
    reason = (error.strerror or str(error)).lower()
    return ButtonError(f"the button cannot be read ({reason})", where=path, advice="check its wires and its overlay")
