"""What another MCAP library finds in a take that was written: every message, its stamps, its counts and its texts."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files

import msgpack
import numpy as np
import pytest
from mcap.reader import make_reader

from formats.archive import TakeWriter, read_take, write_take
from formats.errors import TakeError
from formats.surface import SurfaceScan
from formats.take_writer import MOST_HEADER_BYTES, binding_of, with_room
from tests.formats.test_archive import GARMENT, RIG, a_take, frame_of


def read(path):
    """Return header, summary, and each message as its topic, its stamps and its content."""
    with path.open("rb") as file:
        reader = make_reader(file)
        messages = [(channel, message) for _, channel, message in reader.iter_messages(log_time_order=False)]
        return reader.get_header(), reader.get_summary(), messages


def kinds(messages):
    return [channel.topic.rpartition("/")[2] for channel, _ in messages]


def scan_at(time):
    return SurfaceScan(time=time, grid=np.zeros((2, 2, 3)), contour=np.zeros((3, 3)))


def written(folder, seconds, *, scans=(), offset=0.0, rate=10):
    take = a_take(seconds * rate)
    take.time[:] = np.arange(seconds * rate) / rate + offset
    with TakeWriter(folder / "t.mcap", take_id="t", created="now", rig=RIG, garment=GARMENT) as writer:
        for scan in scans:
            writer.append_scan(scan_at(scan))
        for k in range(len(take.time)):
            writer.append(frame_of(take, k))
    return folder / "t.mcap"


def test_header_schema_and_channels_say_what_the_messages_are(tmp_path):
    path = written(tmp_path, 3, scans=[1.0])
    header = read(path)[0]
    assert (header.profile, header.library) == ("hangtime-take/2", "hangtime")
    with path.open("rb") as file:
        met = list(make_reader(file).iter_messages())
    schema, channels = met[0][0], [channel for _, channel, _ in met]
    specification = files("formats").joinpath("SPEC.md").read_bytes()
    assert (schema.name, schema.encoding, schema.data) == ("hangtime-take", "text/markdown", specification)
    assert {channel.message_encoding for channel in channels} == {"msgpack"}
    assert {channel.schema_id for channel in channels} == {schema.id}
    assert {channel.topic.rpartition("/")[2] for channel in channels} == {"header", "block", "surface", "end"}


def test_statistics_count_the_messages_of_each_kind(tmp_path):
    _, summary, messages = read(written(tmp_path, 4, scans=[0.5, 0.75]))
    names = {channel.id: kind for kind, (channel, _) in zip(kinds(messages), messages, strict=True)}
    counts = {names[number]: count for number, count in summary.statistics.channel_message_counts.items()}
    assert counts == {kind: kinds(messages).count(kind) for kind in counts}
    assert (counts["block"], counts["surface"], counts["end"]) == (4, 2, 1)
    assert summary.statistics.message_count == len(messages)


@pytest.mark.parametrize("offset", [0.0, 5.25, -3.0])
def test_messages_bear_the_time_of_their_block_or_of_the_last_frame_but_none_before_zero(tmp_path, offset):
    """The first header and a scan come before any frame, at 0."""
    _, _, messages = read(written(tmp_path, 3, scans=[offset], offset=offset))
    starts = [
        msgpack.unpackb(message.data)["start"] for channel, message in messages if channel.topic.endswith("block")
    ]
    assert starts[0] == round(1e6 * offset)
    stamps = iter(starts)
    for channel, message in messages:
        kind = channel.topic.rpartition("/")[2]
        if kind == "block":
            expected = next(stamps)
        elif kind == "end" or (kind == "header" and message is messages[-2][1]):
            expected = round(1e6 * (offset + 2.9))
        elif message.log_time:
            assert kind == "header"  # between blocks: of the last frame by then
            continue
        else:
            expected = 0
        assert message.log_time == message.publish_time == max(1000 * expected, 0), kind


def test_the_end_message_counts_frames_blocks_and_scans_and_says_when_they_are(tmp_path):
    _, _, messages = read(written(tmp_path, 3, scans=[1.5], offset=1.0))
    found = {kind: msgpack.unpackb(message.data) for kind, (_, message) in zip(kinds(messages), messages, strict=True)}
    header = messages[0][1].data
    blocks = [msgpack.unpackb(message.data) for channel, message in messages if channel.topic.endswith("block")]
    assert found["end"] == {
        "take": binding_of(header), "frames": 30, "blocks": len(blocks), "scans": 1, "from": 1_000_000,
        "until": 3_900_000,
    }  # fmt: skip
    assert {block["take"] for block in blocks} == {found["surface"]["take"]} == {binding_of(header)}
    assert sum(block["frames"] for block in blocks) == 30
    assert [block["first"] for block in blocks] == np.cumsum([0, *(b["frames"] for b in blocks[:-1])]).tolist()


def test_the_header_comes_again_behind_the_second_block_at_every_thirty_and_before_the_end(tmp_path):
    path = written(tmp_path, 70, rate=2)
    _, _, messages = read(path)
    found = kinds(messages)
    assert (found[0], found[-2:]) == ("header", ["header", "end"])
    before = [found[:k].count("block") for k, kind in enumerate(found) if kind == "header"]
    assert len({message.data for channel, message in messages if channel.topic.endswith("header")}) == 1
    assert before[0] == 0
    assert before[-1] == found.count("block")
    assert set(np.diff(before[1:-1])) <= {30}
    assert len(before) >= 4


@pytest.mark.parametrize("is_at_once", [True, False])
def test_frames_are_the_same_whether_they_are_written_one_by_one_or_at_once(tmp_path, is_at_once):
    take = a_take(95)
    take.time[:] = np.arange(95) / 32
    if is_at_once:
        path = write_take(tmp_path / "t.mcap", take)
    else:
        with TakeWriter(tmp_path / "t.mcap", take_id="a", created="now", rig=RIG, garment=GARMENT) as writer:
            for k in range(95):
                writer.append(frame_of(take, k))
                assert writer.is_readable is (k >= 32)
        path = tmp_path / "t.mcap"
    rows = [msgpack.unpackb(m.data)["frames"] for c, m in read(path)[2] if c.topic.endswith("block")]
    assert rows == [33, 33, 29]
    np.testing.assert_allclose(read_take(path).time, take.time, atol=0.5e-6)


def test_a_second_scan_at_one_time_is_refused_to_the_microsecond(tmp_path):
    with TakeWriter(tmp_path / "t.mcap", take_id="t", created="now", rig=RIG, garment=GARMENT) as writer:
        writer.append_scan(scan_at(1.0))
        writer.append_scan(scan_at(1.000001))
        with pytest.raises(TakeError) as caught:
            writer.append_scan(scan_at(1.0000001))
        assert str(caught.value) == "t: has two scans of the surface at one time; keep one of them"
        writer.append(frame_of(a_take(2), 0))
    assert len(read_take(tmp_path / "t.mcap").scans) == 2


def size_of(folder, notes):
    """Bytes of the header of a take with these notes."""
    write_take(folder / "t.mcap", replace(a_take(3), notes=notes))
    return len(read(folder / "t.mcap")[2][0][1].data)


@pytest.mark.parametrize("letter", ["x", "\u00e9", "\U0001f455"])
@pytest.mark.parametrize("beyond", [1, 2, 3, 4, 5000])
def test_the_longest_note_is_cut_to_what_a_header_has_room_for(tmp_path, letter, beyond):
    """No letter is halved, and nothing else is cut."""
    room = MOST_HEADER_BYTES - size_of(tmp_path, {"long": "", "b": "stays"})
    text = letter * ((room + beyond + 64) // len(letter.encode()))
    cut = with_room(replace(a_take(3), notes={"long": text, "b": "stays"}))
    assert cut.notes["b"] == "stays"
    assert cut.notes["long"].endswith(" [cut]")
    kept = cut.notes["long"].removesuffix(" [cut]")
    assert text.startswith(kept)
    assert MOST_HEADER_BYTES - 16 <= size_of(tmp_path, cut.notes) <= MOST_HEADER_BYTES


def test_notes_that_have_room_are_left_whole():
    take = replace(a_take(3), notes={"long": "x" * 1000})
    assert with_room(take) is take
