"""Headers of Qualisys' tables as people and other programs leave them."""

from __future__ import annotations

import pytest

from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks

HEAD = "NO_OF_FRAMES\t3\nNO_OF_MARKERS\t2\nFREQUENCY\t50\n{data}MARKER_NAMES\ta\tb\n"
FRAMES = "".join("\t".join(f"{100 * axis + k:.3f}" for axis in range(1, 7)) + "\n" for k in range(3))


def read(tmp_path, text):
    (tmp_path / "a.tsv").write_text(text)
    return read_marker_tracks(tmp_path / "a.tsv")


@pytest.mark.parametrize("data", ["", "DATA_INCLUDED\t3D\n", "DATA_INCLUDED\t 3d \n", "DATA_INCLUDED\t6D\n"])
def test_a_table_that_names_markers_is_read_whatever_its_data_are_called(tmp_path, data):
    tracks = read(tmp_path, HEAD.format(data=data) + FRAMES)
    assert (tracks.labels, len(tracks.time), tracks.warning) == (("a", "b"), 3, "")


@pytest.mark.parametrize("data", ["DATA_INCLUDED\t3D\n", "DATA_INCLUDED\t3d\n", ""])
def test_a_table_of_3d_data_without_names_is_refused_for_its_names(tmp_path, data):
    text = HEAD.format(data=data).replace("MARKER_NAMES\ta\tb\n", "") + FRAMES
    with pytest.raises(TakeError, match="names 0 markers and states 2"):
        read(tmp_path, text)


def test_spaces_around_words_and_empty_cells_behind_the_names_do_not_count(tmp_path):
    text = HEAD.format(data="").replace("NO_OF_MARKERS", "NO_OF_MARKERS ").replace("a\tb\n", "a\tb\t\t\n") + FRAMES
    assert read(tmp_path, text).labels == ("a", "b")


def test_a_long_kind_of_data_is_cut_in_the_error(tmp_path):
    text = HEAD.format(data=f"DATA_INCLUDED\t{'x' * 60}\n").replace("MARKER_NAMES\ta\tb\n", "") + FRAMES
    with pytest.raises(TakeError, match=f"its DATA_INCLUDED is '{'X' * 40}', and it names no markers"):
        read(tmp_path, text)


def test_empty_frames_behind_the_stated_ones_are_left_out(tmp_path):
    assert len(read(tmp_path, HEAD.format(data="") + FRAMES + "\t" * 5 + "\n" + "\t" * 5 + "\n").time) == 3
