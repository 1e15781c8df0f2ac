"""The measurement of hostile files counts those beyond their honest share, and no others."""

from __future__ import annotations

import pytest

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
