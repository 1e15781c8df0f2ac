"""Write takes, frame by frame during a recording or whole. See `formats/SPEC.md`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgpack
import msgspec
import numpy as np
from mcap.writer import CompressionType, IndexType, Writer

from formats.arrays import Floats
from formats.blocks import (
    Columns,
    Frame,
    as_arrays,
    check_columns,
    columns_of,
    cut_into_blocks,
    encode_blocks,
    most_rows,
    widths,
)  # fmt: skip
from formats.descriptions import PARTS, Description, check_garment, check_rig
from formats.errors import DescriptionError, TakeError
from formats.garment import Garment
from formats.missing import possible_spans
from formats.outputs import check_name
from formats.plain_text import in_utf8
from formats.rig import Rig
from formats.surface import SurfaceScan, encode_scan
from formats.take import Take
from formats.take_report import Span
from formats.unfinished import ANOTHER_NAME, TellAside, UnfinishedFile
from formats.whole_files import make_folders
from formats.wrong_fields import wrong_field

VERSION = 2  # of the format, `formats/SPEC.md`
PROFILE = f"hangtime-take/{VERSION}"
FILE_BLOCK_SECONDS = 1.0  # lost at most in a power cut; our choice: double would lose twice as much, half pack worse
HEADER_EVERY = 30  # blocks: the header is repeated, and once more at the end, so that no flipped bit loses the take
SECOND_HEADER = 5  # blocks before it: an interrupted recording survives the loss of its first page
HEADER, BLOCK, SURFACE, END = "/header", "/block", "/surface", "/end"
WRITTEN_AT_ONCE = 1 << 20  # numbers encoded together: each takes 400 bytes meanwhile
NO_INDEX = IndexType(0)  # of chunks: 77 bytes a second, and no reader of takes skips any
BINDING_BYTES = 8  # of a header's hash, `formats/SPEC.md`
MOST_HEADER_BYTES = 1 << 20  # `formats/SPEC.md`, limits
MOST_MISSING = 20_000  # missing spans: a reader accepts a header with three times as many lists


class Words(msgspec.Struct, frozen=True, kw_only=True):
    """The texts of a header besides its rig and garment."""

    take_id: str
    created: str
    source: str
    notes: dict[str, str]
    missing: tuple[Span, ...] = ()


def binding_of(header: bytes) -> bytes:
    """Return the hash that binds blocks, scans and the end message to a header: the first bytes of its BLAKE2b hash."""
    from hashlib import blake2b  # imported here: it loads OpenSSL, 4 MB that an appliance saves until it records

    return blake2b(header, digest_size=BINDING_BYTES).digest()


class TakeWriter:
    """Write a take frame by frame to the locked file `NAME.partial`; `finish` gives the file its final name.

    As a context manager it finishes at the end of the block, and keeps the partial file after an exception.
    """

    def __init__(
        self, path: Path, *, take_id: str, created: str, rig: Rig, garment: Garment, source: str = "",
        notes: dict[str, str] | None = None, overwrite: bool = True, missing: Sequence[tuple[float, float]] = (),
        instead: str = ANOTHER_NAME, tell_aside: TellAside | None = None,
    ) -> None:  # fmt: skip
        """Open the partial file, lock it, and write the header.

        - `overwrite`, `instead`, `tell_aside`: as in `UnfinishedFile`
        - `source`: the recording's origin; bytes of a file name that are not UTF-8 are escaped as in `caf\\xe9.oni`
        - `missing` [s]: spans of the sensor's clock whose frames an earlier file of this take lost

        Raises:
            DescriptionError: an impossible rig or garment.
            TakeError: a text that cannot be written or is no text, or impossible spans; names the field.
            OutputError: another process writes this take; the file exists and may not be replaced; its name is not
                UTF-8; or a link has its name.
            OSError: the file cannot be written.
        """
        told = _checked_words(path, take_id, created, source, notes, missing)
        rig, garment = _checked_description(path, rig, Rig), _checked_description(path, garment, Garment)
        check_rig(rig, take_id)
        check_garment(garment, take_id)
        self._points, self._take_id = len(garment.points), take_id
        self._most_rows = most_rows(self._points)
        header = _header_of(told, rig, garment)
        make_folders(path.parent)
        self._unfinished = UnfinishedFile(path, overwrite=overwrite, instead=instead, tell_aside=tell_aside)
        self.path, self.partial = path, self._unfinished.partial
        self._waiting: list[Columns] = []
        self._first_time = self._last_time = -np.inf
        self._count = self._blocks = self._queued = 0
        self._scans: set[int] = set()  # their times [us]
        self._is_readable = False
        try:
            self._begin(header)
        except BaseException as error:
            self.discard()
            if not isinstance(error, UnicodeEncodeError):
                raise
            check_name(path)
            raise TakeError(
                f"{_not_text(header, '')} holds what is no letter, and no file can keep it", where=path,
                advice="write it anew",
            ) from error  # fmt: skip

    def _begin(self, header: dict[str, Any]) -> None:
        self._header = msgpack.packb(header)
        if len(header.get("missing", ())) > MOST_MISSING:
            raise TakeError(f"lacks frames in {len(header['missing'])} places", where=self.path, advice="cut the take")
        _check_spans(header.get("missing", ()), np.empty(0), self.path)
        if len(self._header) > MOST_HEADER_BYTES:
            raise TakeError(f"its header has {len(self._header)} bytes", where=self.path, advice="shorten the notes")
        self._binding = binding_of(self._header)
        self._mcap = Writer(
            self._unfinished.file, chunk_size=1, compression=CompressionType.ZSTD, index_types=NO_INDEX,
            use_statistics=True, use_summary_offsets=False, repeat_schemas=False, repeat_channels=False,
            enable_data_crcs=False,
        )  # fmt: skip
        self._mcap.start(profile=PROFILE, library="hangtime")
        specification = files("formats").joinpath("SPEC.md").read_bytes()
        schema = self._mcap.register_schema("hangtime-take", "text/markdown", specification)
        self._channels = {t: self._mcap.register_channel(t, "msgpack", schema) for t in (HEADER, BLOCK, SURFACE, END)}
        self._write(HEADER, self._header)

    def append(self, frame: Frame) -> None:
        """Add a frame.

        Raises:
            TakeError: as `formats.blocks.check_columns`.
        """
        columns = frame.as_columns()
        self._check(columns)
        if self._first_time == -np.inf:
            self._first_time = frame.time
        start = self._waiting[0]["time"][0] if self._waiting else frame.time
        if frame.time - start >= 2 * FILE_BLOCK_SECONDS:  # a gap: it is no part of a block
            self._flush()
            start = frame.time
        self._waiting.append(columns)
        self._last_time = frame.time
        if frame.time - start >= FILE_BLOCK_SECONDS or len(self._waiting) >= self._most_rows:
            self._flush()

    def append_columns(self, columns: Columns) -> None:
        """Add many frames at once, by the names of `formats.take.Take`; `finish` puts them on the disk.

        Raises:
            TakeError: as `formats.blocks.check_columns`.
        """
        self._flush()
        columns = as_arrays(columns, self._take_id)
        if not columns["time"].size:
            return
        self._check(columns)
        if self._first_time == -np.inf:
            self._first_time = float(columns["time"][0])
        rows = cut_into_blocks(columns["time"], FILE_BLOCK_SECONDS, self._most_rows)
        each = max(WRITTEN_AT_ONCE // sum(widths(self._points).values()), 1)
        ends = np.cumsum(rows)
        for of_batch in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(ends // each)) + 1):
            part = slice(ends[of_batch[0]] - rows[of_batch[0]], ends[of_batch[-1]])
            self._write_blocks({name: values[part] for name, values in columns.items()}, rows[of_batch])
        self._last_time = float(columns["time"][-1])

    def append_scan(self, scan: SurfaceScan) -> None:
        """Add a scan of the visible surface, taken at the time of a frame or between frames.

        Raises:
            TakeError: as `formats.surface.encode_scan`, or a scan of this time exists.
        """
        content = encode_scan(scan)
        if content["surface"] in self._scans:
            raise TakeError("has two scans of the surface at one time", where=self._take_id, advice="keep one of them")
        self._write(SURFACE, msgpack.packb({"take": self._binding, **content}))
        self._scans.add(content["surface"])

    def finish(self, beside: AbstractContextManager[None] | None = None) -> Path:
        """Write the remaining frames, make the file durable, and give the file its final name.

        beside: context entered once the file is complete and durable, and left once it has its name

        Raises:
            TakeError: no frame was written, and no reader accepts such a file.
            OutputError: a file that may not be replaced has appeared there.

        After an error this file can still be kept or discarded.
        """
        self._flush()
        if not self._count:
            raise TakeError("holds no frame", where=self.path, advice="give one frame or more")
        self._write(HEADER, self._header)
        ends = {}
        if self._count:
            ends = {"from": round(1e6 * self._first_time), "until": round(1e6 * self._last_time)}
        counts = {"frames": self._count, "blocks": self._blocks, "scans": len(self._scans)}
        self._write(END, msgpack.packb({"take": self._binding, **counts, **ends}))
        self._mcap.finish()
        self._unfinished.sync()
        with beside or nullcontext():
            self._unfinished.finish()
        return self.path

    @property
    def is_readable(self) -> bool:
        """True once a block is on the disk, so that the partial file can be read."""
        return self._is_readable

    def keep(self) -> None:
        """Close the partial file unchanged, after an error that further writing would repeat."""
        self._unfinished.keep()

    def discard(self) -> None:
        """Remove the file, unless it was finished or kept before."""
        self._unfinished.discard()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        if kind is None:
            try:
                self.finish()
            except TakeError:
                self.discard()
                raise
        elif not self._unfinished.file.closed:
            self._flush()
            self._unfinished.sync()
            self._unfinished.keep()

    def _check(self, columns: Columns) -> None:
        first = self._count + len(self._waiting)
        check_columns(columns, points=self._points, take_id=self._take_id, first=first, after=self._last_time)

    def _flush(self) -> None:
        """Write the pending frames to the disk, as one block."""
        if not self._waiting:
            return
        columns = {name: np.concatenate([one[name] for one in self._waiting]) for name in self._waiting[0]}
        self._write_blocks(columns, np.array([len(self._waiting)]))
        self._waiting = []
        self._unfinished.sync()
        self._is_readable = True

    def _write_blocks(self, columns: Columns, rows: np.ndarray[Any, np.dtype[np.int64]]) -> None:
        for block in encode_blocks(columns, rows, self._count):
            if self._blocks % HEADER_EVERY == SECOND_HEADER:
                self._write(HEADER, self._header)
            self._write(BLOCK, msgpack.packb({"take": self._binding, **block}), block["start"])
            self._count += block["frames"]
            self._blocks += 1

    def _write(self, topic: str, content: bytes, start: int | None = None) -> None:
        last = self._last_time * 1e6 if np.isfinite(self._last_time) else 0.0
        stamp = max(1000 * int(last if start is None else start), 0)
        self._mcap.add_message(self._channels[topic], stamp, content, stamp)


def _header_of(told: Words, rig: Rig, garment: Garment) -> dict[str, Any]:
    return {
        "format": PROFILE, "take_id": told.take_id, "created": told.created, "rig": msgspec.to_builtins(rig),
        "garment": msgspec.to_builtins(garment), "source": _escaped(told.source), "notes": told.notes,
        **({"missing": [list(span) for span in told.missing]} if told.missing else {}),
    }  # fmt: skip


def with_room(take: Take) -> Take:
    """Return a take that was read, with its longest note cut where its header would be too large with what it lacks."""
    told = Words(take_id=take.take_id, created=take.created, source=take.source, notes=take.notes, missing=take.missing)
    over = len(msgpack.packb(_header_of(told, take.rig, take.garment))) - MOST_HEADER_BYTES
    if over <= 0 or not take.notes:
        return take
    longest, end = max(take.notes, key=lambda name: len(take.notes[name])), " [cut]"
    kept = take.notes[longest].encode()[: -over - len(end)].decode(errors="ignore")
    return replace(take, notes={**take.notes, longest: kept + end})


def _checked_words(
    path: Path, take_id: object, created: object, source: object, notes: object, missing: Iterable[Iterable[float]]
) -> Words:
    """Return the texts of a header as a reader will parse them; refuse others, by their field."""
    try:
        spans = [[float(end) for end in span] for span in missing]
    except (TypeError, ValueError) as error:
        raise TakeError("missing must be pairs of seconds", where=path, advice="give numbers") from error
    held = {"take_id": take_id, "created": created, "source": source, "notes": notes or {}, "missing": spans}
    try:
        return msgspec.convert(held, Words)
    except msgspec.ValidationError as error:
        raise TakeError(wrong_field(error, (Words,)), where=path, advice="give it in that form") from error


def _checked_description(path: Path, description: Description, kind: type[Description]) -> Description:
    """Return a rig or garment as a reader will parse it, with NumPy's numbers as Python's; refuse others."""
    name = kind.__name__
    if not isinstance(description, kind):
        what = f"{name.lower()} must be a {name} (got {type(description).__name__})"
        raise TakeError(what, where=path, advice="load one from its file, or make one")
    try:
        return msgspec.convert(msgspec.to_builtins(description, enc_hook=_without_numpy), kind)
    except msgspec.ValidationError as error:
        words = f"{name.lower()}: {wrong_field(error, (kind, *PARTS[kind]))}"
        raise DescriptionError(words, where=path, advice="see docs/reference/file-formats.md") from error
    except TypeError as error:
        what = f"{name.lower()} has a value that no file can hold ({error})"
        raise DescriptionError(what, where=path, advice="see docs/reference/file-formats.md") from error


def _without_numpy(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biuf":
        return value.tolist()
    raise TypeError(f"of type {type(value).__name__}")


def _check_spans(spans: Sequence[Sequence[float]], time: Floats, where: Path) -> None:
    """Refuse spans that a reader would ignore; time [s], (frames,): of the existing frames."""
    pairs = [(begin, end) for begin, end in spans]
    possible = set(possible_spans(pairs, time))
    if wrong := [pair for pair in pairs if pair not in possible]:
        begin, end = wrong[0]
        raise TakeError(
            f"missing: no frames can be missing from {begin:g} to {end:g} s", where=where,
            advice="give each span from the last frame before it to the first one after",
        )  # fmt: skip


def _not_text(value: object, field: str) -> str:
    """Return the name of a field with an incomplete character, which UTF-8 cannot hold; '' without one."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list | tuple) else ()
    for key, part in parts:
        place = f"{field}[{key}]" if isinstance(key, int) else f"{field}.{key}" if field else str(key)
        if found := place if _is_cut(key) else _not_text(part, place):
            return found
    return field if _is_cut(value) else ""


def _escaped(source: str) -> str:
    """Return the origin of a recording with the bytes of a file name escaped; other halves of letters stay."""
    try:
        return in_utf8(source)
    except UnicodeEncodeError:  # refused when the header is packed
        return source


def _is_cut(text: object) -> bool:
    return isinstance(text, str) and any("\ud800" <= letter <= "\udfff" for letter in text)


def write_take(
    path: Path, take: Take, *, overwrite: bool = True, beside: AbstractContextManager[None] | None = None,
    instead: str = ANOTHER_NAME, tell_aside: TellAside | None = None,
) -> Path:  # fmt: skip
    """Write a whole take at once.

    - `overwrite`, `instead`, `tell_aside`: as in `UnfinishedFile`
    - `beside`: as in `TakeWriter.finish`

    Raises:
        TakeError: as `TakeWriter`, `TakeWriter.append_columns` and `TakeWriter.finish`.
        DescriptionError, OutputError: as `TakeWriter` and `TakeWriter.finish`.
        OSError: it cannot be written; names the file.
    """
    columns = columns_of(vars(take), path)
    told = _checked_words(path, take.take_id, take.created, take.source, take.notes, take.missing)
    if len(told.missing) <= MOST_MISSING:
        _check_spans(told.missing, columns["time"].ravel(), path)
    writer = TakeWriter(
        path, take_id=take.take_id, created=take.created, rig=take.rig, garment=take.garment, source=take.source,
        notes=take.notes, overwrite=overwrite, missing=take.missing, instead=instead, tell_aside=tell_aside,
    )  # fmt: skip
    try:
        writer.append_columns(columns)
        for scan in take.scans:
            writer.append_scan(scan)
        return writer.finish(beside)
    except BaseException as error:
        writer.discard()
        if isinstance(error, OSError):
            error.filename = str(path)  # a full disk names none
        raise
