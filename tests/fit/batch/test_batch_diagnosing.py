"""The job that diagnoses a garment: what it is made of, what it stores, and saved fits that do not go on."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from fit.api import calls
from fit.batch.diagnosing import run_diagnosis
from fit.batch.jobs import DiagnosisJob, diagnosis_name, digest_of, failure_name, report_name, unfinished_diagnosis
from fit.batch.kept import CHECKSUM_SUFFIX, has_diagnosis
from fit.batch.store import open_store
from fit.errors import FitError
from fit.provenance import physics_version
from formats.archive import write_take
from formats.results import load_diagnosis
from tests.fit.batch.test_night_of_diagnoses import a_take
from tests.fit.report.report_scene import diagnosis


@pytest.fixture
def job(tmp_path):
    """A diagnosis of two takes, judged on a third one."""
    names = ("a.mcap", "b.mcap", "c.mcap")
    for name in names:
        write_take(tmp_path / name, a_take(name[0]))
    digests = tuple(digest_of((tmp_path / name).read_bytes()) for name in names)
    return DiagnosisJob(
        key="k", takes_url=str(tmp_path), results_url=str(tmp_path / "out"), physics=physics_version(), anyway=True,
        training=names[:2], held_out=names[2:], digests=digests, seed=7,
    )  # fmt: skip


def answering(monkeypatch, *errors):
    """Put a diagnosis that is known, or these errors before it, in place of one that takes minutes."""
    asked, left = [], list(errors)

    def diagnose(training, **options):
        asked.append(([take.take_id for take in training], [take.take_id for take in options.pop("held_out")], options))
        options["checkpoint"].mkdir(parents=True, exist_ok=True)
        (options["checkpoint"] / f"fit-{len(asked)}").touch()
        if left:
            raise left.pop(0)
        return SimpleNamespace(result=diagnosis())

    def report(found, path):
        assert found.result == diagnosis()
        path.write_text("<html>its report</html>")
        return path

    monkeypatch.setattr(calls, "diagnose", diagnose)
    monkeypatch.setattr(calls, "report", report)
    return asked


def test_a_diagnosis_is_stored_with_its_report_and_its_saved_fits_go(monkeypatch, job, tmp_path):
    asked, out = answering(monkeypatch), tmp_path / "out"
    assert run_diagnosis(job).state == "diagnosed"
    ((training, held_out, options),) = asked
    assert (training, held_out) == (["a", "b"], ["c"])
    assert (options["seed"], options["anyway"]) == (7, True)
    assert options["checkpoint"] == out / unfinished_diagnosis("k")
    assert callable(options["progress"])
    assert load_diagnosis(out / diagnosis_name("k")) == diagnosis()
    assert (out / report_name("k")).read_text() == "<html>its report</html>"
    assert (out / (report_name("k") + CHECKSUM_SUFFIX)).exists()
    assert has_diagnosis(open_store(str(out)), "k")
    assert not options["checkpoint"].exists()
    assert run_diagnosis(job).state == "diagnosed"
    assert len(asked) == 1


def test_saved_fits_that_do_not_go_on_are_thrown_away_once(monkeypatch, job, tmp_path):
    saved = tmp_path / "out" / unfinished_diagnosis("k")
    asked = answering(monkeypatch, FitError("is of another diagnosis", where=saved / "base.json", advice="begin anew"))
    (saved / "old").mkdir(parents=True)
    assert run_diagnosis(job).state == "diagnosed"
    assert [options for _, _, options in asked] == 2 * [asked[0][2]]
    assert asked[0][:2] == asked[1][:2]
    assert not (tmp_path / "out" / failure_name("k")).exists()


@pytest.mark.parametrize("where", ["a", Path("/elsewhere/base.json")])
def test_an_error_of_the_takes_is_the_outcome_and_leaves_the_saved_fits(monkeypatch, job, tmp_path, where):
    asked = answering(monkeypatch, FitError("the garment is too small", where=where, advice="record another"))
    assert run_diagnosis(job).state == "failed"
    assert len(asked) == 1
    assert (tmp_path / "out" / unfinished_diagnosis("k") / "fit-1").exists()
