"""Decode a PS1080's answers: versions, the factory's measurements, processor times, the log.

All numbers are little-endian.

Source: OpenNI2, `Source/Drivers/PS1080/Sensor/`: `XnHostProtocol.cpp` (versions, strings, log entries),
`XnDeviceSensor.h` (XnFixedParams), `XnFirmwareTypes.h` (XnTaskCPUInfo). Lengths among the fixed parameters are in
centimetres: `DDK/XnShiftToDepth.cpp` makes millimetres of them with a factor of 10.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from firmware_host.errors import FirmwareReplyError
from firmware_host.usb_control.link import REPLUG_ADVICE

_VERSION = struct.Struct("<BBHIHH")  # XnVersions without the host's own part; minor before major on the wire
CHIPS = {0x00101010: "PS1000", 0x00202020: "PS1080", 0x00212020: "PS1080 A6"}  # XN_CHIP_VER_*


@dataclass(frozen=True, kw_only=True)
class FirmwareVersion:
    """Versions of firmware, chip, gate array and system."""

    major: int
    minor: int
    build: int
    chip: int
    fpga: int
    system: int

    @property
    def number(self) -> tuple[int, int, int]:
        """For comparing: major, minor, build."""
        return self.major, self.minor, self.build

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.build}"

    @property
    def chip_name(self) -> str:
        """The chip's name, or its number."""
        return CHIPS.get(self.chip, f"chip 0x{self.chip:08x}")


def decode_version(data: bytes, where: str) -> FirmwareVersion:
    """Read the answer to GET_VERSION."""
    minor, major, build, chip, fpga, system = _unpack(_VERSION, data, where)
    if major >= 5:
        build = _decimal_of_hexadecimal(build)  # in decimal digits: 0x22 is build 22
    return FirmwareVersion(major=major, minor=minor, build=build, chip=chip, fpga=fpga, system=system)


def _decimal_of_hexadecimal(number: int) -> int:
    digits = f"{number:x}"
    return int(digits) if digits.isdecimal() else number


FIXED_PARAMETERS_SIZE = 168  # bytes, sizeof(XnFixedParams)
REFERENCE_WIDTH = 1280  # px: 120 cm / 0.1042 cm is 1151.6 px, twice the 575.8 px that OpenNI takes at 640 px
_GEOMETRY = struct.Struct("<4f")  # at byte 92: emitter and colour camera distance, reference distance and pixel size
_GEOMETRY_AT = 92  # bytes, as above
_WATCHDOG = struct.Struct("<ii")  # at byte 0: serial number, watchdog time


@dataclass(frozen=True, kw_only=True)
class FixedParameters:
    """The factory's measurements of this one sensor.

    - `serial`: a separate number, not the sensor's serial number, which has its own request
    - `watchdog`: timeout of the firmware's watchdog, in the firmware's unit
    - `emitter_baseline_m` [m]: depth camera to emitter
    - `colour_baseline_m` [m]: depth camera to colour camera
    - `reference_distance_m` [m]: of the plane on which the reference pattern was taken
    - `reference_pixel_m` [m]: width on that plane of a pixel of the depth image, 1280 px wide
    """

    serial: int
    watchdog: int
    emitter_baseline_m: float
    colour_baseline_m: float
    reference_distance_m: float
    reference_pixel_m: float

    def focal_length(self, width: int) -> float:
        """Return the depth camera's focal length [px] in an image of this width [px]; 0 if unknown."""
        if self.reference_pixel_m <= 0:
            return 0.0
        return self.reference_distance_m / self.reference_pixel_m * width / REFERENCE_WIDTH


def decode_fixed_parameters(data: bytes, where: str) -> FixedParameters:
    """Decode the block of fixed parameters."""
    if len(data) < FIXED_PARAMETERS_SIZE:
        raise FirmwareReplyError(
            f"fixed parameters have {len(data)} of {FIXED_PARAMETERS_SIZE} bytes", where=where, advice=REPLUG_ADVICE
        )
    serial, watchdog = _WATCHDOG.unpack_from(data)
    emitter, colour, distance, pixel = _GEOMETRY.unpack_from(data, _GEOMETRY_AT)
    return FixedParameters(
        serial=serial, watchdog=watchdog, emitter_baseline_m=emitter / 100, colour_baseline_m=colour / 100,
        reference_distance_m=distance / 100, reference_pixel_m=pixel / 100,
    )  # fmt: skip


_TASK = struct.Struct("<II")  # XnTaskCPUInfo


@dataclass(frozen=True, kw_only=True)
class TaskTime:
    """The number of runs of one task of the firmware, and their time in all [s]."""

    runs: int
    seconds: float


def decode_cpu_statistics(data: bytes) -> list[TaskTime]:
    """Read the answer to GET_CPU_STATISTICS: one entry for each task, in the firmware's order."""
    whole = data[: len(data) // _TASK.size * _TASK.size]
    return [TaskTime(runs=runs, seconds=1e-6 * micro) for runs, micro in _TASK.iter_unpack(whole)]


def decode_text(data: bytes) -> str:
    """Decode a string; some firmware puts a zero byte after each character, some pads with zero bytes."""
    return data.replace(b"\0", b"").decode("ascii", errors="replace").strip()


_LOG_ENTRY = struct.Struct("<HIH")  # XnLogEntryHeader: words of data, time, type
_LOG_NUMBERS = struct.Struct("<HI")  # XnLogDefaultData: line, parameter
_LOG_TEXTS = {0x1000, 0x1200, 0x5400}  # XN_LOG_TEXT_MESSAGE_V1_2, V3_0 and V4_0, V5_0
_LOG_OVERFLOWS = {0x1001, 0x1201, 0x5401}  # XN_LOG_OVERFLOW_*


def decode_log(data: bytes) -> list[str]:
    """Return the log's lines, each after the firmware's timestamp; a truncated last entry is omitted."""
    lines, position = [], 0
    while position + _LOG_ENTRY.size <= len(data):
        words, stamp, kind = _LOG_ENTRY.unpack_from(data, position)
        body = data[position + _LOG_ENTRY.size : position + _LOG_ENTRY.size + 2 * words]
        position += _LOG_ENTRY.size + 2 * words
        if kind in _LOG_TEXTS:
            lines.append(f"{stamp}: {decode_text(body)}")
        elif kind in _LOG_OVERFLOWS:
            lines.append(f"{stamp}: entries were lost here, the log had run full")
        elif len(body) >= _LOG_NUMBERS.size:
            line, parameter = _LOG_NUMBERS.unpack_from(body)
            lines.append(
                f"{stamp}: module 0x{kind >> 8:x}, error 0x{kind & 0xFF:x}, parameter 0x{parameter:x}, line {line}"
            )
    return lines


def _unpack(layout: struct.Struct, data: bytes, where: str) -> tuple[int, ...]:
    if len(data) < layout.size:
        raise FirmwareReplyError(
            f"the answer has {len(data)} of {layout.size} bytes of data", where=where, advice=REPLUG_ADVICE
        )
    return layout.unpack_from(data)
