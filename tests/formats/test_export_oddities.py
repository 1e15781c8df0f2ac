"""Marker files of odd takes: the origin, frames between two places of a rate, names that a file cannot keep."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.archive import write_take
from formats.errors import TakeError
from formats.exporters.marker_files import write_c3d, write_csv
from formats.importers.marker_files import read_marker_tracks
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
    if write is write_c3d:
        pytest.importorskip("ezc3d")
    take = a_take(20)
    take.points[:, 1], take.points_valid[:, 1] = [least, -least, 0.0], True
    path = tmp_path / f"a.{write.__name__[-3:]}"
    write(path, take)
    back = read_marker_tracks(path).positions[:, 1]
    np.testing.assert_allclose(back, take.points[:, 1], atol=1.01e-6)


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[2J", "a ", " a", "a\u202eb"])
@pytest.mark.parametrize("write", [write_csv, write_c3d])
def test_a_name_that_would_not_come_back_is_refused(tmp_path, write, name):
    if write is write_c3d:
        pytest.importorskip("ezc3d")
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
    pytest.importorskip("ezc3d")
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
