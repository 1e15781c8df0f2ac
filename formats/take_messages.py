"""Sort the messages of an archive by take and kind, each bounded by what it honestly holds. See `formats/SPEC.md`."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import msgpack

from formats.take_writer import MOST_HEADER_BYTES, binding_of

MOST_CONTAINERS = 60_000  # maps and lists of a header: 2000 points have 6000; ten hours lack 18,000 spans at most
FEW_CONTAINERS, FEW_ENTRIES = 16, 64  # of another message: it has a map and a list, and at most 17 entries
FORMAT_KEY = b"\xa6format"  # in msgpack
FORMAT_1 = FORMAT_KEY + b"\xafhangtime-take/1"


class Message(dict[str, Any]):
    """The content of a message, and its share of the file [bytes]."""

    __slots__ = ("own",)

    def __init__(self, content: dict[str, Any], own: int) -> None:
        super().__init__(content)
        self.own = own


@dataclass
class Parts:
    """The messages of one take."""

    blocks: list[Message] = field(default_factory=list)
    scans: list[Message] = field(default_factory=list)
    ends: list[Message] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.blocks) + len(self.scans) + len(self.ends)


@dataclass(frozen=True)
class Count:
    """How many messages there are, and how many of them are blocks."""

    messages: int
    blocks: int


@dataclass
class Contents:
    """The messages of a file.

    - `headers`: the bytes of each, by the hash that binds the other messages to it; nobody has looked at them
    - `parts`: by that hash, None where a message names none: those of version 1
    - `damaged`: messages that are of no kind
    """

    headers: dict[bytes, bytes] = field(default_factory=dict)
    parts: defaultdict[bytes | None, Parts] = field(default_factory=lambda: defaultdict(Parts))
    damaged: int = 0

    def of(self, binding: bytes | None) -> Parts:
        """Return the messages that name this take."""
        return self.parts.get(binding, _NOTHING)

    def counted(self, bindings: Iterable[bytes | None]) -> Count:
        """Return how many messages name these takes."""
        parts = [self.of(key) for key in bindings]
        return Count(sum(len(part) for part in parts), sum(len(part.blocks) for part in parts))

    def key_of(self, binding: bytes) -> bytes | None:
        """Return the hash that messages of a header's take name; those of version 1 name none."""
        return None if FORMAT_1 in self.headers[binding][:200] else binding

    def takes(self) -> dict[bytes | None, bytes]:
        """Return the takes that have blocks, by what their messages name: the hash of each one's first header."""
        found: dict[bytes | None, bytes] = {}
        for binding in self.headers:
            if self.of(key := self.key_of(binding)).blocks:
                found.setdefault(key, binding)
        return found

    def by_preference(self) -> Iterator[bytes]:
        """Yield the takes: the finished ones, then those of most blocks, of as many the last one first."""
        parts = {key: self.of(self.key_of(key)) for key in self.headers}
        yield from (key for key, part in parts.items() if _is_finished(part))
        rest = [key for key in reversed(parts) if not _is_finished(parts[key])]
        yield from sorted(rest, key=lambda key: -len(parts[key].blocks))


_NOTHING = Parts()


def sorted_messages(messages: Iterable[tuple[bytes, int]], take_for_copy: Callable[[int], None]) -> Contents:
    """Sort messages by take and kind; one of no kind is damage. A header stays as it is until its take is chosen.

    - messages: the data of each, and its share of the file [bytes]
    - take_for_copy: is called with the size [bytes] of each copy of the last header, before the next message is taken
    """
    contents = Contents()
    header = b""
    for data, own in messages:
        if data == header:
            take_for_copy(len(data))
            continue
        content = _unpacked(data, FEW_CONTAINERS, FEW_ENTRIES)
        if content is None and len(data) <= MOST_HEADER_BYTES and FORMAT_KEY in data:
            content = {"format": None}
        if not isinstance(content, dict):
            contents.damaged += 1
            continue
        if "format" in content:
            header = contents.headers.setdefault(binding_of(data), data)
            continue
        take = content.get("take")
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
    return contents


def header_of(data: bytes) -> dict[str, Any] | None:
    """Return the content of a header, None where it is malformed or has too many parts."""
    content = _unpacked(data, MOST_CONTAINERS, len(data)) if len(data) <= MOST_HEADER_BYTES else None
    return content if isinstance(content, dict) and "format" in content else None


def _unpacked(data: bytes, containers: int, entries: int) -> Any:
    """Return the content of a message, None where it is malformed or has too many maps and lists, or too large ones."""
    count = 0

    def counted(container: Any) -> Any:
        nonlocal count
        count += 1
        if count > containers:
            raise ValueError("too many parts")
        return container

    try:
        return msgpack.unpackb(
            data, object_hook=counted, list_hook=counted, max_ext_len=0, max_map_len=entries, max_array_len=entries
        )
    except (ValueError, msgpack.exceptions.UnpackException, RecursionError):
        return None


def _is_finished(parts: Parts) -> bool:
    """Whether an end of a take counts at most twice the blocks that are there: a stray page of another has few."""
    counts = [end["blocks"] for end in parts.ends if type(end.get("blocks")) is int]
    return any(2 * len(parts.blocks) > max(count, 0) for count in counts)
