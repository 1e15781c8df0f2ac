"""Integers of C3D files that wrap round at 16 bits are named and count as not seen, for long stretches too."""

from __future__ import annotations

import numpy as np
import pytest

from formats.importers.c3d_file import read_c3d
from formats.importers.marker_tracks import Wanted
from tests.formats.c3d_by_hand import c3d_bytes

SCALE, FRAMES = 0.1, 200  # mm
TOLD = "with a coordinate that wrapped round at 16 bits: "


def paths(near=3190.0, swing=100.0):
    """Three markers [mm] that swing about a place along x, 20 mm apart, in steps of the scale."""
    time = np.arange(FRAMES) / 100
    along = near + swing * np.sin(2 * np.pi * time)[:, None] + 20.0 * np.arange(3)
    return np.round(np.stack([along, 0 * along + 500, 0 * along + 900], axis=2), 1)


def wrapped(places):
    return ((np.rint(places / SCALE) + 32768) % 65536 - 32768) * SCALE


def read(tmp_path, places, wanted=None, scale=SCALE):
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(places, ["a", "b", "c"], scale=scale))
    return read_c3d(tmp_path / "a.c3d", None, *([wanted] if wanted else []))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_stretches_that_wrap_are_named_and_no_other_position_changes(tmp_path, axis, sign):
    places = sign * np.roll(paths(), axis, axis=2)
    tracks = read(tmp_path, wrapped(places))
    gone = np.isnan(tracks.positions).any(2)
    assert gone.sum(0).tolist() == (np.abs(np.rint(places / SCALE)) >= 32767).any(2).sum(0).tolist()
    assert (gone.sum(0) > 20).all()
    np.testing.assert_allclose(1e3 * tracks.positions[~gone], places[~gone], atol=1e-6)
    assert f"{TOLD}a in frame " in tracks.warning
    assert tracks.warning.endswith("; export floats, or a larger scale")


@pytest.mark.parametrize("far", [0.0, 0.4, 100.0])
def test_a_stretch_behind_a_gap_is_named(tmp_path, far):
    """The marker is not seen where it crosses the bound, and moves elsewhere later."""
    places = np.tile(paths()[:1], (FRAMES, 1, 1))
    places[:, 1, 0] = 3270.0 + far * (np.arange(FRAMES) > 100)
    places[60:, 1, 0] += 10
    places[60:64, 1] = np.nan
    tracks = read(tmp_path, np.where(np.isnan(places), np.nan, wrapped(places)))
    assert tracks.warning.startswith(f"60 positions count as not seen, {TOLD}b in frame 1 to frame 60; ")


def test_one_position_that_wraps_is_named(tmp_path):
    places = paths(swing=0.3)
    places[50, 1, 0] = 3277.0
    tracks = read(tmp_path, wrapped(places))
    assert tracks.warning == f"1 position counts as not seen, {TOLD}b in frame 51; export floats, or a larger scale"
    assert read(tmp_path, wrapped(places), Wanted(("a",))).warning == ""


@pytest.mark.parametrize("speed", [1, 10, 40])
def test_a_fast_marker_that_wraps_is_named(tmp_path, speed):
    """In m/s, to and fro over 1.2 m at 100 frames a second: by 100, 1000 and 4000 steps a frame."""
    places, frames = paths(swing=0.0), 120 // speed
    places[:, 1, 0] = 2400 + 10 * speed * np.abs((np.arange(FRAMES) + 0.5) % (2 * frames) - frames)
    gone = np.isnan(read(tmp_path, wrapped(places)).positions[:, 1]).any(1)
    assert (gone == (places[:, 1, 0] > 3276.7)).all()


def test_coordinates_that_reach_both_ends_of_the_scale_do_not_wrap(tmp_path):
    """A marker crosses the whole range behind a gap; two markers at both ends are exchanged for a frame."""
    places = paths(near=0.0, swing=5.0)
    places[:100, 1, 0], places[100:, 1, 0] = -3199.0, 3200.0
    places[80:100, 1] = np.nan
    assert "wrapped" not in read(tmp_path, places).warning
    places = paths(near=0.0, swing=5.0)
    places[:, 0, 0], places[:, 1, 0] = -3190.0, 3190.0
    places[70, [0, 1]] = places[70, [1, 0]]
    assert "wrapped" not in read(tmp_path, places).warning


def test_floats_do_not_wrap(tmp_path):
    assert "wrapped" not in read(tmp_path, wrapped(paths()), scale=-1.0).warning


def test_motion_within_the_bounds_is_read_as_it_is(tmp_path):
    for swing in (0.0, 10.0, 3000.0):
        tracks = read(tmp_path, paths(near=150.0, swing=swing))
        assert (tracks.warning, np.isfinite(tracks.positions).all()) == ("", True)
