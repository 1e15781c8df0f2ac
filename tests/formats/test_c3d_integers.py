"""Integers of C3D files at the limits of their 16 bits: coordinates, counts of points, and numbers of frames."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.c3d_file import read_c3d
from formats.importers.marker_tracks import Wanted
from tests.formats.c3d_by_hand import c3d_bytes

FIRST_AND_LAST = 6  # offset of the header's words [bytes]
SCALE = 0.1  # mm


def read(tmp_path, raw, wanted=None):
    (tmp_path / "a.c3d").write_bytes(raw)
    return read_c3d(tmp_path / "a.c3d", None, *([wanted] if wanted else []))


def renumbered(raw, first, frames, *, is_counted=True):
    """The file with other numbers of frames in its header's words of 16 bits, which wrap round."""
    raw = bytearray(raw)
    struct.pack_into("<HH", raw, FIRST_AND_LAST, first, (first + frames - 1) % 65536)
    if not is_counted:
        at = raw.index(b"FRAMES")
        raw[at : at + 6] = b"FRXMES"
    return bytes(raw)


def paths(frames=40, points=3):
    """Slow paths [mm] near 500 mm, in steps of the scale."""
    swing = np.sin(0.05 * np.arange(frames))[:, None, None]
    return 500 + 20 * np.round(swing + np.arange(3 * points).reshape(-1, 3), 2)


@pytest.mark.parametrize("integer", [32767, -32767, -32768])
def test_coordinates_at_the_bound_of_integers_are_named_and_count_as_not_seen(tmp_path, integer):
    places = paths()
    places[10:13, 1, 2] = SCALE * integer
    tracks = read(tmp_path, c3d_bytes(places, ["a", "b", "c"], scale=SCALE))
    assert tracks.warning == (
        "3 positions count as not seen, with a coordinate at a bound of 16-bit integers: b in frame 11, b in frame 12, "
        "b in frame 13; export floats, or a larger scale"
    )
    gone = np.isnan(tracks.positions).any(2)
    assert np.argwhere(gone).tolist() == [[10, 1], [11, 1], [12, 1]]


@pytest.mark.parametrize(("integer", "scale"), [(32766, SCALE), (-32766, SCALE), (32767, -1.0)])
def test_a_coordinate_within_the_bounds_or_a_float_is_a_position(tmp_path, integer, scale):
    places = paths()
    places[:, 1, 2] = SCALE * integer
    tracks = read(tmp_path, c3d_bytes(places, ["a", "b", "c"], scale=scale))
    assert (tracks.warning, np.isfinite(tracks.positions).all()) == ("", True)


def test_one_position_at_the_bound_is_named_unless_its_marker_is_flagged_or_not_used(tmp_path):
    places = paths()
    places[7, 0, 0] = SCALE * 32767
    raw = c3d_bytes(places, ["a", "b", "c"], scale=SCALE)
    told = "1 position counts as not seen, with a coordinate at a bound of 16-bit integers: a in frame 8; "
    assert read(tmp_path, raw).warning.startswith(told)
    assert read(tmp_path, raw, Wanted(("b",))).warning == ""
    at = raw.index(struct.pack("<h", 32767), 1024)
    flagged = raw[: at + 6] + struct.pack("<h", -1) + raw[at + 8 :]
    assert read(tmp_path, flagged).warning == ""


@pytest.mark.parametrize("is_counted", [True, False])
def test_frames_whose_last_number_wraps_round_are_read_without_a_doubt(tmp_path, is_counted):
    """Frames 65000 to 66023, which fill their blocks."""
    raw = c3d_bytes(paths(1024), ["a", "b", "c"], scale=SCALE)
    tracks = read(tmp_path, renumbered(raw, 65000, 1024, is_counted=is_counted))
    assert (len(tracks.time), tracks.warning) == (1024, "")


def test_a_wrapped_number_of_frames_for_which_there_is_no_room_is_refused(tmp_path):
    raw = renumbered(c3d_bytes(paths(64), ["a", "b", "c"], scale=SCALE), 65000, 1024, is_counted=False)
    with pytest.raises(TakeError, match="holds 64 of the 1024 frames that its header states; "):
        read(tmp_path, raw)


def test_more_points_than_a_signed_word_counts_cause_no_doubt(tmp_path):
    tracks = read(tmp_path, c3d_bytes(np.ones((2, 40000, 3)), ["a"], scale=SCALE))
    assert (tracks.positions.shape, tracks.warning) == ((2, 40000, 3), "")
