"""The hanger's frame and held ends, and units of length, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from formats.errors import DescriptionError, TakeError
from formats.hanger import hanger_frame, held_ends
from formats.importers.marker_tracks import MarkerTracks, write_marker_csv
from formats.importers.missing_values import as_seen
from formats.importers.swatch_mocap import import_marker_take
from formats.importers.units import metres_of
from formats.rig import Hanger, Rig
from tests.formats.test_marker_import import GARMENT, hanging_tracks

MARKERS = np.array([[1.0, 2.0, 3.0], [1.3, 2.0, 3.4]])  # 0.5 m apart, level: gravity is the sensor's y


def a_rig(**changed):
    given = {"format": "hangtime-rig/1", "name": "bench", "gravity": (0.0, 1.0, 0.0)}
    return Rig(**(given | changed))


def test_a_hangers_axes_are_along_its_markers_down_and_square_to_both():
    frame = hanger_frame(MARKERS, a_rig())
    assert frame == pytest.approx(np.stack([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]], axis=1))
    # A bar that hangs down to the right: down is what is left of gravity square to the bar.
    tilted = hanger_frame(np.array([[0.0, 0.0, 0.0], [0.8, 0.6, 0.0]]), a_rig())
    assert tilted == pytest.approx(np.stack([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]], axis=1))


def test_held_ends_are_where_the_rig_says_from_the_middle_of_the_markers():
    """0.2 m along the bar, 0.03 m down and 0.01 m square to both, of a middle at (1.15, 2, 3.2)."""
    sizes = {"marker_distance_m": 0.5, "marker_size_m": 0.05}
    rig = a_rig(hanger=Hanger(held_m=((-0.2, 0.03, 0.0), (0.2, 0.03, 0.01)), **sizes))
    found = held_ends(np.stack([MARKERS, MARKERS + 1.0, np.full((2, 3), np.nan)]), rig)
    left = np.array([1.15 - 0.12, 2.03, 3.2 - 0.16])
    right = np.array([1.15 + 0.12 - 0.008, 2.03, 3.2 + 0.16 + 0.006])
    assert found[0] == pytest.approx(np.stack([left, right]))
    assert found[1] == pytest.approx(np.stack([left, right]) + 1.0)
    assert np.isnan(found[2]).all()
    with pytest.raises(DescriptionError, match=r"no \[hanger\]"):
        held_ends(MARKERS, a_rig())


@pytest.mark.parametrize(
    ("word", "metres"),
    [("m", 1.0), ("dm", 0.1), ("cm", 0.01), ("mm", 1e-3), ("um", 1e-6), ("µm", 1e-6), ("in", 0.0254), ("ft", 0.3048),
     ("Metres", 1.0), ("[mm]", 1e-3), ("centimeter", 0.01), ("Inches", 0.0254), ("feet", 0.3048), ("foot", 0.3048),
     ("microns", 1e-6), (" (mm). ", 1e-3)],
)  # fmt: skip
def test_a_unit_is_so_many_metres_however_it_is_spelt(word, metres):
    assert metres_of(word, None, "a") == metres
    assert metres_of("", word, "a") == metres
    assert metres_of(word, word, "a") == metres


@pytest.mark.parametrize(
    ("stated", "given", "words"),
    [("", None, "states no unit"), ("ell", None, "the unit of its points is 'ell'"), ("mm", "m", "in mm, not m"),
     ("mm", "ell", "no unit 'ell'")],
)  # fmt: skip
def test_a_unit_that_is_unknown_or_contradicts_is_refused(stated, given, words):
    with pytest.raises(TakeError, match=words):
        metres_of(stated, given, "a")


def test_a_marker_at_the_origin_or_without_a_number_was_not_seen():
    places = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [np.inf, 1.0, 1.0], [1.0, 2.0, 3.0]]])
    assert np.isnan(as_seen(places)).all(2).tolist() == [[True, False, True, False]]
    absent = np.array([[False, True, False, False]])
    assert np.isnan(as_seen(places, absent)).all(2).tolist() == [[True, True, True, False]]


def test_markers_of_motion_capture_are_known_to_three_tenths_of_a_millimetre(tmp_path):
    """Times count from the first frame; where a held marker is lost the frame says so."""
    tracks = hanging_tracks()
    tracks.positions[4, 0] = np.nan
    late = MarkerTracks(tracks.labels, tracks.time + 2.0, tracks.positions)
    take = import_marker_take(write_marker_csv(tmp_path / "a.csv", late), GARMENT)
    assert take.time == pytest.approx(tracks.time, abs=2e-6)
    assert (take.points_sd == 3e-4).all()
    assert (take.held_sd == 3e-4).all()
    assert np.flatnonzero(take.state).tolist() == [4]
    assert np.argwhere(~take.points_valid).tolist() == [[4, 0]]
    assert np.argwhere(~take.held_valid).tolist() == [[4, 0]]


@pytest.mark.parametrize(("frames", "is_enough"), [(20, True), (19, False)])
def test_twenty_frames_are_a_take(tmp_path, frames, is_enough):
    path = write_marker_csv(tmp_path / "a.csv", hanging_tracks(frames))
    if is_enough:
        assert len(import_marker_take(path, GARMENT).time) == frames
    else:
        with pytest.raises(TakeError, match="has 19 frames, 20 are needed"):
            import_marker_take(path, GARMENT)


@pytest.mark.parametrize(("stretch", "is_possible"), [(1.24, True), (1.26, False)])
def test_cloth_stretches_by_a_quarter_at_most(tmp_path, stretch, is_possible):
    tracks = hanging_tracks()
    wide = MarkerTracks(tracks.labels, tracks.time, tracks.positions * [stretch, 1.0, 1.0])
    path = write_marker_csv(tmp_path / "a.csv", wide)
    if is_possible:
        import_marker_take(path, GARMENT)
    else:
        with pytest.raises(TakeError, match="on the flat garment"):
            import_marker_take(path, GARMENT)
