"""Zeros that may be true positions of markers cause a warning, and zeros of gaps do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import write_marker_csv
from formats.importers.missing_values import warning_of_zeros
from formats.importers.swatch_mocap import import_marker_take
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_oddities import GARMENT, hanging

CORNERS = [GARMENT.point_names[k] for k in (0, 3)]
HELD = "the markers on the two top corners drive the simulation: record with both in view"
MOVE = "where a marker was at 0, 0, 0, move the origin and export again"


def swung(begin):
    """The swatch at rest with its first corner at the origin, then swung sideways from a frame on; 60 frames."""
    tracks = hanging(60)
    away = 0.1 * np.sin(0.1 * np.maximum(np.arange(60) - begin, 0))
    places = tracks.positions - tracks.positions[0, 0]
    places[..., 0] += away[:, None]
    return replace(tracks, positions=places)


def written(tmp_path, tracks, ending):
    path = tmp_path / f"a{ending}"
    if ending == ".c3d":
        path.write_bytes(c3d_bytes(1e3 * tracks.positions, tracks.labels))
    else:
        write_marker_csv(path, tracks)
        path.write_text(path.read_text().replace(",,,", ",0,0,0,"))
    return path


@pytest.mark.parametrize(("ending", "where"), [(".csv", "line 2"), (".c3d", "frame 1")])
def test_zeros_to_which_the_path_of_a_marker_lead_are_reported_with_their_number(tmp_path, ending, where):
    """The corner begins to move in frame 22, by 10 mm; steps are 10 mm at most."""
    found = read_marker_tracks(written(tmp_path, swung(20), ending))
    assert found.warning == (
        f"0, 0, 0 counts as not seen, first in {where}: {CORNERS[0]} 21 times, with a position 10 mm from there in a "
        "neighbouring frame; if markers were there, move the origin and export again"
    )
    assert np.isnan(found.positions[:21, 0]).all()


@pytest.mark.parametrize("ending", [".csv", ".c3d"])
def test_zeros_of_a_gap_far_from_the_origin_are_not_reported(tmp_path, ending):
    """No position beside the gap is nearer than 15 mm, and no step is longer than 10 mm."""
    tracks = swung(0)
    tracks.positions[:, 0, 1] += 0.015
    tracks.positions[30:40, 0] = 0
    found = read_marker_tracks(written(tmp_path, tracks, ending))
    assert found.warning == ""
    assert np.isnan(found.positions[:, 0, 0]).sum() == 10


@pytest.mark.parametrize(
    ("zeros", "gone", "sentence"),
    [
        ([0], [], f"'{CORNERS[0]}' was never seen: '{CORNERS[0]}' is at 0, 0, 0 60 times, which counts as not seen; "
         f"{HELD}; {MOVE}"),
        ([0, 3], [], f"'{CORNERS[0]}' and '{CORNERS[1]}' were never seen: '{CORNERS[0]}' is at 0, 0, 0 60 times, "
         f"which counts as not seen; {HELD}; {MOVE}"),
        ([], [3], f"'{CORNERS[1]}' was never seen; {HELD}"),
        ([0], [3], f"'{CORNERS[0]}' and '{CORNERS[1]}' were never seen: '{CORNERS[0]}' is at 0, 0, 0 60 times, "
         f"which counts as not seen; {HELD}; {MOVE}"),
        ([5], [3], f"'{CORNERS[1]}' was never seen; {HELD}"),
    ],
)  # fmt: skip
def test_a_corner_that_was_never_seen_says_how_often_zeros_stand_for_it(tmp_path, zeros, gone, sentence):
    tracks = hanging(60)
    tracks.positions[:, zeros] = 0
    path = written(tmp_path, tracks, ".csv")
    for marker in gone:
        lines = [line.split(",") for line in path.read_text().splitlines()]
        for cells in lines[1:]:
            cells[1 + 3 * marker : 4 + 3 * marker] = ["", "", ""]
        path.write_text("".join(",".join(cells) + "\n" for cells in lines))
    with pytest.raises(TakeError) as refused:
        import_marker_take(path, GARMENT)
    assert str(refused.value) == f"{path}: {sentence}"


def test_zeros_may_be_a_position_where_the_path_on_either_side_of_them_is_near():
    """Steps of 10 mm; before three zeros the marker is 8 mm away, and after them 200 mm."""
    path = np.zeros((60, 1, 3))
    path[:, 0, 0] = 0.008 + 0.01 * np.abs(np.arange(60) - 30)
    path[33:, 0, 0] = 0.2 + 0.01 * np.arange(27)
    zeros = np.isin(np.arange(60), (31, 32))[:, None]
    path[zeros] = np.nan
    for order in (1, -1):
        warning = warning_of_zeros(zeros[::order], path[::order], ["a"], "frame {}".format)
        assert "a 2 times, with a position 8 mm from there in a neighbouring frame" in warning
