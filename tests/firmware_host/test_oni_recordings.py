""".oni recordings: what the writer writes and the walk over its records finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firmware_host.errors import RecordingError
from firmware_host.oni_records import RecordType, read_records, summarise
from firmware_host.oni_writer import OniWriter
from tests.firmware_host.scenes import SMALL, picture, write_recording


def test_six_frames_written_are_six_frames_counted(tmp_path: Path) -> None:
    found = summarise(write_recording(tmp_path / "a.oni", 6))
    assert (found.depth_frames, found.colour_frames, found.is_complete) == (6, 6, True)


def test_a_recording_cut_in_its_last_frame_counts_five_of_six(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.oni", 6)
    last = [r for r in read_records(path) if r.type == RecordType.NEW_DATA][-2]
    path.write_bytes(path.read_bytes()[: last.payload_position + 10])
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


def test_time_stamps_that_the_player_would_drop_are_refused(tmp_path: Path) -> None:
    depth, _ = picture(0)
    with OniWriter(tmp_path / "a.oni", SMALL) as writer:
        with pytest.raises(ValueError, match="above 0"):
            writer.write_depth(0, depth)
        writer.write_depth(500, depth)
        with pytest.raises(ValueError, match="500 after 500"):
            writer.write_depth(500, depth)


def test_a_frame_of_another_size_or_type_is_refused(tmp_path: Path) -> None:
    with OniWriter(tmp_path / "a.oni", SMALL) as writer:
        with pytest.raises(ValueError, match="stream is"):
            writer.write_depth(1, np.zeros((64, 48), np.uint16))
        with pytest.raises(ValueError, match="int64"):
            writer.write_depth(1, np.zeros((48, 64), np.int64))
