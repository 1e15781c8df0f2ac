"""Take archives: one recording in one MCAP file that survives a power cut and a flipped bit. See `formats/SPEC.md`."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgpack
import msgspec
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk, Message
from mcap.stream_reader import breakup_chunk
from mcap.writer import CompressionType, IndexType, Writer

from formats.blocks import LATEST, TIME_STEP, Frame, decode_block, encode_block
from formats.descriptions import check_garment, check_rig
from formats.errors import DescriptionError, TakeError
from formats.garment import Garment
from formats.rig import Rig
from formats.surface import SurfaceScan, decode_scan, encode_scan
from formats.take import Take
from formats.unfinished import UnfinishedFile, not_utf8
from formats.whole_files import make_folders

VERSION = 1
PROFILE = f"hangtime-take/{VERSION}"
MAGIC = b"\x89MCAP0\r\n"
BLOCK_SECONDS = 1.0  # lost at most in a power cut
LARGEST_CHUNK = 1 << 26  # bytes unpacked; 500 markers at 500 frames a second are a tenth of that
HEADER_EVERY = 30  # blocks: the header is repeated, and once more at the end, so that no flipped bit loses the take
HEADER, BLOCK, SURFACE, END = "/header", "/block", "/surface", "/end"


class TakeWriter:
    """Write a take frame by frame; `finish` gives the file its name, until then it is `NAME.partial`, and locked.

    As a context manager it finishes on leaving, and keeps the partial file when an exception passes.
    """

    def __init__(
        self, path: Path, *, take_id: str, created: str, rig: Rig, garment: Garment, source: str = "",
        notes: dict[str, str] | None = None, overwrite: bool = True,
    ) -> None:  # fmt: skip
        """Begin a take.

        overwrite: whether a take of this name, or what was left of one, may be replaced

        Raises:
            DescriptionError: an impossible rig or garment.
            OutputError: another writer is at this take, it is there and may not be replaced, or its name is not UTF-8.
            OSError: the file cannot be written.
        """
        check_rig(rig, take_id)
        check_garment(garment, take_id)
        self._points = len(garment.points)
        self._header = {
            "format": PROFILE, "take_id": take_id, "created": created, "rig": msgspec.to_builtins(rig),
            "garment": msgspec.to_builtins(garment), "source": source, "notes": notes or {},
        }  # fmt: skip
        make_folders(path.parent)
        self._unfinished = UnfinishedFile(path, overwrite=overwrite)
        self.path, self.partial = path, self._unfinished.partial
        self._frames: list[Frame] = []
        self._count = self._blocks = 0
        self._is_readable = False
        self._last_time = -np.inf
        try:
            self._begin()
        except BaseException as error:
            self.discard()
            if isinstance(error, UnicodeEncodeError):
                raise not_utf8(path) from error
            raise

    def _begin(self) -> None:
        self._mcap = Writer(
            self._unfinished.file, chunk_size=1, compression=CompressionType.ZSTD, index_types=IndexType.CHUNK,
            use_statistics=True, use_summary_offsets=False, enable_data_crcs=False,
        )  # fmt: skip
        self._mcap.start(profile=PROFILE, library="hangtime")
        schema = self._mcap.register_schema("hangtime", "", b"")
        self._channels = {t: self._mcap.register_channel(t, "msgpack", schema) for t in (HEADER, BLOCK, SURFACE, END)}
        self._write(HEADER, self._header)

    def append(self, frame: Frame) -> None:
        """Add a frame.

        Raises:
            TakeError: time does not increase or lies centuries away, a valid value is not finite, or a shape is wrong.
        """
        where = f"{self._header['take_id']}, frame {self._count + len(self._frames)}"
        if not frame.time > self._last_time:
            raise TakeError(
                f"time goes from {self._last_time:.6f} s to {frame.time:.6f} s", where=where,
                advice="frames must come in the order of their time stamps",
            )  # fmt: skip
        if not abs(frame.time) <= LATEST * TIME_STEP:
            raise TakeError(f"the time {frame.time:g} s lies centuries away", where=where, advice="give it in seconds")
        if frame.points.shape != (self._points, 3) or frame.points_valid.shape != (self._points,):
            raise TakeError(f"points have shape {frame.points.shape}, not {(self._points, 3)}", where=where)
        for name, values, valid in (
            ("point", frame.points, frame.points_valid),
            ("held end", frame.held, frame.held_valid),
        ):
            bad = valid & ~np.isfinite(values).all(-1)
            if bad.any():
                raise TakeError(f"{name} {int(np.argmax(bad))} is marked valid but is not a number", where=where)
        self._last_time = frame.time
        if self._frames and frame.time - self._frames[0].time >= 2 * BLOCK_SECONDS:
            self._flush()  # a gap: packed times of one block reach 1073 s
        self._frames.append(frame)
        if frame.time - self._frames[0].time >= BLOCK_SECONDS:
            self._flush()

    def append_scan(self, scan: SurfaceScan) -> None:
        """Add a scan of the visible surface, taken at the time of a frame or between frames."""
        self._write(SURFACE, encode_scan(scan))

    def finish(self) -> Path:
        """Write what is left, make it durable, and give the file its final name.

        Raises:
            OutputError: a file that may not be replaced has come there; this one can still be kept or discarded.
        """
        self._flush()
        self._write(HEADER, self._header)
        self._write(END, {"frames": self._count, "blocks": self._blocks})
        self._mcap.finish()
        self._unfinished.finish()
        return self.path

    @property
    def is_readable(self) -> bool:
        """Whether a block is safe on the disk, so that the partial file can be read."""
        return self._is_readable

    def keep(self) -> None:
        """Close the partial file as it is, after an error that writing more would only repeat."""
        self._unfinished.keep()

    def discard(self) -> None:
        """Remove what was written, unless it was finished or kept before."""
        self._unfinished.discard()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.finish()
        elif not self._unfinished.file.closed:
            self._flush()
            self._unfinished.sync()
            self._unfinished.keep()

    def _flush(self) -> None:
        if not self._frames:
            return
        if self._blocks and self._blocks % HEADER_EVERY == 0:
            self._write(HEADER, self._header)
        self._write(BLOCK, encode_block(self._frames, self._count))
        self._count += len(self._frames)
        self._blocks += 1
        self._frames = []
        self._unfinished.sync()
        self._is_readable = True

    def _write(self, topic: str, content: dict[str, Any]) -> None:
        stamp = max(int(1e9 * self._last_time), 0) if np.isfinite(self._last_time) else 0
        self._mcap.add_message(self._channels[topic], stamp, msgpack.packb(content), stamp)


@dataclass(frozen=True, kw_only=True)
class TakeReport:
    """What `verify_take` found."""

    frames: int
    blocks: int
    damaged_blocks: int
    is_complete: bool

    @property
    def is_sound(self) -> bool:
        """Whether the take is finished and nothing is damaged."""
        return self.is_complete and self.damaged_blocks == 0


def read_take(path: Path) -> Take:
    """Read a take; of a damaged or cut-off file, what survives (`is_complete` says so).

    Raises:
        TakeError: the file is missing, not a take, of a newer version, or holds no frame.
    """
    return _read(_bytes_of(path), path)[0]


def take_of(raw: bytes, where: object) -> Take:
    """Read a take from the bytes of its archive; where: whence they are.

    Raises:
        TakeError: as `read_take`.
    """
    return _read(raw, where)[0]


def verify_take(path: Path) -> TakeReport:
    """Read a take and say how much of it is sound.

    Raises:
        TakeError: as `read_take`.
    """
    return _read(_bytes_of(path), path)[1]


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror})", where=path, advice="check the path") from error


def _read(raw: bytes, path: object) -> tuple[Take, TakeReport]:
    header: dict[str, Any] | None = None
    end: dict[str, Any] | None = None
    blocks: dict[int, dict[str, Any]] = {}
    scans: list[SurfaceScan] = []
    damaged = 0
    for content in _messages(raw, path):
        if not isinstance(content, dict):
            damaged += 1
        elif "surface" in content:
            try:
                scans.append(decode_scan(content))
            except (ValueError, KeyError, TypeError):
                damaged += 1
        elif "format" in content:
            header = content
        elif "first" in content and type(content["first"]) is int:
            blocks[content["first"]] = content
        elif type(content.get("blocks")) is int:
            end = content
        else:
            damaged += 1
    if header is None:
        raise TakeError(
            "holds no readable header", where=path, advice="it is not a take archive, or its beginning is destroyed"
        )
    rig, garment, words = _described(header, path)
    points = len(garment.points)
    decoded = []
    for first in sorted(blocks):
        try:
            decoded.append(decode_block(blocks[first], points))
        except (ValueError, KeyError, TypeError):
            damaged += 1
    if not decoded:
        raise TakeError("holds no frame", where=path, advice="the recording ended before its first second")
    joined = {name: np.concatenate([d[name] for d in decoded]) for name in decoded[0]}
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(joined["time"])) > 0])
    joined = {name: values[keep] for name, values in joined.items()}
    damaged += int(not keep.all())  # frames whose time does not increase were never written
    expected = end["blocks"] if end else None
    is_complete = end is not None and len(decoded) == expected
    if expected is not None:
        damaged = max(damaged, expected - len(decoded))
    take = Take(
        take_id=words.take_id, created=words.created, rig=rig, garment=garment,
        source=words.source, notes=words.notes, is_complete=is_complete,
        scans=tuple(sorted(scans, key=lambda scan: scan.time)), **joined,
    )  # fmt: skip
    return take, TakeReport(
        frames=len(take.time), blocks=len(decoded), damaged_blocks=damaged, is_complete=end is not None
    )


class _Words(msgspec.Struct, frozen=True, kw_only=True):
    """What a header says of a take besides its rig and garment."""

    take_id: str
    created: str
    source: str
    notes: dict[str, str]


def _described(header: dict[str, Any], path: object) -> tuple[Rig, Garment, _Words]:
    name, _, version = str(header["format"]).partition("/")
    if name != "hangtime-take":
        raise TakeError(f"is a {header['format']!r}, not a take", where=path, advice="give a take archive")
    if not version.isdecimal() or int(version) > VERSION:
        raise TakeError(f"is of format version {version}; this Hangtime reads up to {VERSION}", where=path,
                        advice="update Hangtime")  # fmt: skip
    try:
        rig, garment = msgspec.convert(header.get("rig"), Rig), msgspec.convert(header.get("garment"), Garment)
        check_rig(rig, path)
        check_garment(garment, path)
    except (msgspec.ValidationError, DescriptionError) as error:
        raise TakeError(f"its rig or garment does not hold: {error}", where=path, advice="record it again") from error
    try:
        return rig, garment, msgspec.convert(header, _Words)
    except msgspec.ValidationError as error:
        raise TakeError(f"its header does not hold: {error}", where=path, advice="record it again") from error


def _messages(raw: bytes, path: object) -> Iterator[Any]:
    """Yield the content of every message, a dict as we write it, None for a damaged chunk; go on after damage."""
    if not raw:
        raise TakeError("is empty", where=path, advice="give a take archive")
    if not raw.startswith(MAGIC) and MAGIC[:5] != raw[:5] and b"hangtime-take" not in raw[:200]:
        raise TakeError(
            "is not a take archive", where=path, advice="give a file that `hangtime record` or `import` wrote"
        )
    at = len(MAGIC)
    was_sound = True
    while at + 9 <= len(raw):
        opcode, length = raw[at], struct.unpack_from("<Q", raw, at + 1)[0]
        if opcode == Opcode.DATA_END:
            return
        is_whole = at + 9 + length <= len(raw)
        found = _chunk_content(raw[at + 9 : at + 9 + length]) if opcode == Opcode.CHUNK and is_whole else None
        if found is not None:
            yield from found
            was_sound = True
            at += 9 + length
        elif opcode in (Opcode.HEADER, Opcode.MESSAGE_INDEX) and is_whole and length < 4096:
            at += 9 + length
        else:
            if was_sound and is_whole:
                yield None
            was_sound = False
            at = raw.find(bytes([Opcode.CHUNK]), at + 1)
            if at < 0:
                return


def _chunk_content(record: bytes) -> list[Any] | None:
    """Content of the messages of a chunk record, or None if it is damaged."""
    try:
        chunk = Chunk.read(ReadDataStream(io.BytesIO(record)))
        # A chunk states its size twice; zstd unpacks whatever the inner statement says.
        stated = zstandard.frame_content_size(chunk.data) if chunk.compression == "zstd" else len(chunk.data)
        if not 0 < chunk.uncompressed_size < LARGEST_CHUNK or stated not in (-1, chunk.uncompressed_size):
            return None
        return [
            msgpack.unpackb(m.data) for m in breakup_chunk(chunk, validate_crc=True) if isinstance(m, Message)
        ]  # fmt: skip
    except Exception:  # damaged bytes can fail anywhere in zstd, MCAP and msgpack
        return None


def write_take(path: Path, take: Take, *, overwrite: bool = True) -> Path:
    """Write a whole take at once; overwrite: whether a take of this name may be replaced.

    Raises:
        TakeError: as `TakeWriter.append`.
        OutputError: as `TakeWriter` and `TakeWriter.finish`.
        OSError: it cannot be written; names the file.
    """
    writer = TakeWriter(
        path, take_id=take.take_id, created=take.created, rig=take.rig, garment=take.garment, source=take.source,
        notes=take.notes, overwrite=overwrite,
    )  # fmt: skip
    try:
        for k, time in enumerate(take.time):
            writer.append(
                Frame(
                    time=float(time), markers=take.markers[k], held=take.held[k], held_valid=take.held_valid[k],
                    held_sd=take.held_sd[k], points=take.points[k], points_valid=take.points_valid[k],
                    points_sd=take.points_sd[k], state=int(take.state[k]),
                    points_hidden=None if take.points_hidden is None else take.points_hidden[k],
                    quality=float("nan") if take.quality is None else float(take.quality[k]),
                    pitch=float("nan") if take.pitch is None else float(take.pitch[k]),
                    pitch_sd=float("nan") if take.pitch_sd is None else float(take.pitch_sd[k]),
                )
            )  # fmt: skip
        for scan in take.scans:
            writer.append_scan(scan)
        return writer.finish()
    except BaseException as error:
        writer.discard()
        if isinstance(error, OSError):
            error.filename = str(path)  # a full disk names none
        raise
