"""Parse the parameter section of a C3D file (https://www.c3d.org, user guide), and its numbers in their byte orders.

The section begins with four bytes: two unused ones, the number of its blocks, and the processor. Then come groups and
parameters, each as

    length of the name (negative: locked), number of the group (negative: the group itself), name,
    bytes from here to the next (0: it is the last), and of a parameter: kind (-1: text, 1, 2 and 4: bytes of a number),
    number of its dimensions, the dimensions, the values with the first dimension fastest, a description

The file states no encoding. Text is read as UTF-8, or as Windows-1252 where it is not valid UTF-8.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from formats.arrays import Floats, Singles

INTEL, DEC, SGI = 84, 85, 86  # numbers of the processors, C3D user guide, parameter section
SECTION_HEAD = 4  # bytes; C3D user guide
TEXT, BYTE, SHORT, FLOAT = -1, 1, 2, 4  # kinds; C3D user guide: kinds of a parameter
SIGN, LEAST_NORMAL = np.uint32(1 << 31), np.uint32(1 << 23)  # bits of a float: IEEE 754, 32 bits
QUARTER = 2  # steps of the exponent in a quarter
USED = {"POINT", "TRIAL"}  # groups whose parameters must be well-formed; errors in others are ignored


class NoParametersError(ValueError):
    """The parameter section is malformed."""


def numbers_of(raw: bytes, kind: int, processor: int) -> Singles:
    """Return the numbers in `raw`; incomplete numbers at its end are ignored.

    A DEC float is four times the IEEE float, and its 16-bit halves are exchanged.
    A subnormal float, which only bytes in another order show, becomes the least normal one. Some libraries, among them
    Taichi, let the processor take subnormal numbers for zero, and a zero would mean that the file states no number.
    """
    order = ">" if processor == SGI else "<"
    whole = raw[: len(raw) // abs(kind) * abs(kind)]
    if kind == FLOAT and processor == DEC:
        halves = np.frombuffer(whole, "<u2").reshape(-1, 2)[:, ::-1]
        quadrupled = _without_subnormals(np.ascontiguousarray(halves).view("<u4").ravel(), QUARTER)
        with np.errstate(invalid="ignore"):  # a damaged number is no number, and needs no warning
            return quadrupled * np.float32(0.25)
    if kind == FLOAT:
        return _without_subnormals(np.frombuffer(whole, f"{order}u4"))
    dtype = {SHORT: f"{order}i2", BYTE: "u1"}[kind]
    return np.frombuffer(whole, dtype).astype(np.float32)


def _without_subnormals(bits: NDArray[np.uint32], spare: int = 0) -> Singles:
    """Return the floats of these bits, (numbers,); subnormal ones become the least normal float of their sign.

    spare: steps of the exponent by which the floats stay above that, so that they can be divided
    """
    size = bits & ~SIGN
    is_below = (size < (spare + 1) * LEAST_NORMAL) & (size != 0)
    kept = np.where(is_below, (bits & SIGN) | ((spare + 1) * LEAST_NORMAL), bits)
    return kept.astype(np.uint32).view(np.float32)


def text_of(raw: bytes) -> str:
    """Return a text without padding spaces and zeros; undecodable bytes become escape codes.

    A zero within ends the text, as in C; programs leave other bytes behind it.
    """
    raw = raw.lstrip(b" \0\t\r\n").partition(b"\0")[0]
    for encoding in ("utf-8", "cp1252"):
        try:
            text = raw.decode(encoding)
            break
        except UnicodeDecodeError:
            continue
    else:
        text = raw.decode("ascii", "backslashreplace")
    return text.strip(" \0\t\r\n")


class Parameters:
    """Parameters by group and name, both in capital letters."""

    def __init__(self, section: bytes, processor: int | None = None) -> None:
        """Parse a section, (bytes,), from its first byte on.

        - `processor`: code of the byte order, the section's own unless given

        Raises:
            NoParametersError: the section, or a parameter in a group of `USED`, is malformed.
        """
        stated = section[3] if len(section) >= SECTION_HEAD else 0
        self.processor = stated if processor is None else processor
        self._order = ">" if self.processor == SGI else "<"
        groups: dict[int, str] = {}
        found: dict[tuple[int, str], tuple[int, list[int], bytes] | None] = {}
        differ: set[tuple[int, str]] = set()
        at = self.end = SECTION_HEAD  # behind the values of the last record [bytes]
        while at + 2 <= len(section) and section[at] and section[at + 1]:
            length, group = abs(_signed(section[at])), _signed(section[at + 1])
            name, offset_at = text_of(section[at + 2 : at + 2 + length]).upper(), at + 2 + length
            offset = self._whole(section, offset_at)
            self.end = max(offset_at + 2, 0 if group < 0 else _end_of(section, offset_at + 2))
            if group < 0:
                groups[-group] = name
            else:
                value = _parameter(section, offset_at + 2)
                if found.setdefault((group, name), value) != value:
                    differ.add((group, name))
                found[group, name] = value
            if not offset:
                break
            at = self._next(section, offset_at, offset, is_group=group < 0)
        self._found = {}
        self.differ = {(groups.get(group, ""), name) for group, name in differ}  # in the file twice, with two values
        for (group, name), value in found.items():
            if value is not None:
                self._found[groups.get(group, ""), name] = value
            elif groups.get(group) in USED:
                raise NoParametersError

    def _next(self, section: bytes, offset_at: int, offset: int, *, is_group: bool) -> int:
        """Return where the next record begins: where this one points, or ends if no record is where it points.

        Programs that remove or lengthen a parameter may leave the old offset.
        """
        if self._is_record(section, stated := offset_at + offset):
            return stated
        behind = offset_at + 2 if is_group else _end_of(section, offset_at + 2)
        ended = behind + 1 + section[behind] if 0 < behind < len(section) else stated
        return ended if self._is_record(section, ended) else stated

    def _is_record(self, section: bytes, at: int) -> bool:
        """Return whether a record begins at an offset: a printable name, and an offset within the section."""
        if at + 2 > len(section) or not section[at] or not section[at + 1]:
            return False
        offset_at = at + 2 + abs(_signed(section[at]))
        name = section[at + 2 : offset_at]
        if offset_at + 2 > len(section) or not (name.isascii() and name.decode("ascii").isprintable()):
            return False
        return offset_at + self._whole(section, offset_at) <= len(section)

    def _whole(self, section: bytes, at: int) -> int:
        if at + 2 > len(section):
            raise NoParametersError
        return int.from_bytes(section[at : at + 2], "big" if self._order == ">" else "little")

    def has(self, group: str) -> bool:
        """Return whether the file has any parameter of a group."""
        return any(one == group for one, _ in self._found)

    def numbers(self, group: str, name: str) -> Floats:
        """Return the numbers of a parameter, an empty array where the file lacks it."""
        kind, _, raw = self._found.get((group, name), (BYTE, [], b""))
        return np.zeros(0) if kind == TEXT else numbers_of(raw, kind, self.processor).astype(float)

    def texts(self, group: str, name: str) -> list[str]:
        """Return the texts of a parameter; an empty list where the file has no such parameter."""
        kind, sides, raw = self._found.get((group, name), (BYTE, [], b""))
        if kind != TEXT or not raw:
            return []
        width = sides[0] if sides else 1
        return [text_of(raw[at : at + width]) for at in range(0, len(raw), width)]


def _end_of(section: bytes, at: int) -> int:
    """Return the offset behind the values of the parameter that begins at an offset, 0 if it is malformed."""
    found = _parameter(section, at)
    return at + 2 + len(found[1]) + len(found[2]) if found else 0


def _parameter(section: bytes, at: int) -> tuple[int, list[int], bytes] | None:
    """Return kind, dimensions and bytes of the parameter that begins at an offset; None if it is malformed."""
    if at + 2 > len(section):
        return None
    kind, count = _signed(section[at]), section[at + 1]
    sides, begin = list(section[at + 2 : at + 2 + count]), at + 2 + count
    size = abs(kind) * math.prod(sides)
    if kind not in (TEXT, BYTE, SHORT, FLOAT) or begin + size > len(section):
        return None
    return kind, sides, section[begin : begin + size]


def _signed(byte: int) -> int:
    return byte - 256 if byte > 127 else byte
