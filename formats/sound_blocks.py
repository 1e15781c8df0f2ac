"""Decode the sound blocks and scans of one take, within the memory limit of its file. See `formats/SPEC.md`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from formats import version_1
from formats.blocks import FARTHEST_PLACE, LATEST, MOST_ROWS, PLACE_STEPS, Columns, decode_blocks, widths
from formats.surface import SurfaceScan, decode_scan, places_of
from formats.table_memory import NUMBERS_AT_ONCE, TableMemory
from formats.take_messages import Message

SCAN_NUMBERS = 7  # of a scan's position: four in the table, and three after decoding


def is_number(value: object, least: int, most: int) -> bool:
    """Return whether a value is a whole number from `least` to `most`."""
    return type(value) is int and least <= value <= most


def in_order(blocks: list[Message], version: int) -> tuple[list[Message], int, bool]:
    """Return the blocks of one take by first frame, the number of rejected blocks, and whether blocks conflict.

    An exact copy is no damage. Two sound blocks conflict where they begin with the same frame and differ. Then two
    takes have the same header.
    """
    found: dict[int, Message] = {}
    strange, is_mixed = 0, False
    for block in blocks:
        holds = (
            is_number(block["first"], 0, 2**40)
            and is_number(block.get("frames"), 1, MOST_ROWS)
            and is_number(block.get("start"), -LATEST, LATEST)
            and (version == 1 or _is_table(block))
        )
        differs = holds and found.setdefault(block["first"], block) != block
        is_mixed |= differs
        strange += differs or not holds
    return [found[first] for first in sorted(found)], strange, is_mixed


def _is_table(block: Message) -> bool:
    steps = block.get("steps")
    return (
        isinstance(block.get("table"), bytes)
        and isinstance(steps, list)
        and len(steps) == 2
        and all(is_number(step, 0, len(PLACE_STEPS) - 1) for step in steps)
    )


def decoded(
    blocks: list[Message], points: int, version: int, memory: TableMemory
) -> tuple[Columns, list[Message], int]:
    """Return the columns of the sound blocks, these blocks, and the number of the other blocks."""
    width = sum(widths(points).values())
    fitting = [block for block in blocks if memory.fits(width * block["frames"], block.own)]
    columns: Columns = {}
    kept: list[Message] = []
    rows = 0
    for batch in _batches(fitting, NUMBERS_AT_ONCE // width if version > 1 else 0):
        part, good = decode_blocks(batch, points) if version > 1 else _of_version_1(batch[0], points)
        part, sound = _within_reach(part, [block for block, holds in zip(batch, good, strict=True) if holds])
        kept += sound
        if len(batch) == len(fitting):
            return part, kept, len(blocks) - len(kept)
        if not columns:
            total = sum(block["frames"] for block in fitting)
            columns = {name: np.empty((total, *values.shape[1:]), values.dtype) for name, values in part.items()}
        end = rows + len(part.get("time", ()))
        for name, values in part.items():
            columns[name][rows:end] = values
        rows = end
    return {name: values[:rows] for name, values in columns.items()}, kept, len(blocks) - len(kept)


def _batches(blocks: list[Message], rows: int) -> Iterator[list[Message]]:
    """Yield batches of blocks with at most `rows` rows together, or single larger blocks."""
    batch: list[Message] = []
    count = 0
    for block in blocks:
        if batch and count + block["frames"] > rows:
            yield batch
            batch, count = [], 0
        batch.append(block)
        count += block["frames"]
    if batch:
        yield batch


def _of_version_1(block: Message, points: int) -> tuple[Columns, list[bool]]:
    try:
        return version_1.decode_block(block, points), [True]
    except (ValueError, KeyError, TypeError):
        return {}, [False]


def _within_reach(columns: Columns, blocks: list[Message]) -> tuple[Columns, list[Message]]:
    """Leave out blocks with a position beyond the limit of all writers."""
    if not blocks:
        return columns, blocks
    most = FARTHEST_PLACE + PLACE_STEPS.max()  # steps are not exact in binary
    is_far = np.any([(np.abs(columns[name]) > most).any((1, 2)) for name in ("held", "markers", "points")], 0)
    rows = np.array([block["frames"] for block in blocks])
    bad = np.logical_or.reduceat(is_far, np.cumsum(rows) - rows)
    if not bad.any():
        return columns, blocks
    stays = np.repeat(~bad, rows)
    near = [block for block, is_bad in zip(blocks, bad, strict=True) if not is_bad]
    return {name: values[stays] for name, values in columns.items()}, near


def increasing(columns: Columns, kept: list[Message]) -> tuple[Columns, list[Message], int]:
    """Leave out blocks that share frames, or in which time does not increase, since no writer makes them.

    `columns` is emptied.
    """
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
    return {name: columns.pop(name)[stays] for name in tuple(columns)}, sound, int(bad.sum())


def sound_scans(messages: list[Message], version: int, memory: TableMemory) -> tuple[list[SurfaceScan], int]:
    """Return the scans of one take by time, and the number of damaged messages; an exact copy is no damage."""
    decode = version_1.decode_scan if version == 1 else decode_scan
    found: dict[int, Message] = {}
    scans, lost = [], 0
    for content in messages:
        time = content["surface"]
        if not is_number(time, -LATEST, LATEST):
            lost += 1
            continue
        if time in found:
            lost += found[time] != content
            continue
        try:
            if not memory.fits(places_of(content) * SCAN_NUMBERS, content.own, may_rest=False):
                raise ValueError("too many places")
            scans.append(decode(content))
            found[time] = content
        except (ValueError, KeyError, TypeError):
            lost += 1
    return sorted(scans, key=lambda scan: scan.time), lost
