"""The measurement of hostile files counts those beyond their honest share, and no others."""

from __future__ import annotations

import time

import pytest

from formats.importers.marker_files import read_marker_tracks
from tests.fuzz import hostile


@pytest.mark.parametrize(("most", "dear"), [(hostile.MOST_SECONDS, 0), (-9.0, 1)])
def test_a_hostile_file_counts_as_dear_only_beyond_its_share(monkeypatch, capsys, most, dear):
    monkeypatch.setattr(hostile, "MOST_SECONDS", most)
    assert hostile.measure("oni: records of kind 7 without") == dear
    line = capsys.readouterr().out
    assert line.startswith("DEAR ") is bool(dear)
    assert "of 7.8 MB" in line


def test_every_reader_has_hostile_files_of_different_names():
    names = [one.name for one in hostile.inputs()]
    assert len(names) == len(set(names))
    assert {one.reader for one in hostile.inputs()} == {"markers", "garment", "rig", "result", "oni", "take"}


QUOTED = lambda value, frame, column: f'"{value:,.3f}"'  # noqa: E731
GAPS = lambda value, frame, column: "-1.#IND00" if column == frame % 120 else f"{value:.3f}"  # noqa: E731


def seconds_of(path):
    """The least processor time of three readings [s], which other programs hardly change."""

    def once():
        start = time.process_time()
        read_marker_tracks(path)
        return time.process_time() - start

    return min(once() for _ in range(3))


@pytest.mark.slow  # the ratio, 1.4 and 2.0 on one machine, depends on the processor
@pytest.mark.parametrize(("cell", "most"), [(GAPS, 2.2), (QUOTED, 2.5)], ids=["a word for a gap", "thousands, quoted"])
def test_a_number_of_another_format_in_each_line_costs_little(monkeypatch, tmp_path, cell, most):
    monkeypatch.setattr(hostile, "SIZE", 1_600_000)
    plain, odd = tmp_path / "plain.csv", tmp_path / "odd.csv"
    plain.write_bytes(hostile.table("vicon"))
    odd.write_bytes(hostile.table("vicon", cell))
    share = odd.stat().st_size / plain.stat().st_size
    assert seconds_of(odd) / share < most * seconds_of(plain)
