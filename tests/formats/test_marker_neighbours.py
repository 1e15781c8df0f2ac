"""Distances between neighbouring markers tell a wrong unit from two markers whose names are exchanged."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import msgspec
import numpy as np
import pytest

from formats.errors import TakeError
from formats.garment import TrackedPoint
from formats.importers.marker_neighbours import warning_of_far_markers
from formats.importers.marker_tracks import write_marker_csv
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from tests.formats.test_marker_oddities import GARMENT, hanging

NAMES = GARMENT.point_names


def imported(tmp_path, change=lambda places: places, garment=GARMENT, **options):
    tracks = hanging()
    path = write_marker_csv(tmp_path / "a.csv", replace(tracks, positions=change(tracks.positions.copy())))
    return import_marker_take(path, garment, MarkerOptions(**options))


def with_exchanged(one, other):
    def change(places):
        places[:, [one, other]] = places[:, [other, one]]
        return places

    return change


@pytest.mark.parametrize("pair", list(combinations(range(0, 16, 3), 2)))
@pytest.mark.parametrize("unseen", [False, True])
def test_two_markers_with_exchanged_names_are_named_and_no_unit_is(tmp_path, pair, unseen):
    """Neighbours three columns apart are 2.5 to 3 times too far apart, as centimetres taken for inches would be."""

    def change(places):
        places = with_exchanged(*pair)(places)
        if unseen:
            places[::2, (pair[0] + 1) % 16] = np.nan
        return places

    names = " and ".join(f"'{NAMES[k]}'" for k in pair)
    with pytest.raises(TakeError, match=f"; are the names of {names} exchanged\\? Check the names of the markers$"):
        imported(tmp_path, change)


def test_names_that_no_single_exchange_puts_right_bring_no_question(tmp_path):
    def change(places):
        return with_exchanged(3, 12)(with_exchanged(0, 15)(places))

    with pytest.raises(TakeError, match=r"on the flat garment 167 mm; check the unit, the garment's size and th"):
        imported(tmp_path, change)


def test_a_single_marker_elsewhere_brings_no_question_of_a_unit(tmp_path):
    def change(places):
        places[:, 5, 1] += 10 * 0.5 / 3  # ten times the distance to its neighbours: centimetres and millimetres
        return places

    with pytest.raises(TakeError, match=r"167 mm; check the unit, the garment's size and the names of the markers$"):
        imported(tmp_path, change)


def test_a_marker_elsewhere_that_the_fullest_frame_lacks_is_not_exchanged_with_its_diagonal_neighbour(tmp_path):
    """In frame 1 alone the wrong corner is not seen; elsewhere two markers are not, so that frame 1 has the most."""

    def change(places):
        places[:, 15, 1] += 1.0
        places[0, 15] = places[1:, [4, 8]] = np.nan
        return places

    with pytest.raises(TakeError, match=r"check the unit, the garment's size and the names of the markers$"):
        imported(tmp_path, change)


@pytest.mark.parametrize("lacking", [15, 10])
def test_exchanged_names_are_told_from_a_frame_that_has_both(tmp_path, lacking):
    def change(places):
        places = with_exchanged(10, 15)(places)
        places[0, lacking] = places[1:, [4, 8]] = np.nan
        return places

    with pytest.raises(TakeError, match=f"; are the names of '{NAMES[10]}' and '{NAMES[15]}' exchanged"):
        imported(tmp_path, change)


def test_two_points_that_the_garment_has_at_one_place_end_in_a_sentence(tmp_path):
    """`--anyway` accepts them, and they are no neighbours of each other."""
    points = [
        TrackedPoint(name=point.name, at_m=GARMENT.points[4].at_m if k == 5 else point.at_m)
        for k, point in enumerate(GARMENT.points)
    ]
    garment = msgspec.structs.replace(GARMENT, points=tuple(points))
    take = imported(tmp_path, with_at_one_place, garment, anyway=True)
    np.testing.assert_allclose(take.points[:, 4], take.points[:, 5], atol=1e-6)
    with pytest.raises(TakeError, match="mm apart, on the flat garment"):
        imported(tmp_path, garment=garment, anyway=True)


def with_at_one_place(places):
    places[:, 5] = places[:, 4]
    return places


def test_a_marker_beyond_the_reach_of_a_take_is_named_with_its_frame(tmp_path):
    """The archive counts frames and points from 0, and knows no names."""

    def change(places, away=1001.5):
        places[7:17, 9, 2] = -away
        return places

    name = NAMES[9]
    told = f"the marker '{name}' lies 1001.5 m from the origin in frame 8; check the unit, and move the origin: a take "
    with pytest.raises(TakeError, match=told):
        imported(tmp_path, change, anyway=True)
    assert imported(tmp_path, lambda places: change(places, 999.5), anyway=True).points.shape[1] == 16


def doubts_of(tmp_path, change, frames=60, **options):
    tracks = hanging(frames)
    path = write_marker_csv(tmp_path / "a.csv", replace(tracks, positions=change(tracks.positions.copy())))
    return import_marker_take(path, GARMENT, MarkerOptions(**options)).notes.get("file", "")


def test_labels_exchanged_behind_a_long_gap_are_named_with_their_seconds(tmp_path):
    """No path leads over a gap of 20 frames; the distances on the garment show the exchange."""

    def change(places):
        found = with_exchanged(5, 10)(places.copy())
        found[:60] = places[:60]
        found[40:60, [5, 10]] = np.nan
        return found

    names = f"{NAMES[5]!r}, {NAMES[10]!r}"
    assert doubts_of(tmp_path, change, frames=80) == (
        f"{names} are further from the others than the cloth reaches in 20 frames, from 0.60 to 0.79 s; are their "
        "labels exchanged there?"
    )


def test_a_marker_with_the_label_of_another_one_in_one_frame_is_named(tmp_path):
    def change(places):
        places[20:40, 5] = np.nan
        places[40, 5] = places[40, 5] + [0.3, 0, 0]
        places[41:, 5] = np.nan
        return places

    assert doubts_of(tmp_path, change) == (
        f"{NAMES[5]!r} is further from the others than the cloth reaches in 1 frame, at 0.40 s; is another marker "
        "labelled so there?"
    )


@pytest.mark.parametrize("stretch", [0.0, 0.2])
def test_cloth_that_stretches_a_little_or_folds_is_not_named(tmp_path, stretch):
    def change(places):
        places[20:40, :, 2] = 1.5 + (places[20:40, :, 2] - 1.5) * (1 + stretch)
        places[40:50, :, 2] = 1.5 + (places[40:50, :, 2] - 1.5) * 0.7
        return places

    assert doubts_of(tmp_path, change) == ""


def small_grid(frames):
    """A swatch of 6 x 6 markers 20 mm apart, its still positions [m] and their times [s]."""
    k = np.arange(36)
    at = 0.02 * np.stack([k % 6, -(k // 6)], 1)
    points = tuple(TrackedPoint(name=f"m{one}", at_m=tuple(at[one].tolist())) for one in k)
    places = np.tile(np.stack([at[:, 0], 0 * k, at[:, 1]], 1), (frames, 1, 1))
    return msgspec.structs.replace(GARMENT, points=points), places, np.arange(frames) / 100


def test_noise_of_several_mm_is_called_no_exchange():
    garment, places, time = small_grid(300)
    told = warning_of_far_markers(time, places + np.random.default_rng(0).normal(0, 4e-3, places.shape), garment)
    assert told.endswith("; is their noise of several mm, or the garment larger than described?")


@pytest.mark.parametrize(("frames", "count"), [(600, "in 10 frames"), (2000, "in about 10 frames")])
def test_only_frames_beyond_the_noise_are_counted(frames, count):
    """A marker lies 1 mm beyond the reach in all frames, which its noise may do, and 20 mm in ten of them."""
    garment, places, time = small_grid(frames)
    places[:, 35, 0] += 0.25 * 0.02 + 5e-3 + 1e-3
    places[50:60, 35, 0] += 0.02
    assert f"{count}, " in warning_of_far_markers(time, places, garment)
