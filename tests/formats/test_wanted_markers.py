"""Damage to unused markers and frames is not reported."""

from __future__ import annotations

from dataclasses import replace
from unicodedata import normalize

import msgspec
import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_lines import Rows
from formats.importers.marker_tracks import Wanted, write_marker_csv
from formats.importers.stated_values import warning_of_count
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_oddities import GARMENT, hanging

NAMES = GARMENT.point_names
FRAMES = 60


def with_another(*, jump=None, sign=None, part=None):
    """The hanging swatch and a marker `spare`, of which one (frame, marker) jumps, is -1, or lacks its z."""
    tracks = hanging(FRAMES)
    places = np.concatenate([tracks.positions, tracks.positions[:, :1] + 0.5], 1)
    places[..., 0] += 0.01 * np.sin(np.arange(FRAMES) / 9)[:, None]
    if jump:
        places[jump] += 0.7
    if sign:
        places[sign] = -1.0
    if part:
        places[(*part, 2)] = np.nan
    return replace(tracks, labels=(*NAMES, "spare"), positions=places)


def written(tmp_path, tracks, ending):
    path = tmp_path / f"a{ending}"
    if ending == ".c3d":
        path.write_bytes(c3d_bytes(1e3 * tracks.positions, tracks.labels))
    else:
        write_marker_csv(path, tracks)
    return path


DAMAGED = pytest.mark.parametrize(
    ("damage", "ending"),
    [("jump", ".csv"), ("sign", ".csv"), ("part", ".csv"), ("jump", ".c3d"), ("sign", ".c3d")],
)
SPARE, LATE, EARLY = (20, 16), (50, 3), (20, 3)


@DAMAGED
def test_damage_to_a_marker_that_the_garment_lacks_is_not_reported(tmp_path, damage, ending):
    path = written(tmp_path, with_another(**{damage: SPARE}), ending)
    assert read_marker_tracks(path).warning
    take = import_marker_take(path, GARMENT)
    assert "file" not in take.notes
    assert take.notes["markers"] == "16 of the 17 markers in the file"
    assert np.isfinite(take.points).all()
    assert import_marker_take(written(tmp_path, with_another(**{damage: EARLY}), ending), GARMENT).notes["file"]


@DAMAGED
def test_damage_behind_the_frames_that_are_kept_is_not_reported(tmp_path, damage, ending):
    path = written(tmp_path, with_another(**{damage: LATE}), ending)
    assert "file" in import_marker_take(path, GARMENT).notes
    take = import_marker_take(path, GARMENT, MarkerOptions(frames=40))
    assert (len(take.time), "file" in take.notes) == (40, False)


def test_a_cut_last_number_matters_to_its_marker_alone(tmp_path):
    path = written(tmp_path, with_another(), ".csv")
    path.write_text(path.read_text().rstrip("\n")[:-3])
    with pytest.raises(TakeError, match="ends within a number"):
        read_marker_tracks(path)
    assert "file" not in import_marker_take(path, GARMENT).notes


def test_zero_blocks_of_c3d_matter_to_their_markers_and_frames_alone(tmp_path):
    """A frame has 48 points of 16 bytes. Block 61 holds the last 16 of frame 41, and the garment's in frame 42."""
    spare = [f"spare{k}" for k in range(32)]
    places = np.concatenate([hanging(FRAMES).positions, 1.0 + np.arange(FRAMES * 96).reshape(-1, 32, 3) * 1e-4], 1)
    raw = bytearray(c3d_bytes(1e3 * places, (*NAMES, *spare)))
    begin = 512 * (int.from_bytes(raw[16:18], "little") - 1) + 512 * 61
    raw[begin : begin + 512] = bytes(512)
    path = tmp_path / "a.c3d"
    path.write_bytes(raw)
    assert read_marker_tracks(path).warning.startswith("frames 41 to 42 hold 1 block of 512 zero bytes")
    assert import_marker_take(path, GARMENT).notes["file"].startswith("frame 42 holds 1 block of 512 zero bytes")
    assert "file" not in import_marker_take(path, GARMENT, MarkerOptions(frames=41)).notes
    assert read_marker_tracks(path, wanted=Wanted(tuple(spare[:4]))).warning == ""


def test_more_frames_than_stated_matter_where_they_are_wanted(tmp_path):
    nine = Rows(["1,2"] * 9, range(1, 10), ",", tmp_path / "a.csv")
    assert warning_of_count(nine, 6, None, tmp_path) == "the file states 6 frames and holds 9; all of them were read"
    assert (
        warning_of_count(nine, 6, 9, tmp_path)
        == warning_of_count(nine, 6, 12, tmp_path)
        == warning_of_count(nine, 6, None, tmp_path)
    )
    assert warning_of_count(nine, 6, 8, tmp_path) == "the file states 6 frames and holds 9; the first 8 were read"
    assert warning_of_count(nine, 6, 6, tmp_path) == ""


def test_markers_that_were_not_seen_in_the_kept_frames_are_those_of_the_garment(tmp_path):
    tracks = with_another()
    tracks.positions[:30, :16] = np.nan
    path = written(tmp_path, tracks, ".csv")
    with pytest.raises(TakeError, match="none of the garment's markers was seen in the first 30 frames; export their"):
        import_marker_take(path, GARMENT, MarkerOptions(frames=30))
    assert len(import_marker_take(path, GARMENT).time) == FRAMES


def test_of_markers_of_one_name_those_of_the_subject_are_used():
    wanted = Wanted(("a", "b"), "Jane")
    assert wanted.markers(["John:a", "Jane:b ", "Jane:a", "c"]) == [1, 2]
    assert Wanted(("a", "b")).markers(["John:a", "Jane:b", "Jane:a", "c"]) == [0, 1, 2]
    assert Wanted(("x",)).markers(["John:a", "c"]) == [0, 1]


@pytest.mark.parametrize("ending", [".csv", ".c3d"])
@pytest.mark.parametrize(("own", "theirs"), [("NFC", "NFD"), ("NFD", "NFC")])
def test_a_name_is_found_whether_its_accents_are_composed_or_not(tmp_path, ending, own, theirs):
    """macOS writes a letter and its accent as two characters; a subject's name may be written so too."""
    points = tuple(msgspec.structs.replace(one, name=normalize(own, f"Ä{one.name}")) for one in GARMENT.points)
    garment = msgspec.structs.replace(GARMENT, points=points)
    labels = tuple(normalize(theirs, f"Käte:Ä{name}") for name in NAMES)
    tracks = replace(hanging(FRAMES), labels=labels)
    path = written(tmp_path, tracks, ending)
    take = import_marker_take(path, garment, MarkerOptions(subject=normalize(own, "Käte")))
    np.testing.assert_allclose(take.points, tracks.positions, atol=1e-6)
    with pytest.raises(TakeError, match="has no subject 'Kate'"):
        import_marker_take(path, GARMENT, MarkerOptions(subject="Kate"))
