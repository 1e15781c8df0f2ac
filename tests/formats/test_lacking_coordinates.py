"""A position that lacks one or two of its coordinates counts as not seen, and the import warns with its frame."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_marker_tables import OWN
from tests.formats.test_other_programs_files import LABELS, WRITERS, drawn

AT = 12
ONE = "{}: {} lacks a coordinate at {} s, so it counts as not seen there"
WHERE = {
    "trc": ("line 19", "0.12"), "vicon.csv": ("line 24", "0.83"), "motive.csv": ("line 20", "0.12"),
    "qualisys.tsv": ("line 20", "0.12"), "ours.csv": ("line 14", "0.12"),
}  # fmt: skip


def lacking(*where):
    """Positions of which some coordinates are missing."""
    places = drawn()
    for frame, marker, axes in where:
        places[frame, marker, axes] = np.nan
    return places


def written(tmp_path, name, places):
    (tmp_path / f"a.{name}").write_text(WRITERS[name](places))
    return read_marker_tracks(tmp_path / f"a.{name}")


@pytest.mark.parametrize("axes", [[2], [0], [0, 1]])
@pytest.mark.parametrize("name", WRITERS)
def test_a_lost_coordinate_is_reported_with_its_line_marker_and_time(tmp_path, name, axes):
    found = written(tmp_path, name, lacking((AT, 0, axes)))
    line, time = WHERE[name]
    assert found.warning == ONE.format(line, found.labels[0], time)
    assert np.isnan(found.positions[AT, 0]).all()


@pytest.mark.parametrize("name", WRITERS)
def test_many_are_counted_and_whole_gaps_are_none_of_them(tmp_path, name):
    found = written(tmp_path, name, lacking((AT, 1, [2]), (AT + 1, 0, [1, 2]), (AT + 1, 2, [0]), (3, 2, [0, 1, 2])))
    line, time = WHERE[name]
    told = f"3 positions lack a coordinate and count as not seen: {found.labels[1]} in {line} at {time} s, "
    assert found.warning.startswith(told + found.labels[0])


def test_zeros_without_a_coordinate_are_a_gap_and_a_cut_is_reported_once(tmp_path):
    body = "".join(f"{k / 10},1.{k},2,3,4,5,6\n" for k in range(30))
    cut = "line 32 may be cut off within its last number, so its last marker counts as not seen there"
    whole = ONE.format("line 32", "a", "3.00")
    for last, told in (("0,0,,4,5,6", ""), ("1,2,,4,5,6", whole), ("1,2,3,4,5,", cut), ("1,2,3,4,5,-", cut)):
        (tmp_path / "a.csv").write_text(f"{OWN}{body}3.0,{last}\n")
        assert read_marker_tracks(tmp_path / "a.csv").warning == told


def test_a_number_of_c3d_that_is_none_is_reported_with_its_frame(tmp_path):
    places = np.nan_to_num(drawn(), nan=0.5)
    raw = bytearray(c3d_bytes(1e3 * places, LABELS))
    at = raw.index(struct.pack("<f", 1e3 * places[4, 1, 2]))
    raw[at : at + 4] = struct.pack("<f", np.nan)
    (tmp_path / "a.c3d").write_bytes(raw)
    assert read_marker_tracks(tmp_path / "a.c3d").warning == ONE.format("frame 5", "b", "0.04")


def test_a_file_of_two_coordinates_alone_says_why_no_marker_was_seen(tmp_path):
    (tmp_path / "a.csv").write_text(OWN + "".join(f"{k / 10},1.{k},2,NaN,4,5,NaN\n" for k in range(30)))
    words = (
        "no marker was ever seen: 60 positions lack a coordinate and count as not seen: a in line 2 at 0.00 s, "
        "b in line 2 at 0.00 s, a in line 3 at 0.10 s and 57 more; export all"
    )
    with pytest.raises(TakeError, match=words):
        read_marker_tracks(tmp_path / "a.csv")
