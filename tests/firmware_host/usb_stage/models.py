"""Models of a PS1080 and a Kinect's base: their answers to control transfers, and their faults.

The standard library only: the distribution's Python runs this too, behind umockdev.

A fault is a word: `stall`, `timeout`, `short` (half of the reply's header), `cut` (a whole header, half of the data),
`magic`, `stale` (an answer to an earlier request comes first), `busy` (not ready the first time), `slow` (three stalls
before the reply), `split` (the reply comes in two packets), `refuse`, `old` (firmware 5.3), `unplug` (away before the
request), `unplug-late` (away between request and reply).
"""

from __future__ import annotations

import struct

VENDOR_OUT, VENDOR_IN = 0x40, 0xC0
REPLY_MAGIC = 0x4252
SERIAL, PLATFORM = b"1401160123", b"ARM"


class StallError(Exception):
    """The model refuses the transfer."""


class SilenceError(Exception):
    """The model never answers the transfer."""


class GoneError(Exception):
    """The model is no longer on the bus."""


def fixed_parameters() -> bytes:
    """The block of 168 bytes with the values that a real sensor has, in centimetres."""
    block = bytearray(168)
    struct.pack_into("<ii", block, 0, 77, 5000)
    struct.pack_into("<i", block, 76, 1)  # nImageCmosType: there is a colour camera
    struct.pack_into("<4f", block, 92, 7.5, 2.3, 120.0, 0.1042)
    return bytes(block)


def log_block() -> bytes:
    """A text, an overflow and a numbered error."""
    text = b"".join(bytes([letter, 0]) for letter in b"emitter on")
    entries = [(0x5400, 12, text), (0x5401, 13, b""), (0x0203, 14, struct.pack("<HI", 321, 9))]
    return b"".join(struct.pack("<HIH", len(body) // 2, stamp, kind) + body for kind, stamp, body in entries)


class Ps1080Model:
    """Firmware 5.8.22, or 5.3.29 with the fault `old`."""

    vendor, product, serial = 0x1D27, 0x0600, SERIAL.decode()

    def __init__(self, fault: str = "") -> None:
        self.fault, self.asked = fault, []  # type: ignore[var-annotated]
        self.packets: list[bytes] = []
        self.patience = 3 if fault == "slow" else 0
        self.log = log_block()
        self.led: tuple[int, ...] | None = None
        self.emitter: int | None = None
        self.mode: int | None = None

    def control(self, kind: int, request: int, value: int, data: bytes, length: int) -> bytes:
        """Answer one control transfer; for an outgoing one the answer is empty."""
        if self.fault == "unplug":
            raise GoneError
        if kind == VENDOR_OUT and request == 0 and value == 0:
            if self.fault == "stall":
                raise StallError
            self._take(data)
            return b""
        if kind == VENDOR_IN and request == 0:
            if self.fault == "unplug-late":
                raise GoneError
            if self.fault == "timeout":
                raise SilenceError
            if self.patience:
                self.patience -= 1
                raise StallError
            return self.packets.pop(0)[:length] if self.packets else b""
        raise StallError

    def _take(self, request: bytes) -> None:
        magic, words, opcode, number = struct.unpack_from("<HHHH", request)
        arguments = request[8 : 8 + 2 * words]
        self.asked.append(opcode)
        error, data = (3, b"") if magic != 0x4D47 or len(request) != 8 + 2 * words else self._answer(opcode, arguments)
        if self.fault == "refuse":
            error, data = 5, b""
        if self.fault == "busy" and len(self.asked) == 1:
            error, data = 13, b""
        body = struct.pack("<H", error) + data
        start = 0x1234 if self.fault == "magic" else REPLY_MAGIC
        reply = struct.pack("<HHHH", start, len(body) // 2, opcode, number) + body
        if self.fault == "stale":
            self.packets.append(struct.pack("<HHHHH", REPLY_MAGIC, 1, opcode, (number - 1) & 0xFFFF, 0))
        if self.fault == "short":
            reply = reply[:4]
        elif self.fault == "cut":
            reply = reply[: 10 + len(data) // 2]
        cuts = [reply[:10], reply[10:]] if self.fault == "split" else [reply]
        self.packets += [cut for cut in cuts if cut]

    def _answer(self, opcode: int, arguments: bytes) -> tuple[int, bytes]:
        words = struct.unpack(f"<{len(arguments) // 2}H", arguments)
        if opcode == 0:
            minor, build = (3, 0x29) if self.fault == "old" else (8, 0x22)
            return 0, struct.pack("<BBHIHH", minor, 5, build, 0x00212020, 6, 0x1234)
        if opcode == 4:
            return 0, fixed_parameters()[4 * words[0] :][:100]
        if opcode == 7:
            piece, self.log = self.log[:24], self.log[24:]
            return 0, piece
        if opcode == 27:
            return 0, struct.pack("<4I", 10, 2_000_000, 30, 500_000)
        if opcode == 37:
            return 0, SERIAL.ljust(16, b"\0")
        if opcode == 39:
            return 0, b"".join(bytes([letter, 0]) for letter in PLATFORM)
        if opcode == 6:
            self.mode = words[0]
        elif opcode == 41:
            self.led = words
        elif opcode == 42:
            self.emitter = words[0]
        elif opcode not in (1, 3):
            return 2, b""
        return 0, b""


class KinectMotorModel:
    """A Kinect's foot, its head tilted up by 30 degrees: y 819 cos 30 = 709, z 819 sin 30 = 410 counts."""

    vendor, product, serial = 0x045E, 0x02B0, ""

    def __init__(self, fault: str = "") -> None:
        self.fault, self.counts = fault, (0, 709, 410)
        self.led: int | None = None
        self.tilt, self.status = 60, 0

    def control(self, kind: int, request: int, value: int, data: bytes, length: int) -> bytes:
        """Answer one control transfer; for an outgoing one the answer is empty."""
        if self.fault in ("unplug", "unplug-late"):
            raise GoneError
        if self.fault == "timeout":
            raise SilenceError
        if self.fault == "stall":
            raise StallError
        if (kind, request) == (VENDOR_OUT, 0x06):
            self.led = value
        elif (kind, request) == (VENDOR_OUT, 0x31):
            self.tilt = value - 0x10000 if value & 0x8000 else value
        elif (kind, request) == (VENDOR_IN, 0x32):
            state = b"\0\0" + struct.pack(">hhhbB", *self.counts, self.tilt, self.status)
            return state[: 4 if self.fault == "short" else length]
        else:
            raise StallError
        return b""


class KinectCameraModel:
    """The Kinect's depth camera, which receives no requests here."""

    vendor, product, serial = 0x045E, 0x02AE, "A00364A01234567A"

    def __init__(self, fault: str = "") -> None:
        self.fault = fault

    def control(self, kind: int, request: int, value: int, data: bytes, length: int) -> bytes:
        """Refuse everything."""
        raise StallError


def string_descriptor(text: str, value: int) -> bytes:
    """Answer GET_DESCRIPTOR for the list of languages (number 0) and for a text."""
    body = b"\x09\x04" if value & 0xFF == 0 else text.encode("utf-16-le")
    return bytes([2 + len(body), 3]) + body
