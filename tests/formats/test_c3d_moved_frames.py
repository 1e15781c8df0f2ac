"""Whole frames that a C3D file lost, or got inserted, are named where the markers move; undamaged motion has none."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.importers import c3d_moved_frames
from formats.importers.c3d_file import read_c3d
from formats.importers.c3d_moved_frames import warning_of_moved_frames
from formats.importers.marker_tracks import Wanted
from tests.formats.c3d_by_hand import c3d_bytes
from tests.shared_data import c3d_recording

FRAMES, RATE, POINTS = 300, 100.0, 9
AT = 95  # near the swing's middle: 0.6 m/s


def swing(noise=1e-4, rate=RATE, points=POINTS):
    """A swing [m] of 0.1 m at 1 Hz about 5 directions, with noise as of cameras."""
    rng, time = np.random.default_rng(0), np.arange(FRAMES)[:, None, None] / rate
    rest = rng.uniform(-0.3, 0.3, (points, 3)) + np.array([0, 0, 1])
    way = rng.normal(0, 0.1, 3) * rng.uniform(0.7, 1.3, (points, 1))
    return rest + way * np.sin(2 * np.pi * time) + rng.normal(0, noise, (FRAMES, points, 3))


def told(places, rate=RATE):
    return warning_of_moved_frames(places, rate, lambda k: f"frame {k + 1}")


def named(sentence):
    """The places, and the sentence about the times."""
    found = re.fullmatch(
        r"all markers step at once as where frames are missing or too many: (.+); ([^;]+); copy or export it again",
        sentence,
    )
    assert found, sentence
    return found[1], found[2]


@pytest.mark.parametrize("noise", [0.0, 1e-4, 2e-4])
@pytest.mark.parametrize("at", [50, AT, 151, 200, FRAMES - 6])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_lost_frames_are_named(at, count, noise):
    places = swing(noise)
    found, wrong = named(told(np.delete(places, range(at, at + count), axis=0)))
    assert found == f"{count} frame{'s' * (count > 1)} lost behind frame {at}"
    assert wrong == f"the last times are 0.0{count} s too early"


@pytest.mark.parametrize("noise", [0.0, 1e-4, 2e-4])
@pytest.mark.parametrize("at", [50, AT, 151, 200])
@pytest.mark.parametrize("kind", ["repeated", "foreign", "unseen"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_inserted_frames_are_named_whatever_they_hold(at, kind, count, noise):
    places = swing(noise)
    other = {"repeated": places[[at - 1]], "foreign": places[[at]] + [0.4, 0, 0], "unseen": places[[0]] * np.nan}[kind]
    found, wrong = named(told(np.concatenate([places[:at], *[other] * count, places[at:]])))
    behind = re.fullmatch(rf"{count} frames? inserted behind frame (\d+)", found)
    assert behind
    assert 0 <= at - int(behind[1]) <= (count if kind == "repeated" else 0)
    assert wrong == f"the last times are 0.0{count} s too late"


def test_several_places_are_named_and_the_sum_of_their_times():
    places = swing()
    lost = np.delete(places, [50, AT, AT + 1], axis=0)
    assert named(told(lost)) == (
        f"1 frame lost behind frame 50, 2 frames lost behind frame {AT - 1}", "the last times are 0.03 s too early",
    )  # fmt: skip
    both = np.insert(np.delete(places, 50, axis=0), AT, np.nan, axis=0)
    found, wrong = named(told(both))
    assert found == f"1 frame lost behind frame 50, 1 frame inserted behind frame {AT}"
    assert wrong == "the times between are wrong"


@pytest.mark.parametrize("at_once", [1, 7, 64])
def test_frames_are_found_however_many_are_looked_at_together(monkeypatch, at_once):
    monkeypatch.setattr(c3d_moved_frames, "STEPS_AT_ONCE", at_once)
    for places in (np.delete(swing(), AT, axis=0), np.insert(swing(), AT, np.nan, axis=0)):
        assert f"behind frame {AT};" in told(places)


@pytest.mark.parametrize(("processor", "scale"), [("intel", -1.0), ("sgi", -1.0), ("dec", -1.0), ("intel", 0.1)])
def test_a_file_with_a_lost_frame_is_read_with_a_warning(tmp_path, processor, scale):
    """The last frame of the file is one of zeros, as padding is."""
    places = 1e3 * np.delete(swing(), AT, axis=0)
    raw = c3d_bytes(
        np.concatenate([places, places[:1] * np.nan]),
        [f"m{k}" for k in range(POINTS)],
        processor=processor,
        scale=scale,
    )
    (tmp_path / "a.c3d").write_bytes(raw)
    tracks = read_c3d(tmp_path / "a.c3d", None)
    assert named(tracks.warning)[0] == f"1 frame lost behind frame {AT}"
    np.testing.assert_allclose(1e3 * tracks.positions[:-1], places, atol=0.051)
    assert read_c3d(tmp_path / "a.c3d", None, Wanted(frames=AT)).warning == ""


def motion(kind, rng):
    """Undamaged positions [m], (frames, markers, 3), and their rate."""
    frames, rate, points = int(rng.integers(30, 500)), float(rng.choice([20, 60, 100, 200])), int(rng.integers(3, 20))
    time, far = np.arange(frames) / rate, rng.uniform(0.01, 0.3)
    way = far * np.sin(2 * np.pi * rng.uniform(0.3, 3) * time + rng.uniform(0, 6))
    way = {
        "swing": lambda: way,
        "still": lambda: 0 * way,
        "pauses": lambda: np.where(time % 1.3 < 0.6, way, 0),
        "held": lambda: np.maximum.accumulate(way),
        "corners": lambda: far * np.abs(time * 2 % 1 - 0.5),
        "stairs": lambda: far * np.floor(time * 4),
        "jolts": lambda: np.cumsum(np.cumsum(rng.normal(0, 20, frames) * (rng.random(frames) < 0.05))) / rate**2,
        "shaken": lambda: way + 0.002 * np.sin(2 * np.pi * rng.uniform(5, rate / 2) * time),
        "flick": lambda: way + 0.2 * np.exp(-(((time - time[frames // 2]) * rng.uniform(5, 60)) ** 2)),
        "uneven": lambda: np.cumsum(rng.choice([1e-3, 2e-3], frames, p=[0.9, 0.1])),
    }[kind]()
    turned = rng.normal(0, 1, 3) * (1 + rng.uniform(0, 0.5, (points, 1)))
    places = rng.uniform(-0.3, 0.3, (points, 3)) + way[:, None, None] * turned / np.linalg.norm(turned[0])
    places = places + rng.normal(0, rng.choice([0, 1e-5, 1e-4, 3e-4, 1e-3]), places.shape)
    step = rng.choice([0, 1e-4, 5e-4, 1e-3])
    return (np.rint(places / step) * step if step else places), rate


KINDS = ["swing", "still", "pauses", "held", "corners", "stairs", "jolts", "shaken", "flick", "uneven"]


@pytest.mark.parametrize("kind", KINDS)
def test_undamaged_motion_noise_and_rounding_show_no_frame(kind):
    rng = np.random.default_rng(1)
    assert [told(*motion(kind, rng)) for _ in range(100)] == [""] * 100


@pytest.mark.parametrize("kind", ["unseen", "repeated"])
def test_a_gap_and_a_frame_repeated_for_a_lost_one_keep_the_times(kind):
    places = swing()
    places[AT] = np.nan if kind == "unseen" else places[AT - 1]
    assert told(places) == ""


@pytest.mark.parametrize(("kept", "period"), [(5, 6), (6, 5), (2, 1)])
def test_a_changed_frame_rate_is_no_damage(kept, period):
    """100 frames a second of 120, 120 of 100, and twice the rate: frames left out, or repeated, throughout."""
    assert told(swing(0)[np.arange(240) * period // kept]) == ""


def test_too_few_markers_or_frames_show_nothing():
    places = np.delete(swing(), AT, axis=0)
    assert told(places[:, :2]) == told(places[AT - 2 : AT + 2]) == told(places[AT - 1 : AT + 40]) == ""
    assert told(places * np.nan) == ""
    assert told(places[AT - 3 : AT + 40, :3]) != ""


def test_some_markers_that_step_or_a_step_of_another_length_are_no_lost_frame():
    places = swing()
    step = places[AT] - places[AT - 1]
    some = places.copy()
    some[AT:] += step
    assert told(some) != ""
    some[AT:, 1] -= step[1]
    assert told(some) == ""
    for times in (0.5, -0.5, 1.5):
        assert told(np.concatenate([places[:AT], places[AT:] + times * step])) == ""


@pytest.mark.parametrize("name", ["BTS", "Qualisys", "Vicon", "kt_racing_full"])
def test_real_recordings_show_no_frame_and_show_those_taken_out(name):
    tracks = read_c3d(c3d_recording(name), None)
    assert "step at once" not in tracks.warning
    for first in range(0, tracks.positions.shape[1], 8):  # also by a few of their markers
        assert told(tracks.positions[:, first : first + 8]) == ""
    found = [bool(told(np.delete(tracks.positions, k, axis=0))) for k in range(5, len(tracks.time) - 5, 10)]
    assert np.mean(found) > 0.2
