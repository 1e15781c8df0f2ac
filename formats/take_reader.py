"""Read takes: every sound block, also of a damaged file. See `formats/SPEC.md`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import numpy as np

from formats import version_1
from formats.blocks import LATEST, MOST_ROWS, PLACE_STEPS, TICKS, Columns, decode_blocks, widths
from formats.chunks import MCAP_MAGIC, Findings, messages_in, profile_of
from formats.descriptions import check_garment, check_rig
from formats.errors import DescriptionError, TakeError
from formats.garment import Garment
from formats.rig import Rig
from formats.surface import SurfaceScan, decode_scan, places_of
from formats.table_memory import TableMemory
from formats.take import Span, Take
from formats.take_report import TakeReport
from formats.take_writer import MOST_HEADER_BYTES, PROFILE, VERSION, binding_of
from formats.wrong_fields import wrong_field

LARGEST_FILE = 1 << 30  # bytes: ten hours of 81 markers at 120 frames a second are half of it
SEARCHED_BYTES = 1 << 22  # bytes of a file of another profile: a take's header comes again and again
MOST_CONTAINERS = 20_000  # maps and lists of a message: a garment of 2000 points has a third of them
NO_TAKE = "give a file that `hangtime record` or `hangtime import` wrote"


def read_take(path: Path) -> Take:
    """Read a take; of a damaged or cut-off file, what survives (`Take.missing` says what does not).

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


def read_with_report(path: Path) -> tuple[Take, TakeReport]:
    """Read a take, and say how much of it is sound.

    Raises:
        TakeError: as `read_take`.
    """
    return _read(_bytes_of(path), path)


def _bytes_of(path: Path) -> bytes:
    """Return the bytes of a file; of one that is too large or no take only as many as show that."""
    try:
        _refuse_what_has_no_end(path)
        with path.open("rb") as file:
            size = path.stat().st_size
            raw = file.read(SEARCHED_BYTES)
            profile = profile_of(raw)
            if size > LARGEST_FILE:
                told = f" and its profile says {profile}" if profile and not _is_ours(profile) else ""
                most = f"a take has {LARGEST_FILE / 1e9:.1f} GB at most"
                raise TakeError(f"is no take: it has {size / 1e9:.1f} GB{told}", where=path, advice=most)
            is_foreign = profile is not None and not _is_ours(profile)
            if is_foreign and not _has_header(raw):
                return raw
            del raw
            file.seek(0)
            return file.read()
    except OSError as error:
        raise TakeError(f"cannot be read ({error.strerror})", where=path, advice="check the path") from error


def _is_ours(profile: str) -> bool:
    return profile.startswith("hangtime-take/")


def _has_header(raw: bytes) -> bool:
    return any(b"hangtime-take/" in data[:64] for data in messages_in(raw, Findings()))


@dataclass
class _Contents:
    """The messages of a file, by kind; headers by the hash that binds the others to them."""

    headers: dict[bytes, dict[str, Any]] = field(default_factory=dict)
    blocks: list[dict[str, Any]] = field(default_factory=list)
    scans: list[dict[str, Any]] = field(default_factory=list)
    ends: list[dict[str, Any]] = field(default_factory=list)
    damaged: int = 0


def _refuse_what_has_no_end(path: Path) -> None:
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise TakeError("is a pipe or a device", where=path, advice=NO_TAKE)


def _read(raw: bytes, path: object) -> tuple[Take, TakeReport]:
    if not raw:
        raise TakeError("is empty", where=path, advice="give a take archive")
    findings = Findings()
    contents = _sorted(messages_in(raw, findings))
    if not contents.headers:
        raise _no_header(raw, findings, path)
    binding, header = _chosen_header(contents)
    rig, garment, words = _described(header, path)
    version = int(header["format"].partition("/")[2])
    ours = None if version == 1 else binding
    damaged = findings.damaged + contents.damaged
    blocks, strange = _in_order(contents.blocks, ours)
    ends = [end for end in contents.ends if end.get("take") == ours and _is_end(end, version)]
    others = {key for key in contents.headers if key != ours} if version > 1 else set()
    other_blocks = sum(block.get("take") in others for block in contents.blocks)
    other_ends = sum(end.get("take") in others for end in contents.ends)
    damaged += strange - other_blocks + len(contents.ends) - len(ends) - other_ends
    memory = TableMemory.of(len(raw))
    columns, kept, lost = _decoded(blocks, len(garment.points), version, memory)
    columns, kept, out_of_order = _increasing(columns, kept) if kept else (columns, kept, 0)
    if not kept:
        raise _no_frame(ends, damaged + lost, path)
    scans, lost_scans = _scans(contents.scans, ours, version, memory)
    damaged += lost + lost_scans + out_of_order
    end = ends[-1] if ends else None
    spans, missing_frames = _missing(kept, columns["time"], end)
    lacks_scans = max(end["scans"] - len(scans), 0) if end and "scans" in end else 0
    if end is not None:
        damaged = max(damaged, end["blocks"] - len(kept))
    damaged += end is not None and not findings.is_whole  # cut off behind the last message
    is_complete = end is not None and not missing_frames and len(kept) == end["blocks"]
    earlier = tuple((float(a), float(b)) for a, b in words.missing)
    take = Take(
        take_id=words.take_id, created=words.created, rig=rig, garment=garment, source=words.source, notes=words.notes,
        is_complete=is_complete and not earlier, missing=tuple(sorted((*earlier, *spans))),
        scans=tuple(sorted(scans, key=lambda scan: scan.time)), **columns,
    )  # fmt: skip
    return take, TakeReport(
        frames=len(take.time), blocks=len(kept), scans=len(scans), damaged_blocks=damaged, is_complete=end is not None,
        missing_frames=missing_frames, missing_scans=lacks_scans, spans=spans, trailing_bytes=findings.trailing,
        other_blocks=other_blocks,
    )  # fmt: skip


def _no_frame(ends: list[dict[str, Any]], damaged: int, path: object) -> TakeError:
    if damaged or (ends and ends[-1]["frames"]):
        told = f"none of the {ends[-1]['frames']} frames that it had" if ends else "no frame that is sound"
        return TakeError(f"holds {told}", where=path, advice="copy it again from where it was recorded")
    why = "it ended in its first second" + " or is cut off" * (not ends)
    return TakeError("holds no frame", where=path, advice=why)


def _no_header(raw: bytes, findings: Findings, path: object) -> TakeError:
    """Return the error of a file without a header that can be read: it names the cause that is most likely."""
    if findings.other_compressions:
        names = ", ".join(sorted(findings.other_compressions))
        return TakeError(
            f"is compressed with {names}, which is not read", where=path,
            advice="compress it with zstd, or not at all",
        )  # fmt: skip
    profile = profile_of(raw)
    if profile is not None and not _is_ours(profile):
        told = f"its profile says {profile}" if profile else "it is an MCAP file without a profile"
        return TakeError(f"is not a take archive: {told}", where=path, advice=NO_TAKE)
    if raw.startswith(MCAP_MAGIC) or b"hangtime-take" in raw[:4096]:
        return TakeError(
            "holds no readable header", where=path, advice="it is not a take archive, or too little of it is left"
        )
    return TakeError("is not a take archive", where=path, advice=NO_TAKE)


def _sorted(messages: Iterator[bytes]) -> _Contents:
    """Sort messages by kind; one of no kind is damage."""
    contents = _Contents()
    for data in messages:
        content = _unpacked(data)
        if not isinstance(content, dict):
            contents.damaged += 1
        elif "format" in content:
            contents.headers[binding_of(data)] = content
        elif "surface" in content:
            contents.scans.append(content)
        elif "first" in content:
            contents.blocks.append(content)
        elif "blocks" in content:
            contents.ends.append(content)
        else:
            contents.damaged += 1
    return contents


def _unpacked(data: bytes) -> Any:
    """Return the content of a message, None where it is malformed or has too many parts."""
    count = 0

    def counted(container: Any) -> Any:
        nonlocal count
        count += 1
        if count > MOST_CONTAINERS:
            raise ValueError("too many parts")
        return container

    try:
        content = msgpack.unpackb(data, object_hook=counted, list_hook=counted, max_ext_len=0)
    except (ValueError, msgpack.exceptions.UnpackException, RecursionError):
        return None
    is_large = len(data) > MOST_HEADER_BYTES and isinstance(content, dict) and "format" in content
    return None if is_large else content


def _chosen_header(contents: _Contents) -> tuple[bytes, dict[str, Any]]:
    """Return the first header of a finished take; without one that of most blocks, the last one of as many."""
    counts = Counter(block.get("take") for block in contents.blocks if isinstance(block.get("take"), bytes))
    finished = [key for key in contents.headers if any(_finishes(end, key, counts[key]) for end in contents.ends)]
    if finished:
        return finished[0], contents.headers[finished[0]]
    binding = max(contents.headers, key=lambda key: (counts[key], list(contents.headers).index(key)))
    return binding, contents.headers[binding]


def _finishes(end: dict[str, Any], binding: bytes, blocks: int) -> bool:
    """Whether an end is of a take of which most blocks are there; a stray page of another take holds few of its own."""
    return end.get("take") == binding and type(end.get("blocks")) is int and 2 * blocks > max(end["blocks"], 0)


class _Words(msgspec.Struct, frozen=True, kw_only=True):
    """The texts of a header besides its rig and garment."""

    take_id: str
    created: str
    source: str
    notes: dict[str, str]
    missing: tuple[tuple[float, float], ...] = ()


def _described(header: dict[str, Any], path: object) -> tuple[Rig, Garment, _Words]:
    name, _, version = str(header["format"]).partition("/")
    if name != PROFILE.partition("/")[0]:
        raise TakeError(f"is a {header['format']!r}, not a take", where=path, advice="give a take archive")
    if not version.isdecimal() or not 1 <= int(version) <= VERSION:
        raise TakeError(
            f"is of format version {version}; this Hangtime reads up to {VERSION}", where=path, advice="update Hangtime"
        )
    try:
        rig, garment = msgspec.convert(header.get("rig"), Rig), msgspec.convert(header.get("garment"), Garment)
        check_rig(rig, path)
        check_garment(garment, path)
    except msgspec.ValidationError as error:
        words = wrong_field(error, (Rig, Garment))
        raise TakeError(f"its rig or garment does not hold: {words}", where=path, advice="record it again") from error
    except DescriptionError as error:
        raise TakeError(f"its rig or garment does not hold: {error}", where=path, advice="record it again") from error
    try:
        return rig, garment, msgspec.convert(header, _Words)
    except msgspec.ValidationError as error:
        words = wrong_field(error, (_Words,))
        raise TakeError(f"its header does not hold: {words}", where=path, advice="record it again") from error


def _is_number(value: object, least: int, most: int) -> bool:
    return type(value) is int and least <= value <= most


def _is_end(end: dict[str, Any], version: int) -> bool:
    names = ("frames", "blocks") if version == 1 else ("frames", "blocks", "scans")
    times = [end[name] for name in ("from", "until") if name in end]
    return all(_is_number(end.get(name), 0, 2**40) for name in names) and all(
        _is_number(time, -LATEST, LATEST) for time in times
    )


def _in_order(blocks: list[dict[str, Any]], binding: bytes | None) -> tuple[list[dict[str, Any]], int]:
    """Return the blocks of one take by their first frame, and how many others there were; a copy is no damage."""
    found: dict[int, dict[str, Any]] = {}
    strange = 0
    for block in blocks:
        holds = (
            block.get("take") == binding
            and _is_number(block["first"], 0, 2**40)
            and _is_number(block.get("frames"), 1, MOST_ROWS)
            and _is_number(block.get("start"), -LATEST, LATEST)
            and (binding is None or _is_table(block))
        )
        if not holds or found.setdefault(block["first"], block) != block:
            strange += 1
    return [found[first] for first in sorted(found)], strange


def _is_table(block: dict[str, Any]) -> bool:
    steps = block.get("steps")
    return (
        isinstance(block.get("table"), bytes)
        and isinstance(steps, list)
        and len(steps) == 2
        and all(_is_number(step, 0, len(PLACE_STEPS) - 1) for step in steps)
    )


def _decoded(
    blocks: list[dict[str, Any]], points: int, version: int, memory: TableMemory
) -> tuple[Columns, list[dict[str, Any]], int]:
    """Return the columns of the sound blocks, those blocks, and how many were not sound."""
    width = sum(widths(points).values())
    fitting = [block for block in blocks if memory.fits(width * block["frames"])]
    lost = len(blocks) - len(fitting)
    if version == 1:
        decoded, kept = [], []
        for block in fitting:
            try:
                decoded.append(version_1.decode_block(block, points))
                kept.append(block)
            except (ValueError, KeyError, TypeError):
                lost += 1
        names = decoded[0] if decoded else {}
        return {name: np.concatenate([one[name] for one in decoded]) for name in names}, kept, lost
    if not fitting:
        return {}, [], lost + len(fitting)
    columns, sound = decode_blocks(fitting, points)
    kept = [block for block, good in zip(fitting, sound, strict=True) if good]
    return columns, kept, lost + len(fitting) - len(kept)


def _increasing(columns: Columns, kept: list[dict[str, Any]]) -> tuple[Columns, list[dict[str, Any]], int]:
    """Leave out blocks that share frames, or where time does not increase: no writer makes them."""
    rows = np.array([block["frames"] for block in kept])
    time, starts = columns["time"], np.cumsum(rows) - rows
    goes_back = np.concatenate([[False], np.diff(np.maximum.accumulate(time)) <= 0])
    ends = np.maximum.accumulate([block["first"] + block["frames"] for block in kept])
    overlaps = np.concatenate([[False], [block["first"] for block in kept[1:]] < ends[:-1]])
    bad = (np.add.reduceat(goes_back, starts) > 0) | overlaps
    if not bad.any():
        return columns, kept, 0
    stays = np.repeat(~bad, rows)
    sound = [block for block, wrong in zip(kept, bad, strict=True) if not wrong]
    return {name: values[stays] for name, values in columns.items()}, sound, int(bad.sum())


def _scans(
    messages: list[dict[str, Any]], binding: bytes | None, version: int, memory: TableMemory
) -> tuple[list[SurfaceScan], int]:
    """Return the scans of one take, and how many messages are none; a copy is no damage."""
    decode = version_1.decode_scan if version == 1 else decode_scan
    found: dict[Any, dict[str, Any]] = {}
    scans, lost = [], 0
    for content in messages:
        if content.get("take") != binding:
            lost += 1
            continue
        if version > 1 and found.setdefault(repr(content["surface"]), content) is not content:
            lost += found[repr(content["surface"])] != content
            continue
        try:
            if not memory.fits(places_of(content) * 4):
                raise ValueError("too many places")
            scans.append(decode(content))
        except (ValueError, KeyError, TypeError):
            lost += 1
    return scans, lost


def _missing(
    kept: list[dict[str, Any]], time: np.ndarray[Any, np.dtype[np.float64]], end: dict[str, Any] | None
) -> tuple[tuple[Span, ...], int | None]:
    """Return the spans of the sensor's clock whose frames are missing, and how many these are, None if not known."""
    rows = np.array([block["frames"] for block in kept])
    last = np.cumsum(rows) - 1
    begins, ends = time[last - rows + 1], time[last]
    before, spans, frames = 0, [], 0
    until = end["from"] / TICKS if end and "from" in end else -np.inf
    for block, begin, finish in zip(kept, begins, ends, strict=True):
        if block["first"] > before:
            spans.append((float(until), float(begin)))
            frames += block["first"] - before
        before, until = block["first"] + block["frames"], finish
    if end is None:
        spans.append((float(until), float("inf")))
        return tuple(spans), None
    if end["frames"] > before:
        spans.append((float(until), end["until"] / TICKS if "until" in end else float("inf")))
        frames += end["frames"] - before
    return tuple(spans), frames
