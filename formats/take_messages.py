"""Sort the messages of an archive by take and kind, with a size limit for each kind. See `formats/SPEC.md`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import msgpack

from formats.take_writer import MOST_HEADER_BYTES, binding_of

MOST_CONTAINERS = 60_000  # maps and lists of a header: 2000 points have 6000; ten hours lack 18,000 spans at most
# Limits of another message, which has a map of at most 17 entries, and a list of two.
FEW_CONTAINERS, FEW_ENTRIES, LONGEST_LIST = 16, 64, 2
FORMAT_KEY = b"\xa6format"  # in msgpack
HEADERS_FORMAT, HEADERS_START = b"hangtime-take/", 64  # within so many first bytes of a header: writers begin with it
FORMAT_1 = FORMAT_KEY + b"\xafhangtime-take/1"
# Placeholders for the hash of a header that has not come yet, and of a header that is lost.
NO_HEADER, LOST_HEADER = b"none", b"lost"
# The fields of blocks, scans and ends that a reader uses, in both versions. Others would take twenty times their bytes.
FIELDS = {
    "take", "first", "frames", "start", "steps", "table", "surface", "grid_size", "contour_size", "grid", "contour",
    "blocks", "scans", "from", "until", "time", "state", "quality", "pitch", "pitch_valid", "markers", "markers_valid",
    "held", "held_sd", "held_valid", "points", "points_sd", "points_valid", "points_hidden", "grid_valid",
    "contour_valid",
}  # fmt: skip


NOT_UNPACKED = (ValueError, msgpack.exceptions.UnpackException, RecursionError)


class Message(dict[str, Any]):
    """The content of a message, and its share of the file [bytes]."""

    __slots__ = ("own",)

    def __init__(self, content: dict[str, Any], own: int) -> None:
        super().__init__({name: content[name] for name in content.keys() & FIELDS})
        self.own = own


@dataclass
class Parts:
    """The messages of one take."""

    blocks: list[Message] = field(default_factory=list)
    scans: list[Message] = field(default_factory=list)
    ends: list[Message] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.blocks) + len(self.scans) + len(self.ends)

    def __add__(self, other: Parts) -> Parts:
        return Parts(self.blocks + other.blocks, self.scans + other.scans, self.ends + other.ends)


@dataclass(frozen=True)
class Count:
    """How many messages there are, and how many of them are blocks."""

    messages: int
    blocks: int


@dataclass
class Contents:
    """The messages of a file.

    - `headers`: the bytes of each header, not yet decoded, by the hash that binds other messages to it
    - `parts`: the other messages by that hash; None where a message names no take and no header of version 1 exists
    - `damaged`: number of messages of no known kind
    - `longest_unread`: length of the longest message that begins as a header and is longer than one may be [bytes]
    """

    headers: dict[bytes, bytes] = field(default_factory=dict)
    parts: defaultdict[bytes | None, Parts] = field(default_factory=lambda: defaultdict(Parts))
    damaged: int = 0
    longest_unread: int = 0

    def of(self, binding: bytes | None) -> Parts:
        """Return the messages bound to this header."""
        return self.parts.get(binding, _NOTHING)

    def counted(self, bindings: Iterable[bytes | None]) -> Count:
        """Return the number of messages bound to these headers."""
        parts = [self.of(key) for key in bindings]
        return Count(sum(len(part) for part in parts), sum(len(part.blocks) for part in parts))

    def takes(self) -> list[bytes]:
        """Return the hashes of takes with blocks, in the order of their first headers."""
        return [binding for binding in self.headers if self.of(binding).blocks]

    def limit_of_headers(self) -> str:
        """Return by how much a header is larger than a reader accepts; "" where none is."""
        if self.longest_unread:
            return f"its header has {self.longest_unread} bytes, and a take's has {MOST_HEADER_BYTES} at most"
        if any(_has_many_parts(data) for data in self.headers.values()):
            return f"its header has more than {MOST_CONTAINERS} maps and lists"
        return ""

    def by_preference(self) -> Iterator[bytes]:
        """Yield the takes: finished ones first, then those with the most blocks, and the last one of equals."""
        finished = {key: _is_finished(self.of(key)) for key in self.headers}
        yield from (key for key, is_finished in finished.items() if is_finished)
        rest = [key for key in reversed(finished) if not finished[key]]
        yield from sorted(rest, key=lambda key: -len(self.of(key).blocks))


_NOTHING = Parts()


@dataclass
class _Nameless:
    """Assigns messages of version 1, which name no take, to a take.

    - `contents`: of the file, to which messages and late headers are added
    - `first`, `last`: hashes of the first and the last header of version 1 so far
    - `current`: hash of the take whose blocks continue; `NO_HEADER` while they wait for their header
    - `follows`: frame number with which its next block begins
    - `has_ended`: whether an end message came after the last header
    - `scans`: scans that wait for the block of their second
    """

    contents: Contents
    first: bytes | None = None
    last: bytes | None = None
    current: bytes | None = None
    follows: int = -1  # no number of a frame
    has_ended: bool = False
    scans: list[Message] = field(default_factory=list)

    @property
    def _going_on(self) -> bytes | None:
        return self.last if self.current is None else self.current

    def meet(self, header: bytes) -> None:
        """Accept a header; blocks that waited for a header belong to it."""
        parts = self.contents.parts
        if header != self.last and not self.has_ended:
            self.place_scans()
        self.first, self.last, self.has_ended = self.first or header, header, False
        if NO_HEADER in parts:
            parts[header] += parts.pop(NO_HEADER)
        if self.current == NO_HEADER:
            self.current = header

    def take_of(self, content: dict[str, Any]) -> bytes | None:
        """Return the hash of the header to which a message belongs, None before the first header."""
        begin, frames = content.get("first"), content.get("frames")
        if type(begin) is not int:
            found = self._ended(content.get("blocks"))
        else:
            if self.current is None or begin != self.follows:
                self.current = NO_HEADER if self.has_ended else self.last
            self.follows = begin + frames if type(frames) is int else -1
            found = self.current
        self.place_scans(found)
        return found

    def _ended(self, blocks: Any) -> bytes | None:
        """Return the take that ends here; a take with as many blocks as its end message counts does not continue."""
        parts, found = self.contents.parts, self._going_on
        if found == NO_HEADER:  # a writer puts the header before the end
            parts[LOST_HEADER] += parts.pop(NO_HEADER, _NOTHING)
            found = LOST_HEADER
        if blocks == len(parts[found].blocks):
            self.follows = -1
        self.has_ended = True
        return found

    def place_scans(self, take: bytes | None = None) -> None:
        """Assign the waiting scans to a take, by default to the take whose blocks continue."""
        if self.scans:
            self.contents.parts[self._going_on if take is None else take].scans += self.scans
            self.scans = []


def sorted_messages(messages: Iterable[tuple[bytes, int]], refund_copy: Callable[[int], None]) -> Contents:
    """Sort messages by take and kind; a message of no known kind is damage.

    Headers stay encoded until their take is chosen. Messages of version 1 name no take. They belong to the last header
    of version 1 before them, or else to the first one. Blocks whose frame numbers continue the block before stay with
    its take, in spite of a stray header between. Other blocks behind an end message belong to the next header, since
    their own is lost. A scan is written before the block of its second, and belongs to the take of that block. Where
    another header comes first, the scan belongs to the take before.

    - messages: the data of each message, and its share of the file [bytes]
    - refund_copy: called with the size [bytes] of each copy of the last header, before the next message is taken
    """
    contents = Contents()
    header, binding, nameless = b"", b"", _Nameless(contents)
    for data, own in messages:
        if data == header:
            refund_copy(len(data))
            if FORMAT_1 in data:
                nameless.meet(binding)
            continue
        content = _unpacked(data, FEW_CONTAINERS, FEW_ENTRIES, LONGEST_LIST)
        if content is None and len(data) <= MOST_HEADER_BYTES and FORMAT_KEY in data:
            content = {"format": None}
        if not isinstance(content, dict):
            contents.damaged += 1
            if len(data) > MOST_HEADER_BYTES and HEADERS_FORMAT in data[:HEADERS_START]:
                contents.longest_unread = max(contents.longest_unread, len(data))
            continue
        if "format" in content:
            header = contents.headers.setdefault(binding := binding_of(data), data)
            if FORMAT_1 in data:
                nameless.meet(binding)
            continue
        if "take" in content:
            take = content["take"]
        elif "surface" in content:
            nameless.scans.append(Message(content, own))
            continue
        else:
            take = nameless.take_of(content)
        if take is None or type(take) is bytes:
            parts = contents.parts[take]
            if "surface" in content:
                parts.scans.append(Message(content, own))
                continue
            if "first" in content:
                parts.blocks.append(Message(content, own))
                continue
            if "blocks" in content:
                parts.ends.append(Message(content, own))
                continue
        contents.damaged += 1
    nameless.place_scans()
    if nameless.first is not None and None in contents.parts:
        contents.parts[nameless.first] = contents.parts.pop(None) + contents.of(nameless.first)
    return contents


def header_of(data: bytes) -> dict[str, Any] | None:
    """Return the content of a header, None where it is malformed or has too many parts."""
    content = _unpacked(data, MOST_CONTAINERS, len(data), len(data)) if len(data) <= MOST_HEADER_BYTES else None
    return content if isinstance(content, dict) and "format" in content else None


class _PartsError(ValueError):
    """A message has more maps and lists than its kind may have."""


def _has_many_parts(data: bytes) -> bool:
    """Return whether a header is within its bytes, and has more maps and lists than a reader accepts."""
    try:
        _unpack(data, MOST_CONTAINERS, len(data), len(data))
    except _PartsError:
        return True
    except NOT_UNPACKED:
        return False
    return False


def _unpacked(data: bytes, containers: int, entries: int, items: int) -> Any:
    """Return the content of a message, None where it is malformed, or has too many or too large maps and lists."""
    try:
        return _unpack(data, containers, entries, items)
    except NOT_UNPACKED:
        return None


def _unpack(data: bytes, containers: int, entries: int, items: int) -> Any:
    count = 0

    def counted(container: Any) -> Any:
        nonlocal count
        count += 1
        if count > containers:
            raise _PartsError("too many parts")
        return container

    return msgpack.unpackb(
        data, object_hook=counted, list_hook=counted, max_ext_len=0, max_map_len=entries, max_array_len=items
    )


def _is_finished(parts: Parts) -> bool:
    """Return whether an end message counts at most twice the existing blocks; a stray page of another take has few."""
    counts = [end["blocks"] for end in parts.ends if type(end.get("blocks")) is int]
    return any(2 * len(parts.blocks) > max(count, 0) for count in counts)
