"""C3D files are written in pieces, and other libraries read what was written."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from formats.exporters.c3d_writer import c3d_pieces
from formats.exporters.marker_files import MOST_C3D_FRAMES, write_c3d, write_csv
from formats.importers.marker_files import read_marker_tracks
from tests.formats.test_archive import a_take
from tests.formats.test_export_oddities import named

NAMES = ("=1,5", 'a"b', "A\u0308rmel", "\u00c4rmel")  # the last two differ in their composition only


def written(tmp_path, labels, positions, rate=69.99):
    (tmp_path / "a.c3d").write_bytes(b"".join(c3d_pieces(labels, positions, rate)))
    return tmp_path / "a.c3d"


@pytest.mark.parametrize("points", [1, 4, 255, 256, 600])
@pytest.mark.parametrize("frames", [1, 32, 700])
def test_what_is_written_is_read_back_and_fills_its_blocks(tmp_path, points, frames):
    rng = np.random.default_rng(points)
    places = rng.uniform(0.1, 2.0, (frames, points, 3))
    places[rng.uniform(size=(frames, points)) < 0.1] = np.nan
    places[0, 0] = 1.0
    path = written(tmp_path, [f"marker {k}" for k in range(points)], places)
    found = read_marker_tracks(path)
    assert found.labels == tuple(f"marker {k}" for k in range(points))
    assert (path.stat().st_size % 512, found.warning) == (0, "")
    np.testing.assert_allclose(found.positions, places, rtol=2e-7)
    np.testing.assert_allclose(found.time, np.arange(frames) / 69.99, rtol=1e-6)


def test_another_library_reads_the_same(tmp_path):
    ezc3d = pytest.importorskip("ezc3d")
    places = np.random.default_rng(0).uniform(0.1, 2.0, (40, 300, 3))
    places[3, 5] = np.nan
    labels = [*NAMES, *(f"marker {k}" for k in range(296))]
    found = ezc3d.c3d(str(written(tmp_path, labels, places)))
    point = found["parameters"]["POINT"]
    assert point["LABELS"]["value"] + point["LABELS2"]["value"] == labels
    assert (point["UNITS"]["value"], found["header"]["points"]["last_frame"]) == (["mm"], 39)
    assert point["RATE"]["value"][0] == pytest.approx(69.99)
    seen = np.moveaxis(found["data"]["points"][:3], (0, 1, 2), (2, 1, 0))
    np.testing.assert_allclose(seen, 1e3 * places, rtol=2e-7)


@pytest.mark.parametrize("frames", [32768, MOST_C3D_FRAMES])
def test_another_library_reads_as_many_frames_as_the_longest_take_has(tmp_path, frames):
    """The last block is not full: ezc3d reads 65535 frames of 3 points as 65536, of which one is zeros."""
    ezc3d = pytest.importorskip("ezc3d")
    found = ezc3d.c3d(str(written(tmp_path, ["a", "b", "c"], np.ones((frames, 3, 3)))))
    assert found["data"]["points"].shape == (4, 3, frames)


@pytest.mark.parametrize("write", [write_c3d, write_csv])
def test_names_with_accents_come_back_as_they_were_composed(tmp_path, write):
    path = tmp_path / f"a.{write.__name__[6:]}"
    write(path, named(*NAMES))
    assert read_marker_tracks(path).labels[:4] == NAMES


def test_more_names_than_the_parameters_hold_are_refused(tmp_path):
    """Of 127 bytes each, with the descriptions' records, in 255 blocks of 512."""
    with pytest.raises(ValueError, match="the names of its 1100 points take more than 130560 bytes"):
        c3d_pieces(["x" * 127] * 1100, np.ones((2, 1100, 3)), 30.0)


@pytest.mark.parametrize("write", [write_c3d, write_csv])
def test_a_long_take_is_written_in_little_memory(tmp_path, write):
    """Of 20,000 frames and 6 points, of which the held ends' positions are copied: 2.9 MB."""
    take = a_take(20_000 if write is write_c3d else 4_000)
    tracemalloc.start()
    try:
        write(tmp_path / "a", take)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < (16e6 if write is write_c3d else 1.5e6)
