""".oni recordings: the writer's files, and the reader's summaries of their records."""

from __future__ import annotations

import math
import os
import resource
import struct
from pathlib import Path

import msgspec
import numpy as np
import pytest

from firmware_host.errors import RecordingError
from firmware_host.oni_records import RECORD_HEADER, RecordType, read_records, summarise
from firmware_host.oni_writer import OniWriter
from tests.firmware_host.scenes import SMALL, payload_of, picture, write_pictures, write_recording


def test_six_frames_written_are_six_frames_counted(tmp_path: Path) -> None:
    found = summarise(write_recording(tmp_path / "a.oni", 6))
    assert (found.depth_frames, found.colour_frames, found.is_complete) == (6, 6, True)


def test_a_recording_cut_in_its_last_frame_counts_five_of_six(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 6)
    last = [r for r in read_records(path) if r.type == RecordType.NEW_DATA][-2]
    path.write_bytes(path.read_bytes()[: payload_of(last).start + 10])
    found = summarise(path)
    assert (found.depth_frames, found.colour_frames, found.is_complete) == (5, 5, False)


def test_a_broken_record_names_its_byte(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 6)
    third = [r for r in read_records(path) if r.type == RecordType.NEW_DATA][2]
    data = bytearray(path.read_bytes())
    data[third.position] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=f"a.oni: the recording is damaged at byte {third.position}; copy"):
        summarise(path)


def test_a_bit_in_the_name_or_the_length_of_any_property_is_found(tmp_path: Path) -> None:
    """The player has no look at either: such a bit ends the process."""
    path = write_recording(tmp_path / "a.oni", 2)
    whole = path.read_bytes()
    properties = [r for r in read_records(path) if r.type in (RecordType.INT_PROPERTY, RecordType.GENERAL_PROPERTY)]
    assert len(properties) == 25
    for record in properties:
        name_size = int.from_bytes(record.fields[:4], "little")
        # Lengths of name and value, the highest bit of a letter, and the name's end.
        for at, bit in ((0, 0x02), (3, 0x80), (6, 0x80), (4 + name_size - 1, 0x40), (4 + name_size, 0x04)):
            data = bytearray(whole)
            data[record.position + RECORD_HEADER.size + at] ^= bit
            path.write_bytes(data)
            with pytest.raises(RecordingError, match=f"the recording is damaged at byte {record.position}; copy"):
                summarise(path)


def test_a_header_that_speaks_of_two_thousand_million_streams_is_damaged(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 2)
    data = bytearray(path.read_bytes())
    data[23] ^= 0x80
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="the recording is damaged at byte 20; copy"):
        summarise(path)


def test_a_field_of_view_of_another_size_than_the_players_is_found(tmp_path: Path) -> None:
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL) as writer:
        writer._property(RecordType.GENERAL_PROPERTY, 1, "xnFOV", bytes(24))
        writer.write_depth(1000, picture(0)[0])
    with pytest.raises(RecordingError, match="the recording is damaged at byte"):
        summarise(path)


@pytest.mark.parametrize(
    ("frames", "size", "before"),
    [(6, 50, "depth frame"), (6, 20, "record"), (6, 4, "record"), (0, 0, "depth frame")],
)
def test_a_recording_cut_off_before_its_first_depth_frame_is_to_be_copied_again(
    tmp_path: Path, frames: int, size: int, before: str
) -> None:
    path = write_recording(tmp_path / "a.oni", frames)
    end = next((r.position for r in read_records(path) if r.type == RecordType.END), None)
    path.write_bytes(path.read_bytes()[: size or end])
    with pytest.raises(RecordingError) as refused:
        summarise(path)
    told = f"is cut off at byte {size or end}, before its first {before}; copy it again from its source, or"
    assert told in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"NI1", b"\x89PNG" + bytes(60), bytes(1000)])
def test_another_kind_of_file_is_refused_with_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "photo.oni"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"photo.oni: this is not an \.oni recording; give"):
        summarise(path)


def test_a_recording_without_depth_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.oni"
    OniWriter(path, SMALL).close()
    with pytest.raises(RecordingError, match="holds no depth frame"):
        summarise(path)


def test_a_missing_folder_is_refused_when_the_recording_begins(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be written"):
        OniWriter(tmp_path / "absent" / "a.oni", SMALL)


def test_the_rate_of_frames_that_come_in_turn_sooner_and_later_is_their_mean(tmp_path: Path) -> None:
    """Intervals of 41 and 25 ms in turn are 30 frames a second, with a pause of 0.9 s left out."""
    with OniWriter(tmp_path / "a.oni", SMALL) as writer:
        write_pictures(
            writer, 24, lambda k: 1000 + 33_000 * k + 8000 * (k % 2) + 900_000 * (k > 15),
            lambda k: 2000 + 33_000 * k + 8000 * (k % 2) + 900_000 * (k > 15),
        )  # fmt: skip
    found = summarise(tmp_path / "a.oni").interval_us
    assert found == pytest.approx(33_000, rel=0.07)  # 11 of 23 intervals: 7 long ones, 4 short ones


@pytest.mark.parametrize(
    ("intervals", "mean"), [((33,), 33), ((33, 35), 34), ((33, 1000, 33), 33), ((33, 34, 35, 900), 34.5)]
)
def test_a_pause_among_few_frames_leaves_the_rate_as_it_is(tmp_path: Path, intervals: tuple[int], mean: float) -> None:
    begins = [1000 * sum(intervals[:k]) for k in range(len(intervals) + 1)]
    with OniWriter(tmp_path / "a.oni", SMALL) as writer:
        write_pictures(writer, len(begins), lambda k: 1000 + begins[k], lambda k: 2000 + begins[k])
    assert summarise(tmp_path / "a.oni").interval_us == pytest.approx(1000 * mean)


def test_time_stamps_that_the_player_would_drop_are_refused(tmp_path: Path) -> None:
    depth, _ = picture(0)
    with OniWriter(tmp_path / "a.oni", SMALL) as writer:
        with pytest.raises(ValueError, match="above 0"):
            writer.write_depth(0, depth)
        writer.write_depth(500, depth)
        with pytest.raises(ValueError, match="500 after 500"):
            writer.write_depth(500, depth)


def test_a_disk_that_is_full_at_the_end_raises_our_error_and_the_file_is_closed(tmp_path: Path) -> None:
    """The process may write no file longer than this one is before its last records."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    writer = OniWriter(tmp_path / "a.oni", SMALL)
    writer.write_depth(1000, picture(0)[0])
    writer._file.flush()
    resource.setrlimit(resource.RLIMIT_FSIZE, (writer.path.stat().st_size, limits[1]))
    try:
        with pytest.raises(
            RecordingError, match=r"a.oni: writing the recording failed \(File too large\); raise the limit"
        ):
            writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert writer._file.closed


def test_a_frame_of_another_size_or_type_is_refused(tmp_path: Path) -> None:
    with OniWriter(tmp_path / "a.oni", SMALL) as writer:
        with pytest.raises(ValueError, match="stream is"):
            writer.write_depth(1, np.zeros((64, 48), np.uint16))
        with pytest.raises(ValueError, match="int64"):
            writer.write_depth(1, np.zeros((48, 64), np.int64))


def test_numbers_up_to_the_count_of_frames_are_within_it(tmp_path: Path) -> None:
    assert summarise(write_recording(tmp_path / "a.oni", 6)).beyond == 0


def test_an_interval_across_a_dropped_frame_is_none(tmp_path: Path) -> None:
    """Numbers 1, 2, 4 at 1, 2 and 5 ms: one interval of 1 ms."""
    path = tmp_path / "a.oni"
    with OniWriter(path, SMALL, with_colour=False) as writer:
        for stamp in (1000, 2000, 5000):
            writer.write_depth(stamp, picture(0)[0])
    third = [record for record in read_records(path) if record.type == RecordType.NEW_DATA][2]
    data = bytearray(path.read_bytes())
    data[third.position + RECORD_HEADER.size + 8] = 4
    path.write_bytes(data)
    found = summarise(path)
    assert (found.interval_us, found.beyond) == (1000, 1)


def test_a_payload_of_two_thousand_million_bytes_is_damage_and_no_cut(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 6)
    third = [record for record in read_records(path) if record.type == RecordType.NEW_DATA][2]
    data = bytearray(path.read_bytes())
    data[third.position + 19] ^= 0x80  # the highest byte of the payload's size
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=f"the recording is damaged at byte {third.position}; copy"):
        summarise(path)


@pytest.mark.parametrize(("nodes", "is_sound"), [(255, True), (256, False)])
def test_a_header_states_255_streams_at_most(tmp_path: Path, nodes: int, is_sound: bool) -> None:
    path = write_recording(tmp_path / "a.oni", 2)
    data = bytearray(path.read_bytes())
    data[20:24] = nodes.to_bytes(4, "little")
    path.write_bytes(data)
    if is_sound:
        assert summarise(path).depth_frames == 2
    else:
        with pytest.raises(RecordingError, match="the recording is damaged at byte 20; copy"):
            summarise(path)


def test_the_views_of_unequal_focal_lengths_are_those_of_width_and_height(tmp_path: Path) -> None:
    """Twice the arc tangents of 32 / 50 and 24 / 40."""
    path = tmp_path / "a.oni"
    with OniWriter(path, msgspec.structs.replace(SMALL, fx=50.0, fy=40.0), with_colour=False) as writer:
        writer.write_depth(1000, picture(0)[0])
    view = next(record.fields for record in read_records(path) if record.fields[4:10] == b"xnFOV\0")
    assert struct.unpack("<dd", view[-16:]) == pytest.approx((2 * math.atan(32 / 50), 2 * math.atan(24 / 40)))


def test_each_frame_leads_back_to_the_one_before_of_its_stream(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 4)
    raw = path.read_bytes()
    before = {1: 0, 2: 0}
    for record in read_records(path):
        if record.type == RecordType.NEW_DATA:
            assert RECORD_HEADER.unpack_from(raw, record.position)[-1] == before[record.node]
            before[record.node] = record.position


def test_a_closed_recording_is_whole_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    monkeypatch.setattr("os.fsync", lambda handle: sizes.append(os.fstat(handle).st_size))
    path = write_recording(tmp_path / "a.oni", 2)
    assert sizes == [path.stat().st_size]


def test_each_stream_begins_once_and_states_its_formats_and_sizes(tmp_path: Path) -> None:
    """Depth in millimetres is format 100, colour of three bytes 200; of the older interface, 4 and 1 (OniCTypes.h)."""
    records = list(read_records(write_recording(tmp_path / "a.oni", 3)))
    assert [record.node for record in records if record.type == RecordType.DATA_BEGIN] == [1, 2]
    stated: dict[int, dict[str, int]] = {1: {}, 2: {}}
    for record in records:
        if record.type == RecordType.INT_PROPERTY:
            (length,) = struct.unpack_from("<I", record.fields)
            name = record.fields[4 : 3 + length].decode()
            stated[record.node][name] = struct.unpack("<Q", record.fields[-8:])[0]
    common = {
        "xnIsGenerating": 1, "xnSupportedMapOutputModesCount": 1, "Cropping": 1, "Mirror": 1, "xnMirror": 0,
    }  # fmt: skip
    pixels = SMALL.width * SMALL.height
    depth = {"oniRequiredFrameSize": 2 * pixels, "xnPixelFormat": 4, "oniPixelFormat": 100, "xnDeviceMaxDepth": 10000}
    colour = {"oniRequiredFrameSize": 3 * pixels, "xnPixelFormat": 1, "oniPixelFormat": 200}
    assert stated == {1: common | depth, 2: common | colour}


def test_a_recording_without_colour_takes_none_and_may_be_closed_twice(tmp_path: Path) -> None:
    with OniWriter(tmp_path / "a.oni", SMALL, with_colour=False) as writer:
        with pytest.raises(ValueError, match="was opened without colour"):
            writer.write_colour(1000, picture(0)[1])
        writer.write_depth(1000, picture(0)[0])
        writer.close()
    assert (summarise(tmp_path / "a.oni").depth_frames, summarise(tmp_path / "a.oni").colour_frames) == (1, 0)


def test_a_colour_frame_of_another_size_or_type_is_refused(tmp_path: Path) -> None:
    depth, colour = picture(0)
    with OniWriter(tmp_path / "a.oni", SMALL) as writer:
        writer.write_depth(1000, depth)
        for wrong in (colour[:-1], colour[..., :2], colour.astype(np.uint16)):
            with pytest.raises(ValueError, match=r"the stream is \(48, 64, 3\) uint8"):
                writer.write_colour(2000, wrong)
