"""Which blocks, scans and ends of a take are sound: on both sides of each bound, in any order, and twice."""

from __future__ import annotations

import msgpack
import numpy as np
import pytest

from formats.blocks import LATEST, MOST_ROWS, STORED, encode_blocks
from formats.sound_blocks import _batches, _within_reach, decoded, in_order, increasing, sound_scans
from formats.surface import encode_scan, places_of
from formats.table_memory import TableMemory
from formats.take_end import Held, contradictions, is_end, missing_spans
from formats.take_messages import Contents, Message, Parts
from tests.formats.test_archive import a_scan, a_take

BLOCK = {"first": 0, "frames": 1, "start": 0, "steps": [0, 2], "table": b""}


def message(content, own=1000):
    return Message(content, own)


def without(name):
    return {key: value for key, value in BLOCK.items() if key != name}


@pytest.mark.parametrize(
    ("changes", "is_sound"),
    [
        ({}, True), ({"first": 2**40}, True), ({"first": 2**40 + 1}, False), ({"first": -1}, False),
        ({"first": True}, False), ({"frames": MOST_ROWS}, True), ({"frames": MOST_ROWS + 1}, False),
        ({"frames": 0}, False), ({"frames": 1.0}, False), ({"start": LATEST}, True), ({"start": -LATEST}, True),
        ({"start": LATEST + 1}, False), ({"start": -LATEST - 1}, False), ({"steps": [2, 0]}, True),
        ({"steps": [0, 3]}, False), ({"steps": [-1, 0]}, False), ({"steps": [0]}, False), ({"steps": [0, 0, 0]}, False),
        ({"steps": None}, False), ({"table": "text"}, False), ({"table": None}, False),
    ],
)  # fmt: skip
def test_a_block_is_one_where_its_numbers_can_be(changes, is_sound):
    found, strange, is_mixed = in_order([message(BLOCK | changes)], 2)
    assert (len(found), strange, is_mixed) == (int(is_sound), int(not is_sound), False)


@pytest.mark.parametrize("name", ["frames", "start", "steps", "table"])
def test_a_block_without_one_of_its_fields_is_none_and_in_version_1_needs_no_table(name):
    assert in_order([message(without(name))], 2)[1] == 1
    assert in_order([message(without(name))], 1)[1] == (name in ("frames", "start"))


def test_blocks_come_by_their_first_frame_and_a_copy_is_no_damage():
    blocks = [message(BLOCK | {"first": first}) for first in (7, 3, 7, 0)]
    found, strange, is_mixed = in_order(blocks, 2)
    assert [block["first"] for block in found] == [0, 3, 7]
    assert (strange, is_mixed) == (0, False)
    blocks.append(message(BLOCK | {"first": 3, "start": 1}))
    found, strange, is_mixed = in_order(blocks, 2)
    assert ([block["start"] for block in found], strange, is_mixed) == ([0, 0, 0], 1, True)


@pytest.mark.parametrize(
    ("frames", "rows", "batches"),
    [
        ([3, 3, 3], 6, [2, 1]), ([3, 3, 3], 9, [3]), ([3, 3, 3], 5, [1, 1, 1]), ([9, 1, 1], 3, [1, 2]),
        ([2, 2], 0, [1, 1]),
        ([], 3, []),
    ],
)  # fmt: skip
def test_blocks_are_decoded_together_up_to_so_many_rows(frames, rows, batches):
    blocks = [message(BLOCK | {"frames": count}) for count in frames]
    assert [len(batch) for batch in _batches(blocks, rows)] == batches


@pytest.mark.parametrize(
    ("firsts", "times", "kept"),
    [
        ([0, 2, 4], [[0, 1], [2, 3], [4, 5]], [0, 1, 2]),
        ([0, 1, 4], [[0, 1], [2, 3], [4, 5]], [0, 2]),
        ([0, 9, 12], [[0, 1], [1, 3], [4, 5]], [0, 2]),
        ([0, 2, 4], [[0, 1], [9, 3], [10, 11]], [0, 2]),
        ([0, 2, 4], [[0, 9], [2, 3], [10, 11]], [0, 2]),
        ([0, 2, 4], [[0, 1], [2, 2], [3, 4]], [0, 2]),
        ([0, 2, 4], [[0, 9], [2, 3], [4, 11]], [0]),
    ],
    ids=["in order", "shared frames", "no time between", "back within", "back behind", "stands still", "all behind"],
)
def test_blocks_of_shared_frames_or_of_time_that_does_not_go_on_are_left_out(firsts, times, kept):
    blocks = [message(BLOCK | {"first": first, "frames": 2}) for first in firsts]
    time = np.array(times, float).ravel()
    columns, sound, bad = increasing({"time": time, "state": np.arange(6)}, blocks)
    assert [block["first"] for block in sound] == [firsts[k] for k in kept]
    assert bad == 3 - len(kept)
    assert columns["time"].tolist() == [instant for k in kept for instant in times[k]]
    assert columns["state"].tolist() == [row for k in kept for row in (2 * k, 2 * k + 1)]


@pytest.mark.parametrize("name", ["held", "markers", "points"])
@pytest.mark.parametrize(("place", "is_kept"), [(1000.0, True), (-1000.0, True), (1000.001, False), (-1001.0, False)])
def test_a_block_with_a_position_beyond_a_kilometre_is_left_out(name, place, is_kept):
    """Of blocks of 1, 2 and 1 frames; the position is in the last frame of the second one."""
    blocks = [message(BLOCK | {"first": first, "frames": frames}) for first, frames in ((0, 1), (1, 2), (3, 1))]
    columns = {"held": np.zeros((4, 2, 3)), "markers": np.zeros((4, 2, 3)), "points": np.zeros((4, 5, 3))}
    columns[name][2, 1, 2] = place
    found, kept = _within_reach(columns, blocks)
    assert [block["first"] for block in kept] == ([0, 1, 3] if is_kept else [0, 3])
    assert [len(values) for values in found.values()] == [4 if is_kept else 2] * 3


@pytest.mark.parametrize(
    ("blocks", "counted", "is_finished"), [(2, 4, False), (3, 4, True), (2, 3, True), (0, 0, False), (1, -3, True)]
)
def test_a_take_is_finished_that_has_more_than_half_of_the_blocks_that_its_end_counts(blocks, counted, is_finished):
    """A finished take comes before one of more blocks, another take behind it."""
    first = Parts([message(BLOCK)] * blocks, ends=[message(END | {"blocks": counted})])
    contents = Contents(headers={b"first": b"", b"more": b""})
    contents.parts.update({b"first": first, b"more": Parts([message(BLOCK)] * 5)})
    assert list(contents.by_preference()) == ([b"first", b"more"] if is_finished else [b"more", b"first"])


def scans_of(*contents):
    found, lost = sound_scans([message(content, 10**6) for content in contents], 2, TableMemory())
    return [scan.time for scan in found], lost


def test_scans_come_in_the_order_of_time_and_a_copy_is_no_damage():
    one, two, other = (encode_scan(a_scan(time, seed)) for time, seed in ((0.4, 1), (0.6, 2), (0.4, 3)))
    assert scans_of(two, one, one) == ([0.4, 0.6], 0)
    assert scans_of(one, other) == ([0.4], 1)
    assert scans_of(one, two | {"grid": b"x"}) == ([0.4], 1)
    assert scans_of(one, two | {"contour": None}, two | {"surface": 0.6}, two | {"grid_size": -1}) == ([0.4], 3)
    assert scans_of(other | {"grid": b"x"}, one, two) == ([0.4, 0.6], 1)  # a damaged one hides no sound one of its time
    assert scans_of(one | {"surface": LATEST}, two | {"surface": -LATEST}) == ([-(10.0**10), 10.0**10], 0)
    assert scans_of(one | {"surface": LATEST + 1}, two | {"surface": -LATEST - 1}) == ([], 2)


END = {"frames": 5, "blocks": 2, "scans": 0}


@pytest.mark.parametrize(
    ("changes", "version", "is_one"),
    [
        ({}, 2, True), ({"frames": 2**40}, 2, True), ({"frames": 2**40 + 1}, 2, False), ({"blocks": -1}, 2, False),
        ({"scans": None}, 2, False), ({"scans": None}, 1, True), ({"blocks": None}, 1, False),
        ({"from": LATEST}, 2, True),
        ({"from": LATEST + 1}, 2, False), ({"until": -LATEST}, 2, True), ({"until": -LATEST - 1}, 2, False),
        ({"until": 1.0}, 2, False), ({"frames": True}, 2, False),
    ],
)  # fmt: skip
def test_an_end_is_one_where_its_counts_and_times_can_be(changes, version, is_one):
    assert is_end(message(END | changes), version) == is_one


def held(*first):
    """Blocks of two frames, 10 and 11 hundredths of a second after each frame's number in tenths."""
    starts = np.array(first)
    return Held(starts, np.full(len(first), 2), starts / 10, (starts + 1) / 10, 0)


INF = np.inf


@pytest.mark.parametrize(
    ("first", "end", "spans", "frames"),
    [
        ((0, 2), {"frames": 4}, (), 0),
        ((0, 2), None, ((0.3, INF),), None),
        ((0, 4), {"frames": 6}, ((0.1, 0.4),), 2),
        ((2, 4), {"frames": 6}, ((-INF, 0.2),), 2),
        ((2, 4), {"frames": 6, "from": 50_000}, ((0.05, 0.2),), 2),
        ((2, 4), {"frames": 6, "from": 200_000}, ((-INF, 0.2),), 2),
        ((0, 2), {"frames": 7}, ((0.3, INF),), 3),
        ((0, 2), {"frames": 7, "until": 650_000}, ((0.3, 0.65),), 3),
        ((0, 2), {"frames": 7, "until": 300_000}, ((0.3, INF),), 3),
        ((0, 4, 9), {"frames": 12, "until": 1_150_000}, ((0.1, 0.4), (0.5, 0.9), (1.0, 1.15)), 6),
        ((0, 4), None, ((0.1, 0.4), (0.5, INF)), None),
        ((0, 2), {"frames": 3}, (), 0),
    ],
)
def test_missing_frames_are_those_between_blocks_and_to_the_end(first, end, spans, frames):
    assert missing_spans(held(*first), None if end is None else message(end)) == (spans, frames)


@pytest.mark.parametrize(
    ("ends", "doubts"),
    [
        ([], []),
        ([END | {"frames": 4}], []),
        ([END | {"frames": 5}], []),
        ([END | {"frames": 4}, END | {"frames": 4}], []),
        ([END | {"frames": 5}, END | {"frames": 4}], ["its several ends differ"]),
        ([END | {"frames": 3}], ["its end counts 3 frames, and there are 4"]),
        ([END | {"frames": 4, "blocks": 1}], ["its end counts 1 block, and there are 2"]),
        ([END | {"frames": 4, "from": 1, "until": 299_999}], []),
        ([END | {"frames": 4, "from": 2}],
         ["its end says that it begins at 0.000002 s, and its first frame is of 0.000000 s"]),
        ([END | {"frames": 4, "until": 299_998}],
         ["its end says that it ends at 0.299998 s, and its last frame is of 0.300000 s"]),
        ([END | {"frames": 4, "until": 300_002}],
         ["its end says that it ends at 0.300002 s, and its last frame is of 0.300000 s"]),
        ([END | {"frames": 5, "until": 400_000}], []),
        ([END | {"frames": 5, "until": 299_998}],
         ["its end says that it ends at 0.299998 s, and its last frame is of 0.300000 s"]),
    ],
)  # fmt: skip
def test_an_end_that_its_blocks_contradict_is_named_to_the_microsecond(ends, doubts):
    assert list(contradictions(held(0, 2), [message(end) for end in ends])) == doubts


def test_a_message_keeps_the_fields_that_a_reader_knows():
    content = msgpack.unpackb(msgpack.packb({"take": b"1", "first": 3, "stranger": 4}))
    assert (dict(message(content, 7)), message(content, 7).own) == ({"take": b"1", "first": 3}, 7)


def test_a_scan_has_the_square_of_its_grid_and_its_contour_of_positions():
    assert places_of({"grid_size": 12, "contour_size": 96}) == 12 * 12 + 96


@pytest.mark.parametrize("damaged", [(), (1,), (0, 2)])
def test_blocks_whose_tables_are_damaged_are_counted(damaged):
    take = a_take(90)
    columns = {name: getattr(take, name) for name in STORED if getattr(take, name) is not None}
    columns |= {name: np.full(90, np.nan) for name in ("quality", "pitch", "pitch_sd")}
    columns["points_hidden"] = np.zeros((90, 4), bool)
    blocks = [message(block, 10**5) for block in encode_blocks(columns, np.array([30, 30, 30]), 0)]
    for k in damaged:
        blocks[k]["table"] = b"damaged"
    found, kept, lost = decoded(blocks, 4, 2, TableMemory())
    assert [block["first"] for block in kept] == [30 * k for k in range(3) if k not in damaged]
    assert (lost, len(found["time"])) == (len(damaged), 30 * len(kept))
