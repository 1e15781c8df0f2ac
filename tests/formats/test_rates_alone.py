"""A file with a frame rate and no times is refused for its rate, and not for computed times."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.errors import ImplausibleError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_import import GARMENT, hanging_tracks
from tests.formats.test_marker_tables import MOTIVE, QTM, VICON, read


def written(tmp_path, rate, copy):
    raw = c3d_bytes(1e3 * hanging_tracks().positions, list(GARMENT.point_names), rate=rate, header={"rate": copy})
    (tmp_path / "a.c3d").write_bytes(raw)
    return tmp_path / "a.c3d"


@pytest.mark.parametrize(
    ("rate", "copy", "words"),
    [
        (0.8, 0.8, "states 0.8 frames a second; 5 to 1000 can be used; export it again with its frame rate"),
        (2500.0, 2500.0, "states 2500 frames a second; 5 to 1000 can be used; export it again"),
        (100.0, 50.0, "states 100 frames a second, and its header 50; export it again with its frame rate"),
    ],
)
def test_a_rate_that_no_camera_has_or_a_copy_contradicts_is_named(tmp_path, rate, copy, words):
    path = written(tmp_path, rate, copy)
    with pytest.raises(ImplausibleError, match=re.escape(words)):
        import_marker_take(path, GARMENT)
    found = import_marker_take(path, GARMENT, MarkerOptions(anyway=True))
    assert 1 / np.median(np.diff(found.time)) == pytest.approx(rate)


@pytest.mark.parametrize(("rate", "copy"), [(5.0, 5.0), (1000.0, 1000.0), (100.0, 0.0), (100.0, 90.0)])
def test_a_rate_of_cameras_is_imported(tmp_path, rate, copy):
    assert len(import_marker_take(written(tmp_path, rate, copy), GARMENT).time) == 30


def test_only_files_with_a_time_for_each_frame_have_times(tmp_path):
    assert not read_marker_tracks(written(tmp_path, 100.0, 100.0)).has_times
    assert not read(tmp_path, VICON, None, "a.csv").has_times
    assert not read(tmp_path, QTM, None, "a.tsv").has_times
    clocked = QTM.replace("\n1\t", "\nFrame\tTime\tone X\n1\t0.5\t1\t").replace("\n7\t", "\n2\t0.6\t7\t")
    assert read(tmp_path, clocked.replace("\n\t\t", "\n3\t0.7\t\t\t"), None, "a.tsv").has_times
    assert read(tmp_path, MOTIVE, None, "a.csv").has_times
