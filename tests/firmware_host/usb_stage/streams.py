"""A streaming PS1080: the answers to OpenNI2's driver when it opens the sensor, and packets of depth and colour.

    packet    u16 magic 0x4252, u16 kind, u16 number, u16 length (big-endian, header included), u32 time, then data
    depth     11 bits a pixel, 8 values in 11 bytes, highest bit first: shifts, which the driver turns into millimetres
    colour    two pixels in four bytes: U, Y, V, Y

The first packet of a frame carries padding counts instead of the time. Source: OpenNI2,
`Source/Drivers/PS1080/Sensor/` (XnDeviceSensorProtocol.h and the processors); found by answering the driver.
The standard library only, like `models.py`.
"""

from __future__ import annotations

import struct

from models import Ps1080Model  # beside this file: the distribution's Python runs it from here

SIZES = {0: (320, 240), 1: (640, 480)}  # by the firmware's number of a resolution, QVGA and VGA
RESOLUTION = {0x81: 19, 0x82: 13}  # parameter that holds it, by endpoint
MIRROR = {0x81: 23, 0x82: 71}
FPS = 30
TICKS = 60_000_000  # a second
SHIFT = 800  # of the whole picture: 10 (m 120 / (7.5 - m) + 120) = 1193 mm with m = 0.1042 (-0.375), see models.py
DEPTH, COLOUR = 0x81, 0x82  # endpoints
KINDS = {DEPTH: (0x7100, 0x7200, 0x7500), COLOUR: (0x8100, 0x8200, 0x8500)}  # start, middle, end of a frame
PIECE = 8184  # bytes of data in a packet: whole groups of 11 and of 4
MARKERS = (  # the first two of OpenCV's DICT_4X4_50, 1 is white, rows from the top
    ((1, 0, 1, 1), (0, 1, 0, 1), (0, 0, 1, 1), (0, 0, 1, 0)),
    ((0, 0, 0, 0), (1, 1, 1, 1), (1, 0, 0, 1), (1, 0, 1, 0)),
)
CELL = 5  # px


def depth_picture(width: int, height: int) -> bytes:
    """The same shift everywhere."""
    group = 0
    for _ in range(8):
        group = group << 11 | SHIFT
    return group.to_bytes(11, "big") * (width * height // 8)


def colour_picture(width: int, height: int, is_mirrored: bool) -> bytes:
    """A white wall with two markers on it."""
    light = bytearray([235]) * (width * height)
    for place, bits in enumerate(MARKERS):
        left, top = 60 + 120 * place, 90
        for row in range(6 * CELL):
            for column in range(6 * CELL):
                i, j = row // CELL - 1, column // CELL - 1
                is_white = 0 <= i < 4 and 0 <= j < 4 and bits[i][j]
                across = left + column
                light[(top + row) * width + (width - 1 - across if is_mirrored else across)] = 235 if is_white else 16
    return b"".join(b"\x80" + light[i : i + 1] + b"\x80" + light[i + 1 : i + 2] for i in range(0, len(light), 2))


class StreamingPs1080Model(Ps1080Model):
    """Streams once the driver has switched it on; faults: `no-frames`, and `pulled` after twenty frames."""

    def __init__(self, fault: str = "") -> None:
        super().__init__(fault)
        self.parameters: dict[int, int] = {}
        self.pictures: dict[tuple[int, ...], bytes] = {}
        self.waiting: dict[int, list[bytes]] = {DEPTH: [], COLOUR: []}
        self.numbers = {DEPTH: 0, COLOUR: 0}
        self.frames = 0

    def _answer(self, opcode: int, arguments: bytes) -> tuple[int, bytes]:
        words = struct.unpack(f"<{len(arguments) // 2}H", arguments)
        if opcode == 3:
            self.parameters.update(zip(words[::2], words[1::2], strict=True))
            return 0, b""
        if opcode == 2:
            return 0, struct.pack("<H", self.parameters.get(words[0], 0))
        if opcode in (5, 40):  # mode: PS; USB core: the first
            return 0, struct.pack("<H", 1 if opcode == 5 else 0)
        if opcode == 22:  # algorithm parameters
            kind, offset = words[0], 2 * words[4]
            sizes = {0x02: 116, 0x03: 6, 0x06: 16, 0x07: 256}
            blocks = {0x00: struct.pack("<H", 200), 0x80: struct.pack("<f", TICKS / 1e6)}
            return 0, blocks.get(kind, bytes(sizes.get(kind, 0)))[offset : offset + 256]
        if opcode in (10, 33, 34):
            return 0, b""
        if opcode == 36:  # presets as (format, resolution, rate); 5 is uncompressed YUV422, 0, 1, 3 are depth formats
            formats = (5,) if words[0] == 0 else (0, 1, 3)
            return 0, b"".join(struct.pack("<HHH", kind, size, FPS) for size in (0, 1) for kind in formats)
        return super()._answer(opcode, arguments)

    @property
    def is_pulled(self) -> bool:
        """Return whether the model was unplugged."""
        return self.fault == "pulled" and self.frames > 20 and self.is_on(DEPTH)

    def is_on(self, endpoint: int) -> bool:
        """Whether the driver has switched this stream on: parameters 5 and 6 are the modes of colour and depth."""
        return bool(self.parameters.get(6 if endpoint == DEPTH else 5, 0))

    def picture(self, endpoint: int) -> bytes:
        """Return the stream's image at its resolution, mirrored if requested; cached."""
        size, mirror = self.parameters.get(RESOLUTION[endpoint], 0), self.parameters.get(MIRROR[endpoint], 0)
        key = (endpoint, size, mirror)
        if key not in self.pictures:
            width, height = SIZES[size]
            self.pictures[key] = (
                depth_picture(width, height) if endpoint == DEPTH else colour_picture(width, height, bool(mirror))
            )
        return self.pictures[key]

    def tick(self) -> None:
        """Advance by 1/30 s: queue the packets of a frame, unless the host is behind."""
        if self.fault == "no-frames" or any(len(packets) > 2 for packets in self.waiting.values()):
            return
        self.frames += self.is_on(DEPTH)
        stamp = self.frames * TICKS // FPS & 0xFFFFFFFF
        for endpoint in KINDS:
            if self.is_on(endpoint):
                picture = self.picture(endpoint)
                cuts = [picture[i : i + PIECE] for i in range(0, len(picture), PIECE)]
                for place, cut in enumerate(cuts):
                    self._queue(endpoint, 0 if place == 0 else 2 if place == len(cuts) - 1 else 1, stamp, cut)

    def _queue(self, endpoint: int, part: int, stamp: int, data: bytes) -> None:
        number = self.numbers[endpoint]
        self.numbers[endpoint] = number + 1 & 0xFFFF
        header = struct.pack("<HHH", 0x4252, KINDS[endpoint][part], number) + struct.pack(">H", 12 + len(data))
        self.waiting[endpoint].append(header + struct.pack("<I", stamp if part else 0) + data)

    def read(self, endpoint: int, length: int) -> bytes | None:
        """Return the endpoint's data for a transfer of this length, None if there are none."""
        packets = self.waiting.get(endpoint, [])
        data = b""
        while packets and len(data) + len(packets[0]) <= length:
            data += packets.pop(0)
        return data or None
