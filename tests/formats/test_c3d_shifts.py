"""Foreign bytes within the frames of a C3D file, and bytes lost there, shift all frames behind them, and are named."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers import c3d_shifts
from formats.importers.c3d_file import read_c3d
from formats.importers.marker_tracks import ALL, Wanted
from tests.formats.c3d_by_hand import c3d_bytes

FRAMES, AT = 300, 130  # frames of a file, and the frame within which its bytes are moved


def read(tmp_path, raw, wanted=ALL):
    (tmp_path / "a.c3d").write_bytes(raw)
    return read_c3d(tmp_path / "a.c3d", None, wanted)


def hanging(points, rate=100.0, speed=628.0, unseen=()):
    """A grid of markers [mm], 60 mm apart, that swings at 1 Hz with noise; `speed` [mm/s] along its rows."""
    time = np.arange(FRAMES)[:, None, None] / rate
    k = np.arange(points)
    rest = np.stack([60.0 * (k % 9), np.full(points, 400.0), 1500 - 60.0 * (k // 9)], 1)
    swing = speed / 6.28 * np.sin(6.28 * time) * [1.0, 0.3, 0.1]
    places = rest + swing + np.random.default_rng(points).normal(0, 0.1, (FRAMES, points, 3))
    for one in unseen:
        places[:, one] = np.nan
    return places


def made(places, scale=-1.0, **more):
    return c3d_bytes(places, [f"m{k}" for k in range(places.shape[1])], scale=scale, **more)


def begin_of(raw, order="<"):
    return 512 * (struct.unpack_from(f"{order}H", raw, 16)[0] - 1)


def refused(tmp_path, raw):
    with pytest.raises(TakeError) as error:
        read(tmp_path, raw)
    return str(error.value).removeprefix(f"{tmp_path}/a.c3d: ")


def named(sentence):
    """The frame, and the numbers of foreign and of lost bytes."""
    found = re.fullmatch(
        r"its frames are shifted from about frame (\d+) on: (\d+) foreign bytes? or (\d+) lost bytes? would shift them "
        "so; copy or export it again",
        sentence,
    )
    assert found, sentence
    return tuple(map(int, found.groups()))


FILES = [
    (9, -1.0, {}), (9, 0.1, {}), (81, -1.0, {"analogue": 7}), (81, 0.1, {"processor": "sgi"}),
    (32, -1.0, {"processor": "dec"}), (4, -1.0, {}),
]  # fmt: skip


@pytest.mark.parametrize(("points", "scale", "more"), FILES)
@pytest.mark.parametrize("end", ["longer", "filled", "cut"])
@pytest.mark.parametrize("count", [1, 3, 4, 8, 16, 31])
def test_foreign_bytes_within_the_frames_are_named(tmp_path, points, scale, more, end, count):
    raw = made(hanging(points), scale, **more)
    width = (4 * points + more.get("analogue", 0)) * (4 if scale < 0 else 2)
    at = begin_of(raw, ">" if more.get("processor") == "sgi" else "<") + AT * width + width // 3
    foreign = np.random.default_rng(count).bytes(count)
    longer = raw[:at] + foreign + raw[at:]
    longer = {"longer": longer, "filled": longer + bytes(-len(longer) % 512), "cut": longer[: len(raw)]}[end]
    frame, more_bytes, less_bytes = named(refused(tmp_path, longer))
    assert abs(frame - (AT + 1)) <= 1
    assert (more_bytes, less_bytes) == (count % width, width - count % width)


@pytest.mark.parametrize(("points", "scale", "more"), FILES)
@pytest.mark.parametrize("end", ["shorter", "filled"])
@pytest.mark.parametrize("count", [1, 3, 4, 8, 16, 31])
def test_bytes_lost_within_the_frames_are_named(tmp_path, points, scale, more, end, count):
    """A file that is too short for its frames is not said to be cut off."""
    raw = made(hanging(points), scale, **more)
    width = (4 * points + more.get("analogue", 0)) * (4 if scale < 0 else 2)
    at = begin_of(raw, ">" if more.get("processor") == "sgi" else "<") + AT * width + width // 3
    shorter = raw[:at] + raw[at + count :] + bytes(count * (end == "filled"))
    frame, more_bytes, less_bytes = named(refused(tmp_path, shorter))
    assert abs(frame - (AT + 1)) <= 1
    assert (more_bytes, less_bytes) == (width - count % width, count % width)


@pytest.mark.parametrize("at_once", [1, 2000, 1 << 22])
def test_a_shift_is_found_however_many_bytes_are_read_at_once(tmp_path, monkeypatch, at_once):
    monkeypatch.setattr(c3d_shifts, "SCANNED_AT_ONCE", at_once)
    monkeypatch.setattr(c3d_shifts, "SHIFTS_AT_ONCE", min(at_once, 100))
    raw = made(hanging(20, unseen=range(12, 20)))
    at = begin_of(raw) + AT * 320 + 48
    assert named(refused(tmp_path, raw[:at] + b"1234567" + raw[at:])) == (AT + 1, 7, 313)


def test_frames_before_a_shift_are_read_where_only_they_are_wanted(tmp_path):
    places = hanging(9)
    raw = made(places)
    at = begin_of(raw) + AT * 144
    shifted = raw[:at] + b"1234" + raw[at:-4]
    tracks = read(tmp_path, shifted, Wanted(frames=AT))
    np.testing.assert_allclose(1e3 * tracks.positions, places[:AT], atol=1e-3)
    with pytest.raises(TakeError, match=r"its frames are shifted from about frame 13[01] on"):
        read(tmp_path, shifted, Wanted(frames=AT + 6))


def test_a_file_that_is_cut_off_is_still_said_to_be(tmp_path):
    raw = made(hanging(9))
    assert refused(tmp_path, raw[: begin_of(raw) + 200 * 144 + 20]).startswith("holds 200 of the 300 frames that its ")


def honest(kind):
    """Motion and gaps that no byte has moved."""
    if kind == "fast":
        return hanging(18, rate=30.0, speed=1800.0)  # one marker's distance in a frame
    if kind == "lively":
        return hanging(9, rate=60.0) * np.random.default_rng(0).uniform(0.98, 1.02, (FRAMES, 1, 1))
    places = hanging(9)
    if kind == "exchanged":
        places[AT] = np.roll(places[AT], 1, axis=0)
    elif kind == "lost":
        places[AT : AT + 20] = np.nan
    elif kind == "few":
        places[AT : AT + 20, 2:] = np.nan
    elif kind == "still":
        places[:AT] = places[0]
    elif kind == "moved":
        places[AT:] += 300.0
    elif kind == "far":
        places[AT:] += 40_000.0
    elif kind == "coded":
        places[AT : AT + 20] = 9999.0
    elif kind == "turned":
        places[AT:] = places[AT:, :, [1, 2, 0]]
    elif kind == "random":
        places = np.random.default_rng(1).uniform(-900, 900, places.shape)
    return places


KINDS = ["fast", "lively", "exchanged", "lost", "few", "still", "moved", "turned", "random"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scale", [-1.0, 0.1])
def test_honest_frames_are_no_shift(tmp_path, kind, scale):
    assert "shifted" not in read(tmp_path, made(honest(kind), scale)).warning


@pytest.mark.parametrize("foreign", [7, 32])
def test_a_second_shift_hides_no_first_one(tmp_path, foreign):
    """The frames behind the second one show no shape in either reading."""
    raw = made(hanging(9))
    first, second = (begin_of(raw) + at * 144 + 20 for at in (AT, AT + 20))
    more = np.random.default_rng(1).bytes(foreign)
    frame, *counts = named(refused(tmp_path, raw[:first] + raw[first + 16 : second] + more + raw[second:]))
    assert abs(frame - (AT + 1)) <= 1
    assert counts == [128, 16]


@pytest.mark.parametrize("count", [1, 4, 7, 8])
def test_bytes_lost_and_as_many_foreign_ones_behind_are_no_cycle(tmp_path, count):
    """Parts of a marker's bytes exchange no labels, though the frames far behind are as they were."""
    raw = made(hanging(9))
    first, second = (begin_of(raw) + at * 144 + 20 for at in (AT, AT + 20))
    frame, *counts = named(refused(tmp_path, raw[:first] + raw[first + count : second] + bytes(count) + raw[second:]))
    assert abs(frame - (AT + 1)) <= 1
    assert counts == [144 - count, count]


@pytest.mark.parametrize("kind", ["far", "coded"])
def test_positions_far_out_are_no_shift(tmp_path, kind):
    """Bytes of such numbers, read from elsewhere, are near zero, and so nearer to the markers."""
    assert "shifted" not in read(tmp_path, made(honest(kind))).warning


@pytest.mark.parametrize("places", [np.ones((FRAMES, 5, 3)), hanging(1), hanging(4)[:2]], ids=["rest", "one", "short"])
def test_files_that_can_show_no_shift_are_read(tmp_path, places):
    assert len(read(tmp_path, made(places)).time) == len(places)
