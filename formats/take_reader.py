"""Read takes: every sound block, even of a damaged file. See `formats/SPEC.md`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from formats.chunks import LARGEST_CHUNK, MCAP_MAGIC, Findings, messages_in, messages_with_sizes, profile_of
from formats.descriptions import MOST_POINTS
from formats.errors import TakeBegunError, TakeError
from formats.left_descriptions import left_beside
from formats.missing import noted_doubts, possible_spans
from formats.plain_text import counted
from formats.sound_blocks import decoded, in_order, increasing, sound_scans
from formats.system_causes import step_to_read
from formats.table_memory import TableMemory
from formats.take import Take
from formats.take_end import Held, contradictions, is_end, missing_spans, stray_scans
from formats.take_header import described, of_another_version
from formats.take_messages import Message, header_of, sorted_messages
from formats.take_report import TakeReport
from formats.unfinished import is_being_written

LARGEST_FILE = 1 << 30  # bytes: ten hours of 81 markers at 120 frames a second are half of it
SEARCHED_BYTES = 1 << 22  # bytes searched in a file of another profile: a take repeats its header
MIXED = "two takes share a header in this file, or one has lost its own, and their seconds may be mixed"
IMPOSSIBLE_SPANS = "its header states impossible missing times"
MOST_TAKES = 50  # read from one file: more than a person would join
COPY = "copy it again from where it was recorded"
UNTIL_WRITTEN = "wait until the recording or import that writes it has ended"
ONI_START = b"NI10"  # first bytes of a sensor recording (.oni), as OpenNI2 writes it
WITH_LESS = f"write it again with a garment of at most {MOST_POINTS} points and with shorter notes"
NO_TAKE = "give a file that `hangtime record` or `hangtime import` wrote"


def read_take(path: Path) -> Take:
    """Read a take; of a damaged or cut file, read the surviving part (`Take.missing` lists the missing spans).

    Raises:
        TakeError: the file is missing, not a take, of a newer version, or holds no frame.
    """
    return read_with_report(path)[0]


def take_of(raw: bytes, where: object) -> Take:
    """Read a take from the bytes of its archive; where: the source that an error names.

    Raises:
        TakeError: as `read_take`.
    """
    return _Archive(raw, where).first()[0]


def verify_take(path: Path) -> TakeReport:
    """Read a take and report how much of it is sound.

    Raises:
        TakeError: as `read_take`.
    """
    return read_with_report(path)[1]


def read_with_report(path: Path) -> tuple[Take, TakeReport]:
    """Read a take, and report how much of it is sound.

    Raises:
        TakeError: as `read_take`.
    """
    return _opened(path).first()


@dataclass(frozen=True)
class EveryTake:
    """The takes of a file.

    - `count`: number of takes with blocks
    - `each`: the take that `read_take` returns, then the others in the order of the file, or the error of a lost take
    """

    count: int
    each: Iterator[tuple[Take, TakeReport] | TakeError]


def read_every_take(path: Path) -> EveryTake:
    """Read all takes of a file, one after the other.

    Raises:
        TakeError: the file is missing, not a take, or has no header that can be read.
    """
    return _opened(path).every()


def _opened(path: Path) -> _Archive:
    is_written = is_being_written(path)  # asked first: a writer that ends after the bytes are read has written more
    return _Archive(_bytes_of(path), path, is_being_written=is_written)


def _bytes_of(path: Path) -> bytes:
    """Return the bytes of a file; of a file that is too large or no take, only as many as show that."""
    try:
        _refuse_what_has_no_end(path)
        with path.open("rb") as file:
            size = path.stat().st_size
            raw = file.read(SEARCHED_BYTES)
            profile = profile_of(raw)
            if size > LARGEST_FILE:
                detail = f" and its profile says {profile}" if profile and not _is_ours(profile) else ""
                most = f"a take has {LARGEST_FILE / 1e9:.1f} GB at most"
                raise TakeError(f"is no take: the file has {size / 1e9:.1f} GB{detail}", where=path, advice=most)
            is_foreign = profile is not None and not _is_ours(profile)
            if is_foreign and not _has_header(raw):
                return raw
            del raw
            file.seek(0)
            return file.read()
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error


def _is_ours(profile: str) -> bool:
    return profile.startswith("hangtime-take/")


def _has_header(raw: bytes) -> bool:
    return any(b"hangtime-take/" in data[:64] for data in messages_in(raw, Findings()))


def _refuse_what_has_no_end(path: Path) -> None:
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise TakeError("is a pipe or a device", where=path, advice=NO_TAKE)


class _Archive:
    """The takes of a file: usually one, or several in a joined file or a file with a stray page of another take."""

    def __init__(self, raw: bytes, where: object, *, is_being_written: bool = False) -> None:
        self._is_being_written = is_being_written
        if not raw:
            if is_being_written:
                raise TakeBegunError("is empty yet", where=where, advice=UNTIL_WRITTEN)
            raise TakeError("is empty", where=where, advice="give a take archive")
        self._raw, self._where, self._findings = raw, where, Findings()
        self._contents = sorted_messages(messages_with_sizes(raw, self._findings), self._findings.refund_copy)
        self._memory = TableMemory()
        self._all = self._contents.counted(self._contents.parts)
        self._named = self._contents.counted(self._contents.headers)  # of takes whose headers are there
        self._takes = self._contents.takes()
        self._without = len(self._contents.headers) - len(self._takes)  # headers without blocks of their own

    def first(self) -> tuple[Take, TakeReport]:
        """Return the take that `read_take` returns, and its report."""
        return self._read(*self._chosen())

    def every(self) -> EveryTake:
        """Return all takes: the one that `read_take` returns, then the others in the order of the file."""
        chosen, _ = self._chosen()
        takes = [chosen, *(binding for binding in self._takes if binding != chosen)]
        return EveryTake(len(takes), self._each(takes))

    def _each(self, takes: list[bytes]) -> Iterator[tuple[Take, TakeReport] | TakeError]:
        for binding in takes[:MOST_TAKES]:
            yield self._read_or_lost(binding)
        if len(takes) > MOST_TAKES:
            what = f"holds {len(takes)} takes, of which {MOST_TAKES} are read"
            yield TakeError(what, where=self._where, advice="cut the file into several")

    def _chosen(self) -> tuple[bytes, dict[str, Any]]:
        for binding in self._contents.by_preference():
            header = header_of(self._contents.headers[binding])
            if header is not None:
                return binding, header
            self._contents.damaged += 1
        if self._is_being_written:
            raise TakeBegunError("holds no readable header yet", where=self._where, advice=UNTIL_WRITTEN)
        if limit := self._contents.limit_of_headers():
            raise TakeError(f"cannot be read: {limit}", where=self._where, advice=WITH_LESS)
        raise _no_header(self._raw, self._findings, self._where)

    def _read_or_lost(self, binding: bytes) -> tuple[Take, TakeReport] | TakeError:
        header = header_of(self._contents.headers[binding])
        if header is None:
            return TakeError("the header of another take in it is invalid", where=self._where, advice=COPY)
        try:
            return self._read(binding, header)
        except TakeError as error:
            return error

    def _read(self, binding: bytes, header: dict[str, Any]) -> tuple[Take, TakeReport]:
        rig, garment, words = described(header, self._where)
        version = int(header["format"].partition("/")[2])
        parts, findings = self._contents.of(binding), self._findings
        other_blocks = self._named.blocks - len(parts.blocks)
        strange_ends = [end for end in parts.ends if not is_end(end, version)]
        ends = [end for end in parts.ends if is_end(end, version)]
        nameless = self._all.messages - self._named.messages
        damaged = findings.damaged + self._contents.damaged + nameless + len(strange_ends)
        blocks, strange, is_mixed = in_order(parts.blocks, version)
        before = self._memory.left_out
        columns, kept, lost = decoded(blocks, len(garment.points), version, self._memory)
        columns, kept, out_of_order = increasing(columns, kept) if kept else (columns, kept, 0)
        damaged += strange + lost + self._without - (not parts.blocks)
        if not kept and self._is_being_written:
            raise TakeBegunError("holds no frame yet", where=self._where, advice=UNTIL_WRITTEN)
        if not kept:
            raise _no_frame(ends, damaged, findings.left_packed + self._memory.left_out - before, self._where)
        scans, lost_scans = sound_scans(parts.scans, version, self._memory)
        too_large = self._memory.left_out - before
        unread = findings.left_packed + too_large
        damaged += lost_scans + out_of_order - too_large
        end = ends[-1] if ends else None
        held = Held.of(kept, columns["time"], len(scans))
        spans, missing_frames = missing_spans(held, end)
        lacks_scans = max(end["scans"] - len(scans), 0) if end and "scans" in end else 0
        if end is not None:
            damaged = max(damaged, end["blocks"] - len(kept) - unread)
        damaged += end is not None and not findings.is_whole  # cut off behind the last message
        is_complete = end is not None and not missing_frames and len(kept) == end["blocks"]
        earlier = tuple(possible_spans(words.missing, columns["time"]))
        doubts = [*contradictions(held, ends), *[IMPOSSIBLE_SPANS] * (len(earlier) < len(words.missing))]
        doubts += [*stray_scans(held, scans, spans)] if version == 1 else []
        doubts += [MIXED] * is_mixed
        notes = dict(words.notes)
        if doubts:  # a file written from this take keeps them, beside the import's
            notes["file"] = "; ".join(filter(None, [notes.get("file"), *doubts]))
        report = TakeReport(
            frames=len(columns["time"]), blocks=len(kept), scans=len(scans), damaged_blocks=damaged,
            is_complete=end is not None, missing_frames=missing_frames, missing_scans=lacks_scans, spans=spans,
            earlier=earlier, trailing_bytes=findings.trailing, other_blocks=other_blocks,
            other_takes=len(self._takes) - bool(parts.blocks), unread_blocks=unread, doubts=tuple(doubts),
            earlier_doubts="; ".join(noted_doubts(words.notes)), file=str(self._where),
            is_being_written=self._is_being_written,
            left=left_beside(self._where, rig, garment) if isinstance(self._where, Path) else {},
        )  # fmt: skip
        return Take(
            take_id=words.take_id, created=words.created, rig=rig, garment=garment, source=words.source,
            notes=notes, is_complete=is_complete and not earlier, report=report,
            missing=tuple(sorted((*earlier, *spans))), scans=tuple(scans), **columns,
        ), report  # fmt: skip


def _no_frame(ends: list[Message], damaged: int, unread: int, path: object) -> TakeError:
    if unread:
        what = f"needs more memory in each of its {counted(unread, 'block')} than one file may take"
        return TakeError(what, where=path, advice="keep this file, and record fewer points or frames a second")
    if damaged or (ends and ends[-1]["frames"]):
        detail = f"none of the {ends[-1]['frames']} frames that it had" if ends else "no frame that is sound"
        return TakeError(f"holds {detail}", where=path, advice=COPY)
    why = "the recording ended in its first second" + " or is cut off" * (not ends)
    return TakeError("holds no frame", where=path, advice=why)


def _no_header(raw: bytes, findings: Findings, path: object) -> TakeError:
    """Return the error of a file without a readable header, with the most likely cause."""
    if findings.other_compressions:
        names = ", ".join(sorted(findings.other_compressions))
        return TakeError(
            f"is compressed with {names}, which is not read", where=path,
            advice="compress it with zstd, or not at all",
        )  # fmt: skip
    if raw.startswith(MCAP_MAGIC) and not findings.has_sound_chunk:
        lacking = ["holds messages outside of chunks, which are not read"] * findings.has_loose_messages
        lacking += ["has chunks without a checksum, which are not read"] * findings.lacks_checksum
        if lacking:
            return TakeError(lacking[0], where=path, advice="write its messages in chunks with their CRC-32")
    if raw.startswith(ONI_START):
        return TakeError(
            "is a sensor recording, and no take", where=path,
            advice="give it to `hangtime record --sensor`, which writes a take",
        )  # fmt: skip
    profile = profile_of(raw)
    if profile is not None and not _is_ours(profile):
        detail = f"its profile says {profile}" if profile else "the file is MCAP without a profile"
        return TakeError(f"is not a take archive: {detail}", where=path, advice=NO_TAKE)
    if profile is not None and (other := of_another_version(profile.partition("/")[2], path)) is not None:
        return other
    if findings.largest_refused:
        size = f"{findings.largest_refused} bytes, {LARGEST_CHUNK} bytes at most are read"
        return TakeError(f"cannot be read: a chunk in it unpacks to {size}", where=path, advice=WITH_LESS)
    if raw.startswith(MCAP_MAGIC) or b"hangtime-take" in raw[:4096]:
        why = "the file is not a take archive" if profile is None else "the recording ended in its first second"
        return TakeError("holds no readable header", where=path, advice=f"{why}, or too little of it is left")
    return TakeError("is not a take archive", where=path, advice=NO_TAKE)
