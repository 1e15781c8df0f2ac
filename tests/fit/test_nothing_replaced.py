"""Pictures, pages and tables are replaced only where somebody says so; results that are not there yet are named."""

from __future__ import annotations

import pytest

import hangtime
from formats.archive import write_take
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.test_command_line import a_swung_take

THERE = r"is already there; .* or overwrite=True to replace it"


@pytest.mark.parametrize(("command", "option"), [("fit", "--plot"), ("diagnose", "--plot"), ("diagnose", "--arrows")])
def test_a_picture_is_replaced_only_where_overwrite_is_given(tmp_path, command, option):
    """It is refused before the work, and nothing is left of the work."""
    pytest.importorskip("PIL")
    write_take(tmp_path / "a.mcap", a_swung_take(seconds=2.0))
    (tmp_path / "mine.png").write_text("mine")
    done = hangtime_here(command, "a.mcap", "--out", "out", option, "mine.png", folder=tmp_path)
    assert done.returncode == 2
    assert "mine.png: is already there; give another name, or --overwrite to replace it" in done.stderr
    assert (tmp_path / "mine.png").read_text() == "mine"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["fit.csv", "fit.json"])
def test_a_result_replaces_a_file_only_where_overwrite_is_given(tmp_path, name):
    """The same numbers may be written again: a notebook's cell runs twice."""
    fit, file = hangtime.FitOutcome(result=a_fit()), tmp_path / name
    write = fit.to_csv if name == "fit.csv" else fit.save
    file.write_text("mine")
    with pytest.raises(hangtime.HangtimeError, match=THERE):
        write(file)
    assert file.read_text() == "mine"
    write(file, overwrite=True)
    write(file)
    assert len(file.read_text()) > 100


@pytest.mark.parametrize("name", ["r.html", "r.motion.npz"])
def test_a_report_replaces_a_page_and_its_motion_only_where_overwrite_is_given(tmp_path, monkeypatch, name):
    fit = hangtime.FitOutcome(result=a_fit(), request=object(), prepared=object())
    monkeypatch.setattr("fit.report.gather.write_fit_report", lambda path, *_: path)
    (tmp_path / name).write_text("mine")
    with pytest.raises(hangtime.HangtimeError, match=THERE):
        hangtime.report(fit, tmp_path / "r.html")
    assert hangtime.report(fit, tmp_path / "r.html", overwrite=True) == tmp_path / "r.html"


def test_a_loaded_result_names_the_command_that_draws_its_report_at_once(tmp_path):
    loaded = hangtime.load(hangtime.FitOutcome(result=a_fit()).save(tmp_path / "fit.json"))
    with pytest.raises(hangtime.HangtimeError, match="`hangtime report DIR` writes the report"):
        hangtime.report(loaded, tmp_path / "report.html")


@pytest.mark.parametrize("words", [("fabric",), ("report",), ("export", "--to", "csv"), ("compare", "out")])
def test_a_folder_of_an_interrupted_fit_is_said_to_hold_one(tmp_path, words):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/fit.partial.json").write_text("{}")
    done = hangtime_here(words[0], "out", *words[1:], folder=tmp_path)
    assert done.returncode == 2
    assert "out: holds an unfinished fit, fit.partial.json; run the same `hangtime fit` again" in done.stderr
    assert "check the path" not in done.stderr


def test_an_interrupted_diagnosis_is_said_to_be_unfinished(tmp_path):
    (tmp_path / "out/diagnosis.partial").mkdir(parents=True)
    done = hangtime_here("report", "out", folder=tmp_path)
    assert "out: holds an unfinished diagnosis, diagnosis.partial; run the same `hangtime diagnose`" in done.stderr
