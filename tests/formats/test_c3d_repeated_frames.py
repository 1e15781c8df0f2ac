"""A frame that a program repeats for a lost one is told from a frame that a copy wrote twice, by the motion behind it.

Frames of 32 markers have 512 bytes, so that either makes the same file but for the positions behind the repeat.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.c3d_file import read_c3d
from tests.formats.c3d_by_hand import c3d_bytes

FRAMES, AT = 100, 40  # frames that the header states, and the frame that is repeated


def read(tmp_path, raw):
    (tmp_path / "a.c3d").write_bytes(raw)
    return read_c3d(tmp_path / "a.c3d", None)


def swing(frames, points, noise=0.05):
    """A swing [mm] of 100 mm at 1 Hz, with noise as of cameras, at 100 frames a second."""
    time = np.arange(frames)[:, None, None] / 100
    rest = 10.0 * np.arange(3 * points).reshape(-1, 3)
    return rest + 100 * np.sin(6.28 * time + 0.4) + np.random.default_rng(0).normal(0, noise, (frames, points, 3))


def made(places, processor="intel", scale=-1.0):
    labels = [f"m{k}" for k in range(places.shape[1])]
    return c3d_bytes(places, labels, frames_said=FRAMES, processor=processor, scale=scale)


def begin_of(raw, order="<"):
    return 512 * (struct.unpack_from(f"{order}H", raw, 16)[0] - 1)


KINDS = [(32, -1.0, "intel"), (64, -1.0, "sgi"), (32, -1.0, "dec"), (64, 0.1, "intel"), (96, -1.0, "intel")]


@pytest.mark.parametrize(("points", "scale", "processor"), KINDS)
def test_one_frame_more_than_stated_and_one_repeated_for_a_lost_one_are_read(tmp_path, points, scale, processor):
    places = swing(FRAMES + 1, points)
    places[AT + 1] = places[AT]
    tracks = read(tmp_path, made(places, processor, scale))
    assert tracks.warning == (
        f"frame {AT + 2} repeats frame {AT + 1}, and the file has room for more frames than the {FRAMES} that it states"
    )
    np.testing.assert_allclose(1e3 * tracks.positions, places[:FRAMES], atol=0.051 if scale > 0 else 1e-3)


@pytest.mark.parametrize(("points", "scale", "processor"), KINDS)
@pytest.mark.parametrize("at", [0, 1, AT, FRAMES - 2])
def test_one_frame_that_a_copy_wrote_twice_is_refused(tmp_path, points, scale, processor, at):
    """The motion goes on behind it by one step, and not by the two of a lost frame."""
    raw, size = made(swing(FRAMES, points), processor, scale), (16 if scale < 0 else 8) * points
    first = begin_of(raw, ">" if processor == "sgi" else "<") + at * size
    with pytest.raises(TakeError, match=rf"holds the {size} bytes from byte {first} on twice, which shifts all frames"):
        read(tmp_path, raw[: first + size] + raw[first:])


def test_several_frames_that_a_copy_wrote_twice_are_refused(tmp_path):
    """Four frames of 256 bytes, behind which the motion goes on from the last one."""
    raw = made(swing(FRAMES, 16))
    first = begin_of(raw) + AT * 256
    with pytest.raises(TakeError, match=rf"holds the 1024 bytes from byte {first} on twice"):
        read(tmp_path, raw[: first + 1024] + raw[first:])


@pytest.mark.parametrize("still", [0, FRAMES + 1])
def test_frames_whose_motion_shows_neither_are_read_with_a_warning(tmp_path, still):
    """Markers that only tremble, and a repeat at the last frame."""
    places = swing(FRAMES + 1, 32)
    at = AT if still else FRAMES - 1
    if still:
        places = 500 + np.random.default_rng(1).normal(0, 0.05, places.shape)
    places[at + 1] = places[at]
    told = read(tmp_path, made(places)).warning
    assert told.startswith(f"frame {at + 2} repeats frame {at + 1}, and the file has room ")


@pytest.mark.parametrize("change", ["unseen", "leaves"])
def test_markers_that_are_not_seen_around_the_repeat_say_nothing(tmp_path, change):
    """Half of the markers are lost before or behind it; positions of gaps are zeros in the file."""
    places = swing(FRAMES + 1, 32)
    places[AT + 1] = places[AT]
    places[(slice(None) if change == "unseen" else slice(AT + 2, None)), :15] = np.nan
    assert read(tmp_path, made(places)).warning.startswith(f"frame {AT + 2} repeats frame {AT + 1}, ")
