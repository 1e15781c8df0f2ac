"""A comparison of takes holds one take at a time, and its numbers are those of each take alone."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import pytest

from fit.errors import FitError
from fit.report import compare as comparing
from fit.report.compare import compare
from formats.archive import read_take, write_take
from formats.summary import summarise
from tests.formats.test_archive import a_take


@pytest.fixture
def paths(tmp_path):
    found = [tmp_path / f"{name}.mcap" for name in "abc"]
    for number, path in enumerate(found):
        write_take(path, replace(a_take(30 + number), take_id=path.stem))
    return found


def test_a_take_is_dropped_before_the_next_is_read(paths, monkeypatch):
    before, alive = [], []

    def read(path):
        gc.collect()
        alive.append(sum(one() is not None for one in before))
        take = read_take(path)
        before.append(weakref.ref(take))
        return take

    monkeypatch.setattr(comparing, "read_take", read)
    found = compare(paths)
    assert alive == [0, 0, 0]
    assert found.records == tuple({"file": str(path)} | summarise(read_take(path)) for path in paths)
    assert {row[0]: row[1:] for row in found.rows}["length"] == tuple(
        f"{one['duration_s']:g} s, {one['frames']} frames, {one['rate_hz']:g} a second" for one in found.records
    )


def test_a_doubt_names_the_file_where_two_takes_have_one_id(paths):
    for path in paths[:2]:
        write_take(path, replace(a_take(30), take_id="same", notes={"clock": "its clocks differ"}), overwrite=True)
    remarks = compare(paths[:2]).remarks
    assert [("a.mcap" in one, "b.mcap" in one) for one in remarks] == [(True, False), (False, True)]


def test_things_of_two_kinds_are_refused_by_name(paths, tmp_path):
    from formats.results import save_fit_result
    from tests.fit.report.report_scene import fit_result

    save_fit_result(tmp_path / "fit.json", fit_result())
    with pytest.raises(FitError, match=r"fit\.json: is a fit, and .*a\.mcap is a take; compare things of one kind"):
        compare([paths[0], tmp_path / "fit.json"])
