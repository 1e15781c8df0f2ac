"""Lines of marker files are cut into the right cells, whatever stands above the header and in quotation marks."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_lines import Rows
from tests.formats.test_marker_tables import MOTIVE, OWN, QTM, TRC, VICON, read

KINDS = {"own.csv": (OWN + "0.5,1,2,3,4,5,6\n0.6,,,,7,8,9\n", "m"), "a.trc": (TRC, None), "a.tsv": (QTM, None),
         "vicon.csv": (VICON, None), "motive.csv": (MOTIVE, None)}  # fmt: skip


@pytest.mark.parametrize("spread", ["", ";"], ids=["as exported", "with semicolons"])
@pytest.mark.parametrize("name", KINDS)
def test_cells_in_quotation_marks_are_the_cells_within_them(tmp_path, name, spread):
    """A spreadsheet saves the words so, or every cell, those of the header included."""
    text, unit = KINDS[name]
    separator = "\t" if "\t" in text else ","
    alone = read(tmp_path, text, unit, name)
    for wanted in (r"[A-Za-z_#]+", r".*"):
        lines = [
            [f'"{c}"' if re.fullmatch(wanted, c) else c for c in line.split(separator)] for line in text.split("\n")
        ]
        quoted = "\n".join((spread or separator).join(cells) for cells in lines).replace('\n""', "\n")
        found = read(tmp_path, quoted, unit, name)
        assert (found.labels, found.rate) == (alone.labels, alone.rate)
        assert np.array_equal(found.positions, alone.positions, equal_nan=True)


@pytest.mark.parametrize("name", KINDS)
def test_a_stray_quotation_mark_costs_its_own_cell_at_the_most(tmp_path, name):
    """Wherever it stands: one marker has another name or is not there, or a sentence refuses the file.

    The sentence names the line where the mark is in a frame.
    """
    text, unit = KINDS[name]
    alone = read(tmp_path, text, unit, name)
    frames = text.index({"own.csv": "0.5,", "a.trc": "1\t0.0", "a.tsv": "1\t2", "vicon.csv": "11,"}.get(name, "0,0.00"))
    for place in range(len(text)):
        marked = text[:place] + '"' + text[place:]
        line = text[:place].count("\n") + 1
        try:
            found = read(tmp_path, marked, unit, name)
        except TakeError as error:
            told = str(error)
            is_said = place < frames or f"line {line} holds" in told
        else:
            kept = [(k, alone.labels.index(label)) for k, label in enumerate(found.labels) if label in alone.labels]
            is_said = len(alone.labels) - 1 <= len(kept) and found.time.tolist() == alone.time.tolist()
            for one, other in kept:
                here, there = found.positions[:, one], alone.positions[:, other]
                is_said &= np.array_equal(here, there, equal_nan=True)
        assert is_said, marked


@pytest.mark.parametrize("above", ["made; by hand", "a\tb", "# a;b\tc", '"x;y"', 'Devices;1"'])
@pytest.mark.parametrize("name", KINDS)
def test_cells_are_parted_as_the_header_says_whatever_parts_the_words_above_it(tmp_path, name, above):
    """Names of markers and takes may hold separators too, where others part the cells."""
    text, unit = KINDS[name]
    text = text.replace("who:one", "who:one;a").replace("Format Version,1.23", "Format Version,1.23,Take,a;b\tc")
    alone = read(tmp_path, KINDS[name][0], unit, name)
    found = read(tmp_path, f"{above}\n{text}", unit, name)
    assert [label.removesuffix(";a") for label in found.labels] == list(alone.labels)
    assert np.array_equal(found.positions, alone.positions, equal_nan=True)


def test_the_last_of_some_rows_is_cut_where_the_last_of_all_is(tmp_path):
    rows = Rows(["a,b", "c,d", "e"], [2, 4, 5], ",", tmp_path, is_cut=True)
    assert [len(rows), rows[1], list(rows[1:])] == [3, ["c", "d"], [["c", "d"], ["e"]]]
    assert rows[1:].is_cut
    assert list(rows[1:].numbers) == [4, 5]
    assert rows[:3].is_cut
    assert not rows[:2].is_cut
    assert not Rows(["a", "b"], [1, 2], ",", tmp_path)[:].is_cut
    wide = Rows(["," * 100_001], [1], ",", tmp_path)
    with pytest.raises(TakeError, match="has a line of more than 100000 cells"):
        wide[0]
    assert len(Rows(["," * 100_000], [1], ",", tmp_path)[0]) == 100_001


@pytest.mark.parametrize("decimal", [None, "."])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_minus_sign_is_a_hyphen_in_frames_and_stays_in_names(tmp_path, decimal, encoding):
    """Programs in Swedish, Norwegian or Finnish write it."""
    text = OWN.replace("time_s,a_", "time_s,\u2212a_").replace(",a_", ",\u2212a_")
    text += "".join(f"{k / 10},\u2212{k + 1}.5,2,\u22123,4,5,\u2212{k + 6}.25\n" for k in range(4))
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    found = read_marker_tracks(tmp_path / "a.csv", decimal="point" if decimal else "")
    assert found.labels[0] == "\u2212a"
    assert found.positions[:, 0, 0].tolist() == [-1.5, -2.5, -3.5, -4.5]
    assert found.positions[3, 1].tolist() == [4, 5, -9.25]
