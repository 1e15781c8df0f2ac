"""Input files of an import, archives of arrays and marker files, are read whole or refused with exact messages."""

from __future__ import annotations

import os
from datetime import UTC, datetime

import msgspec
import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.npz import load_arrays
from formats.importers.swung_cloth import import_swung_cloth
from formats.rig import Rig
from tests.formats.test_marker_tables import OWN
from tests.formats.test_swung_cloth_import import changed, with_value
from tests.formats.test_two_clocks import recorded


def refused(read, *given, **named):
    with pytest.raises(TakeError) as error:
        read(*given, **named)
    return str(error.value)


def loaded(path, names=("t", "u"), most=8000):
    return load_arrays(path, names, most_bytes=most, advice="give less")


def test_arrays_that_are_asked_for_are_read_and_no_others(tmp_path):
    np.savez(tmp_path / "a.npz", t=np.arange(3), u=np.ones((2, 2)), more=np.zeros(10**6))
    found = loaded(tmp_path / "a.npz")
    assert {name: values.tolist() for name, values in found.items()} == {"t": [0, 1, 2], "u": [[1, 1], [1, 1]]}


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda path: None, "cannot be read (No such file or directory); check the path"),
        (lambda path: path.touch(), "is empty; give less"),
        (lambda path: path.write_bytes(b"x"), "is no .npz archive; give less"),
        (lambda path: path.mkdir(), "cannot be read (Is a directory); give a file: this is a folder"),
        (os.mkfifo, "cannot be read (the path is a pipe or a device, and no file); check the path"),
        (lambda path: np.savez(path, t=np.zeros(3)), "has no array 'u'; give less"),
        (lambda path: np.savez(path, t=np.zeros(3), u=np.array([{}])),
         "is an .npz archive that is damaged or holds objects; give less"),
        (lambda path: np.savez(path, t=np.zeros(900), u=np.zeros(101, np.int8)),
         "its arrays have 8.0 kB; import shorter recordings"),
        (lambda path: np.savez_compressed(path, t=np.zeros(0), u=np.zeros(10**6)),
         "its arrays have 8.0 MB; import shorter recordings"),
    ],
    ids=["absent", "empty", "text", "folder", "pipe", "an array short", "objects", "small numbers", "packed"],
)  # fmt: skip
def test_an_archive_that_cannot_be_used_says_why(tmp_path, make, sentence):
    make(tmp_path / "a.npz")
    assert refused(loaded, tmp_path / "a.npz") == f"{tmp_path}/a.npz: {sentence}"


def test_arrays_of_just_so_many_bytes_are_read(tmp_path):
    np.savez(tmp_path / "a.npz", t=np.zeros(800), u=np.zeros(168, np.int8))
    assert loaded(tmp_path / "a.npz")["t"].size == 800


@pytest.mark.parametrize(
    ("name", "make", "sentence"),
    [
        ("a.csv", lambda path: None, "cannot be read (No such file or directory); check the path"),
        ("a.csv", lambda path: path.mkdir(), "is a folder without .c3d, .trc, .csv, .tsv or .txt; give files of "
         "recordings"),
        ("a.csv", os.mkfifo, "cannot be read (the path is a pipe or a device, and no file); check the path"),
        ("a.XYZ", lambda path: path.touch(), ".xyz is not a marker file; give .c3d, .trc, .csv, .tsv, .txt"),
        ("a", lambda path: path.touch(),
         "a file without ending is not a marker file; give .c3d, .trc, .csv, .tsv, .txt"),
        ("a.TXT", lambda path: path.write_text(f"{OWN}0,,,,,,\n1,0,0,0,,,\n"),
         "no marker was ever seen; export the trajectories, not only their names"),
        ("a.csv", lambda path: path.write_bytes(b"\x02\x50\xff\1" * 99),
         "cannot be read (not a text file); the file looks like C3D: give it the ending .c3d"),
        ("a.csv", lambda path: path.write_bytes(b"\x02\x51\xff\1" * 99),
         "cannot be read (not a text file); export it as text again"),
    ],
    ids=["absent", "folder", "pipe", "ending", "no ending", "unseen", "c3d", "binary"],
)  # fmt: skip
def test_a_file_that_is_no_marker_file_says_what_it_is(tmp_path, name, make, sentence):
    make(tmp_path / name)
    assert refused(read_marker_tracks, tmp_path / name) == f"{tmp_path}/{name}: {sentence}"


def test_a_recording_becomes_a_take_that_says_whence_it_is(tmp_path):
    path = changed(tmp_path / "r.npz", points=with_value((4, 9), np.nan), valid=with_value((5, 3), False))
    os.utime(path, (1.75e9, 1.75e9))
    take = import_swung_cloth(path)
    assert (take.take_id, take.source) == ("r", "r.npz, re-packed from Alados5/tfm_matlab")
    assert take.created == datetime.fromtimestamp(1.75e9, UTC).isoformat()
    assert take.rig == Rig(format="hangtime-rig/1", name="robot arm, robot base frame", gravity=(0.0, 0.0, -1.0))
    mass = "not recorded; the garment's weight is that of the median of 618 fabrics"
    points = "a re-gridded silhouette, not material markers: edges are eaten, corners jump"
    assert take.notes == {"mass": mass, "points": points}
    assert (take.garment.format, take.garment.name, take.garment.kind) == (
        "hangtime-garment/2",
        "swung cloth",
        "swatch",
    )
    assert (take.garment.held, take.garment.points_are) == ("edge", "silhouette")
    np.testing.assert_array_equal(take.markers, take.held)
    assert np.argwhere(~take.points_valid).tolist() == [[4, 9], [5, 3]]
    assert np.argwhere(np.isnan(take.points).all(2)).tolist() == [[4, 9], [5, 3]]
    assert not take.state.any()
    assert take.state.dtype == np.uint16
    assert take.is_complete
    mine = msgspec.structs.replace(take.garment, points_are="material", name="mine")
    again = import_swung_cloth(path, mine)
    assert (again.garment, again.notes) == (mine, {"points": points})


@pytest.mark.parametrize("is_crossed", [False, True])
def test_the_sights_of_a_path_are_of_the_corners_in_their_order_from_the_first_picture_on(tmp_path, is_crossed):
    corners = recorded(tmp_path)
    if is_crossed:
        with np.load(tmp_path / "arm/a.npz") as archive:
            data = dict(archive)
        np.savez(tmp_path / "arm/a.npz", **data | {"tcp_to_corner_m": data["tcp_to_corner_m"][::-1]})
    take = import_swung_cloth(tmp_path / "a.npz", hanger=tmp_path / "arm")
    sights = take.held_valid.all(1)
    assert take.time[sights] == pytest.approx(np.arange(-0.6, 4.2, 0.05) + 0.34)
    np.testing.assert_allclose(take.held[sights][:, :, [0, 2]], np.tile(corners[:, [0, 2]], (96, 1, 1)), atol=1e-9)
    assert (take.held_sd[sights] == 0.002).all()
    assert "clock" not in take.notes
