"""A PS1080 sensor's firmware: versions, serial number, log, lamp, emitter, resets.

A request is one control transfer; the reply is read in others, which the sensor stalls until the reply is ready. So a
stall means "ask again" until the time limit (OpenNI2 `XnHostProtocol.cpp`, XnHostProtocolUSBReceive).
"""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass

from firmware_host.errors import (
    FirmwareError,
    FirmwareRefusalError,
    FirmwareUnsupportedError,
    UsbAccessError,
    UsbStallError,
    UsbTimeoutError,
)
from firmware_host.usb_control import ps1080_answers as answers
from firmware_host.usb_control import ps1080_messages as messages
from firmware_host.usb_control.link import TRANSFER_TIMEOUT, UPDATE_ADVICE, UsbLink
from firmware_host.usb_control.ps1080_answers import FirmwareVersion, FixedParameters, TaskTime
from firmware_host.usb_control.ps1080_messages import Mode, Opcode

REQUEST = 0  # bRequest of every transfer; wValue and wIndex are 0 too (XnHostProtocolUSBSend)
SEND_TRIES = 5  # XN_USB_HOST_PROTOCOL_SEND_RETRIES
SEND_PAUSE = 0.1  # s, XnHostProtocolUSBSend
REPLY_PAUSE = 0.01  # s; OpenNI2 waits 100 ms with firmware before 5.3.16 and 1 ms after
READY_TRIES = 3  # XN_HOST_PROTOCOL_NOT_READY_RETRIES
READY_PAUSE = 1.0  # s, XnHostProtocolExecute
LARGEST_LOG = 6 * 1024  # bytes, XN_MAX_LOG_SIZE
STREAMS = (5, 6, 7)  # PARAM_GENERAL_STREAM0_MODE to STREAM2_MODE; 0 is off (XnParams.h)
SERIAL_SINCE = (5, 4, 0)  # XnHostProtocolInitFWParams, like the next four
PLATFORM_SINCE = (5, 7, 0)  # XnHostProtocolInitFWParams
LED_SINCE = (5, 8, 0)  # XnHostProtocolInitFWParams
RESET_STOPS_STREAMS_SINCE = (5, 2, 0)  # XnHostProtocolReset


@dataclass(frozen=True)
class Clock:
    """The source of time, in seconds."""

    now: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep


class Ps1080:
    """Queries the firmware; no other program may query the sensor at the same time."""

    def __init__(
        self, link: UsbLink, where: str = "PS1080", *, timeout_s: float = TRANSFER_TIMEOUT, clock: Clock | None = None
    ) -> None:
        self._link, self._where, self._timeout = link, where, timeout_s
        self._clock = clock or Clock()
        self._next_id = 0
        self._version: FirmwareVersion | None = None

    def version(self) -> FirmwareVersion:
        """Return the versions, queried once and then cached."""
        if self._version is None:
            self._version = answers.decode_version(self._ask(Opcode.GET_VERSION), self._where)
        return self._version

    def serial_number(self) -> str:
        """Return the serial number."""
        self._require(SERIAL_SINCE, "a serial number")
        return answers.decode_text(self._ask(Opcode.GET_SERIAL_NUMBER))

    def platform(self) -> str:
        """Return the name of the chip's board."""
        self._require(PLATFORM_SINCE, "a platform name")
        return answers.decode_text(self._ask(Opcode.GET_PLATFORM_STRING))

    def fixed_parameters(self) -> FixedParameters:
        """Return the factory's calibration, read in parts at offsets in 32-bit words."""
        data = b""
        while len(data) < answers.FIXED_PARAMETERS_SIZE:
            piece = self._ask(Opcode.GET_FIXED_PARAMETERS, struct.pack("<H", len(data) // 4))
            if not piece:
                break
            data += piece
        return answers.decode_fixed_parameters(data, self._where)

    def keep_alive(self) -> None:
        """Send a keep-alive request, which restarts the firmware's watchdog."""
        self._ask(Opcode.KEEP_ALIVE)

    def cpu_statistics(self) -> list[TaskTime]:
        """Return how long each task of the firmware has run."""
        return answers.decode_cpu_statistics(self._ask(Opcode.GET_CPU_STATISTICS))

    def log(self) -> list[str]:
        """Return the firmware's log lines since the last reading, which clears the log."""
        data = b""
        while len(data) < LARGEST_LOG and (piece := self._ask(Opcode.GET_LOG)):
            data += piece
        return answers.decode_log(data)

    def set_led(self, is_on: bool, led: int = 0) -> None:
        """Switch a lamp."""
        self._require(LED_SINCE, "a lamp that can be switched")
        self._ask(Opcode.SET_LED_STATE, struct.pack("<HH", led, is_on))

    def soft_reset(self) -> None:
        """Stop all streams and reset the firmware."""
        if self.version().number < RESET_STOPS_STREAMS_SINCE:
            for stream in STREAMS:
                self._ask(Opcode.SET_PARAMETER, struct.pack("<HH", stream, 0))
        self._set_mode(Mode.SOFT_RESET)

    def reboot(self) -> None:
        """Reboot the sensor; it leaves the USB bus and returns."""
        self._set_mode(Mode.REBOOT)

    def _set_mode(self, mode: Mode) -> None:
        """Change the mode; wait only briefly for a reply, since the firmware resets (XnHostProtocolSetMode)."""
        self._version = None
        request = self._encode(Opcode.SET_MODE, struct.pack("<H", mode))
        self._send(request[1])
        with contextlib.suppress(FirmwareError):
            self._receive(Opcode.SET_MODE, request[0])

    def _require(self, since: tuple[int, int, int], what: str) -> None:
        version = self.version()
        if version.number < since:
            raise FirmwareUnsupportedError(
                f"firmware {version} has no such request; {what} came with {'.'.join(map(str, since))}",
                where=self._where, advice=UPDATE_ADVICE,
            )  # fmt: skip

    def _ask(self, opcode: Opcode, arguments: bytes = b"") -> bytes:
        """Send a request and return the data of its reply; repeat it while the firmware is not ready."""
        for tries_left in range(READY_TRIES - 1, -1, -1):
            request_id, request = self._encode(opcode, arguments)
            self._send(request)
            try:
                return self._receive(opcode, request_id)
            except FirmwareRefusalError as refusal:
                if refusal.code != messages.NOT_READY or not tries_left:
                    raise
            self._clock.sleep(READY_PAUSE)
        raise AssertionError("the loop above returns or raises")

    def _encode(self, opcode: Opcode, arguments: bytes) -> tuple[int, bytes]:
        request_id = self._next_id
        self._next_id = (request_id + 1) & 0xFFFF
        return request_id, messages.encode_request(opcode, request_id, arguments)

    def _send(self, request: bytes) -> None:
        for tries_left in range(SEND_TRIES - 1, -1, -1):
            try:
                self._link.send(REQUEST, data=request)
                return
            except (UsbStallError, UsbTimeoutError):
                if not tries_left:
                    raise
            self._clock.sleep(SEND_PAUSE)

    def _receive(self, opcode: Opcode, request_id: int) -> bytes:
        end = self._clock.now() + self._timeout
        while True:
            reply = self._fetch(end)
            while reply and len(reply) < messages.reply_length(reply) and (more := self._fetch_more()):
                reply += more
            try:
                return messages.decode_reply(reply, opcode, request_id, self._where)
            except messages.StaleReplyError:
                if self._clock.now() >= end:
                    raise

    def _fetch(self, end: float) -> bytes:
        """Return the first packet of a reply; a stall or an empty packet means that the reply is not ready."""
        while True:
            stall: UsbStallError | None = None
            try:
                packet = self._link.receive(messages.LARGEST_PACKET, REQUEST)
            except UsbStallError as error:
                packet, stall = b"", error
            if packet:
                return packet
            if self._clock.now() >= end:
                raise stall or UsbTimeoutError(
                    f"no answer in {self._timeout:g} s", where=self._where, advice="replug the sensor"
                )
            self._clock.sleep(REPLY_PAUSE)

    def _fetch_more(self) -> bytes:
        try:
            return self._link.receive(messages.LARGEST_PACKET, REQUEST)
        except (UsbStallError, UsbTimeoutError):
            return b""


def wait_until_answering(
    find: Callable[[], UsbLink | None],
    *,
    limit_s: float = 20.0,  # our choice: a reboot takes seconds
    clock: Clock | None = None,
) -> float | None:
    """Return the time [s] until the sensor that `find` returns answers, or None if it exceeds the limit.

    `find` returns a fresh link, or None while the sensor is not on the bus.
    """
    clock = clock or Clock()
    start = clock.now()
    while (waited := clock.now() - start) < limit_s:
        clock.sleep(0.5)  # s; a reboot takes seconds
        link = None
        try:
            link = find()
            if link is not None:
                Ps1080(link, timeout_s=1.0, clock=clock).keep_alive()
                return clock.now() - start
        except UsbAccessError:
            if waited > limit_s / 2:  # udev needs a moment to apply its rules to a device that reappeared
                raise
        except FirmwareError:
            continue
        finally:
            if link is not None:
                link.close()
    return None
