"""Marker files of odd takes: the origin, frames between two multiples of an interval, names that cannot be stored."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.archive import write_take
from formats.errors import TakeError
from formats.exporters.marker_files import at_one_rate, marker_tracks, write_c3d, write_csv
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import MarkerTracks
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take


def named(*names):
    """A take whose points have other names."""
    take = a_take(20)
    points = tuple(
        msgspec.structs.replace(point, name=name) for point, name in zip(take.garment.points, names, strict=True)
    )
    return replace(take, garment=msgspec.structs.replace(take.garment, points=points))


@pytest.mark.parametrize("write", [write_csv, write_c3d])
@pytest.mark.parametrize("least", [0.0, 4e-7])
def test_a_point_at_the_origin_comes_back_a_micrometre_beside_it_and_not_as_a_gap(tmp_path, write, least):
    take = a_take(20)
    take.points[:, 1], take.points_valid[:, 1] = [least, -least, 0.0], True
    path = tmp_path / f"a.{write.__name__[-3:]}"
    write(path, take)
    back = read_marker_tracks(path).positions[:, 1]
    np.testing.assert_allclose(back, take.points[:, 1], atol=1.01e-6)


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[2J", "a ", " a", "a\u202eb"])
@pytest.mark.parametrize("write", [write_csv, write_c3d])
def test_a_name_that_would_not_come_back_is_refused(tmp_path, write, name):
    path = tmp_path / f"a.{write.__name__[-3:]}"
    with pytest.raises(TakeError, match="has characters that no marker file keeps; export it as NPZ"):
        write(path, named(name, "b", "c", "d"))
    assert not path.exists()


def test_a_name_that_a_spreadsheet_would_run_is_no_formula_in_a_csv_file_and_comes_back(tmp_path):
    names = ("=1+1", "@b", "-c", "it's")
    write_csv(tmp_path / "a.csv", named(*names))
    head = (tmp_path / "a.csv").read_text().splitlines()[0].split(",")
    assert not any(cell.startswith(("=", "@", "-", "+")) for cell in head)
    assert read_marker_tracks(tmp_path / "a.csv").labels[:4] == names


def test_an_export_to_one_rate_says_how_far_it_moved_frames(tmp_path):
    rng = np.random.default_rng(5)
    steady = a_take(40)
    jittered = replace(steady, time=np.arange(40) / 30 + rng.uniform(-0.002, 0.002, 40))
    assert write_c3d(tmp_path / "a.c3d", replace(steady, time=np.arange(40) / 30)) == ""
    words = write_c3d(tmp_path / "b.c3d", jittered)
    moved = float(words.split("by up to ")[1].split()[0])
    apart = np.abs(read_marker_tracks(tmp_path / "b.c3d").time - (jittered.time - jittered.time[0])).max()
    assert moved == pytest.approx(1e3 * apart, abs=0.3)
    assert 1.0 < moved < 4.5
    write_take(tmp_path / "t.mcap", jittered)
    done = hangtime_here("takes", "export", "t.mcap", "--to", "c3d", "--out", "out", folder=tmp_path)
    assert "40 frames; C3D has one rate, so frames were moved by up to" in done.stdout, done.stderr


def paths(*time):
    """One marker whose coordinate [m] is its frame's number."""
    return MarkerTracks(("a",), np.array(time, float), np.arange(3.0 * len(time)).reshape(-1, 1, 3))


@pytest.mark.parametrize(
    ("time", "frames", "moved"),
    [
        ((0, 0.1), [0, 1], 0.0),
        ((0, 0.1, 0.2), [0, 1, 2], 0.0),
        ((5, 5.1, 5.2, 5.4, 5.5), [0, 1, 2, 4, 5], 0.0),
        ((0, 0.1, 0.22, 0.3, 0.4), [0, 1, 2, 3, 4], 0.02),
    ],
)
def test_frames_lie_at_multiples_of_the_interval_from_the_first_one_on(time, frames, moved):
    rate, places, off = at_one_rate(paths(*time), "t")
    assert rate == pytest.approx(10, rel=0.01)
    assert np.flatnonzero(np.isfinite(places).all((1, 2))).tolist() == frames
    assert places.shape == (frames[-1] + 1, 1, 3)
    np.testing.assert_array_equal(places[frames], paths(*time).positions)
    assert off == pytest.approx(moved, abs=0.002)


@pytest.mark.parametrize(
    ("time", "words"),
    [
        ((3,), "t: has one frame, and so no rate; export it as CSV$"),
        ((0, 0.1, 0.2, 0.204, 0.3, 0.4), r"come at no steady rate \(frame \d is \d+\.\d ms off\); export it as CSV"),
        ((0, 0.1, 0.2, 0.3, 0.435, 0.5, 0.6, 0.7, 0.8), r"no steady rate \(frame 4 is 3\d\.\d ms off\); export"),
        ((0, 10, 20, 30, 43.5, 50, 60, 70, 80), r"no steady rate \(frame 4 is 3500\.0 ms off\); export it as CSV"),
        ((0, 0.01, 0.02, 655.34), "has 65535 frames, a C3D file 65534 at most; export it as CSV"),
    ],
)  # fmt: skip
def test_a_take_without_one_rate_is_refused_with_the_frame_that_is_farthest_off(time, words):
    with pytest.raises(TakeError, match=words):
        at_one_rate(paths(*time), "t")


@pytest.mark.parametrize("write", [write_csv, write_c3d])
def test_a_take_of_no_frame_is_refused_and_leaves_no_file(tmp_path, write):
    take = a_take(20)
    none = {name: getattr(take, name)[:0] for name in ("time", "held", "held_valid", "points", "points_valid")}
    path = tmp_path / f"a.{write.__name__[-3:]}"
    with pytest.raises(TakeError, match=r"holds no frame; export a take with a frame or more$"):
        write(path, replace(take, **none))
    assert not path.exists()


def test_the_longest_take_that_c3d_can_hold_is_put_at_its_rate():
    assert len(at_one_rate(paths(0, 0.01, 0.02, 655.33), "t")[1]) == 65534


def test_a_gap_in_c3d_is_three_zeros_with_a_residual_below_zero(tmp_path):
    """Programs differ in which of the two they read. Words 3 and 9 of the header: points of a frame, first block."""
    take = a_take(20)
    take.points[3, 1], take.points[4, 1] = np.nan, [0.5, -0.25, 2.0]
    write_c3d(tmp_path / "a.c3d", take)
    raw = (tmp_path / "a.c3d").read_bytes()
    begin = 512 * (int.from_bytes(raw[16:18], "little") - 1)
    frames = np.frombuffer(raw[begin : begin + 20 * 6 * 16], "<f4").reshape(20, 6, 4)
    assert frames[3:5, 1].tolist() == [[0, 0, 0, -1], [500, -250, 2000, 0]]


def test_a_held_end_is_written_unless_a_tracked_point_is_it_or_has_its_name():
    """An end that was never seen is in no place; one that is a point when it is seen is that point."""
    take = a_take(20)
    assert marker_tracks(take).labels[4:] == ("held_left", "held_right")
    np.testing.assert_array_equal(marker_tracks(take).positions[:, 4:], take.held)
    assert marker_tracks(take).time[0] == 0
    assert marker_tracks(named("a", "b", "held_left", "d")).labels[4:] == ("held_right",)
    take.points[:, 2] = take.held[:, 1]
    take.held_valid[5], take.points[5, 2] = False, 1.0
    assert marker_tracks(take).labels[4:] == ("held_left",)
    take.points[6, 2, 1] += 1e-3
    assert marker_tracks(take).labels[4:] == ("held_left", "held_right")
    take.points[6] = take.held[6, 1]
    take.held_valid[:, 1] = False
    assert marker_tracks(take).labels[4:] == ("held_left", "held_right")
    take.held_valid[:] = False
    assert marker_tracks(take).labels[4:] == ("held_left", "held_right")


@pytest.mark.parametrize("name", [".", "/", ".partial"])
@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_a_folder_and_a_file_without_a_stem_are_refused_in_one_line(tmp_path, name, to):
    out = f"some.{to}" if to == "parquet" else "some"
    done = hangtime_here("takes", "export", name, "--to", to, "--out", out, folder=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith(f"hangtime: {name}: cannot be read (")
