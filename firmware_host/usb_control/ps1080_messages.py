"""The PS1080 host protocol: the layout of requests and replies, firmware 3.0 and later.

    request   u16 magic 0x4D47, u16 words of arguments, u16 opcode, u16 id, then the arguments
    reply     u16 magic 0x4252, u16 words that follow the id, u16 opcode, u16 id, u16 error, then the data

All numbers are little-endian.

Source: OpenNI2, `Source/Drivers/PS1080/Sensor/XnHostProtocol.h` (magics, opcodes, modes, error codes) and
`XnHostProtocol.cpp` (sizes and checks). OpenNI2's own driver accepts a device that answers like this.
"""

from __future__ import annotations

import struct
from enum import IntEnum

from firmware_host.errors import FirmwareRefusalError, FirmwareReplyError
from firmware_host.usb_control.link import UPDATE_ADVICE

REQUEST_MAGIC = 0x4D47  # XN_HOST_MAGIC_26
REPLY_MAGIC = 0x4252  # XN_FW_MAGIC_26
OLD_REPLY_MAGIC = 0x5350  # XN_FW_MAGIC_25: firmware before 1.2, with a checksum in the header
MESSAGE_HEADER = struct.Struct("<HHHH")  # XnHostProtocolHeaderV26
ERROR = struct.Struct("<H")  # XnHostProtocolReplyHeader
LARGEST_PACKET = 512  # bytes, XN_PROTOCOL_MAX_PACKET_SIZE_V5_0
UNKNOWN_COMMAND, NOT_READY = 2, 13  # NACK_INVALID_COMMAND, NACK_NOT_READY


class Opcode(IntEnum):
    """Requests, EPsProtocolOpCodes."""

    GET_VERSION = 0
    KEEP_ALIVE = 1
    GET_PARAMETER = 2
    SET_PARAMETER = 3
    GET_FIXED_PARAMETERS = 4
    GET_MODE = 5
    SET_MODE = 6
    GET_LOG = 7
    GET_CPU_STATISTICS = 27
    GET_SERIAL_NUMBER = 37
    GET_PLATFORM_STRING = 39
    SET_LED_STATE = 41
    ENABLE_EMITTER = 42


class Mode(IntEnum):
    """The modes of SET_MODE, XnHostProtocolModeType."""

    SOFT_RESET = 3
    REBOOT = 4


REFUSALS = {  # XnHostProtocolNacks
    1: "an unknown error",
    UNKNOWN_COMMAND: "the command is unknown",
    3: "the request's checksum is wrong",
    4: "the request's size is wrong",
    5: "the parameters are wrong",
    6: "its I2C bus failed",
    7: "the file is not there",
    8: "the file cannot be made",
    9: "the file cannot be written",
    10: "the file cannot be deleted",
    11: "the file cannot be read",
    12: "the command's size is wrong",
    NOT_READY: "the firmware is not ready",
    14: "the firmware's buffer ran over",
    15: "its overlay is not loaded",
    16: "its file system is locked",
}


REFUSAL_ADVICE = {  # where plugging in anew does not help
    UNKNOWN_COMMAND: UPDATE_ADVICE,
    NOT_READY: "wait for some seconds and try again",
}


class StaleReplyError(FirmwareReplyError):
    """A complete reply to an earlier request; the right one may still follow."""


def encode_request(opcode: Opcode, request_id: int, arguments: bytes = b"") -> bytes:
    """Return the bytes of a request; `arguments` are whole 16-bit words."""
    if len(arguments) % 2 or MESSAGE_HEADER.size + len(arguments) > LARGEST_PACKET:
        raise ValueError(f"{len(arguments)} bytes of arguments are no whole words or do not fit a packet")
    return MESSAGE_HEADER.pack(REQUEST_MAGIC, len(arguments) // 2, opcode, request_id) + arguments


def reply_length(start: bytes) -> int:
    """Return the length [bytes] that a reply's header states, header included; 0 if the header is incomplete."""
    return (
        MESSAGE_HEADER.size + 2 * int(MESSAGE_HEADER.unpack_from(start)[1]) if len(start) >= MESSAGE_HEADER.size else 0
    )


def decode_reply(reply: bytes, opcode: Opcode, request_id: int, where: str) -> bytes:
    """Return the data of a whole reply.

    Raises:
        FirmwareReplyError: the reply is short, malformed or (StaleReplyError) to another request.
        FirmwareRefusalError: the firmware refuses.
    """
    advice = "unplug the sensor and plug it in again"
    if len(reply) < MESSAGE_HEADER.size:
        raise FirmwareReplyError(f"the answer has {len(reply)} bytes and no header", where=where, advice=advice)
    magic, words, answered, answered_id = MESSAGE_HEADER.unpack_from(reply)
    if magic == OLD_REPLY_MAGIC:
        raise FirmwareReplyError(
            "its firmware is older than 3.0 and speaks another protocol",
            where=where,
            advice=UPDATE_ADVICE,
        )
    if magic != REPLY_MAGIC:
        raise FirmwareReplyError(f"the answer starts with 0x{magic:04x}, not 0x4252", where=where, advice=advice)
    if answered_id != request_id:
        raise StaleReplyError(f"the answer is to request {answered_id}, not {request_id}", where=where, advice=advice)
    if answered != opcode:
        raise FirmwareReplyError(f"the answer is to command {answered}, not {int(opcode)}", where=where, advice=advice)
    whole = reply_length(reply)
    if words < 1 or len(reply) < whole:
        raise FirmwareReplyError(
            f"the answer has {len(reply)} of {max(whole, MESSAGE_HEADER.size + ERROR.size)} bytes",
            where=where,
            advice=advice,
        )
    (code,) = ERROR.unpack_from(reply, MESSAGE_HEADER.size)
    if code:
        meaning = REFUSALS.get(code, "an error that is not documented")
        raise FirmwareRefusalError(
            f"the firmware refuses command {opcode.name}: {meaning} (error {code})", code=code, where=where,
            advice=REFUSAL_ADVICE.get(code, advice),
        )  # fmt: skip
    return reply[MESSAGE_HEADER.size + ERROR.size : whole]
