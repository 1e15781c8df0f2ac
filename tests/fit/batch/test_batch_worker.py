"""How a worker ends a job, what it stores then, and what the jobs of a night hold."""

from __future__ import annotations

import dataclasses
import errno
import json
import math
import os

import msgspec
import pytest

from fit.batch import worker
from fit.batch.garments import Seen, diagnoses_of, wardrobe_of, wardrobes
from fit.batch.jobs import Task, digest_of, failure_name, key_of
from fit.batch.runner import Survey, survey
from fit.batch.store import open_store
from fit.batch.summary import Row
from fit.batch.worker import Errand, run_errand, run_job
from fit.errors import BatchError, FitError
from fit.identification.request import Plan
from fit.provenance import physics_version
from formats.archive import write_take
from formats.errors import ImplausibleError
from formats.motion import reach_of
from formats.rig import Sensor
from tests.fit.batch.test_night_of_diagnoses import a_take
from tests.fit.report.report_scene import fit_result

PLAN = Plan(method="kinect-skirt", iterations=1, spacing=0.1)


@pytest.fixture
def night(tmp_path):
    """A folder with one take, one for results, and the job to fit it."""
    (tmp_path / "takes").mkdir()
    write_take(tmp_path / "takes/a.mcap", a_take("a"))
    takes, results = open_store(str(tmp_path / "takes")), open_store(str(tmp_path / "out"))
    (job,) = survey(takes, results, PLAN).jobs
    return results, job


def ended(night, error=None, **changes):
    """The outcome of a job whose work ends with an error, or well, and whether its unfinished state was removed."""
    results, job = night
    tidied = []

    def make(contents):
        if error is not None:
            raise error
        return b"{}"

    values = {"result": "fits/k.json", "is_kept": lambda: False, "digests": {"a.mcap": job.digest}, "done": "fitted",
              "make": make, "tidy": lambda: tidied.append(True)}  # fmt: skip
    return run_errand(job, Errand(**{**values, **changes}), results), bool(tidied)


@pytest.mark.parametrize(
    ("error", "state", "words", "is_stored"),
    [
        (ImplausibleError("it is 400 m long", where="a", advice="were millimetres meant"), "refused", "400 m", False),
        (MemoryError(), "refused", "not enough memory; use fewer workers", False),
        (OSError(errno.EACCES, "Permission denied", "/x/y"), "refused",
         "this worker cannot do it (Permission denied: /x/y)", False),
        (OSError(errno.EACCES, "Permission denied"), "refused", "this worker cannot do it (Permission denied)", False),
        (ImportError("no module named x"), "refused", "this worker cannot do it (no module named x)", False),
        (FitError("is too small", where="a", advice="record another"), "failed", "is too small; record another", True),
        (KeyError("k"), "failed", "KeyError: 'k'; please report this fault of Hangtime with this take", True),
    ],
)  # fmt: skip
def test_only_what_would_fail_again_is_stored_as_a_failure(night, error, state, words, is_stored):
    outcome, is_tidied = ended(night, error)
    results, job = night
    assert (outcome.key, outcome.state, is_tidied) == (job.key, state, False)
    assert words in outcome.sentence
    assert results.has(failure_name(job.key)) == is_stored
    assert not results.has("fits/k.json")
    if is_stored:
        record = json.loads(results.read(failure_name(job.key)))
        assert (record["format"], record["take"]) == ("hangtime-batch-failure/1", "a.mcap")
        assert record["sentence"] == outcome.sentence
        assert record["created"].endswith("+00:00")


def test_a_fault_of_the_store_is_no_outcome_of_a_take(night):
    with pytest.raises(BatchError, match="cannot be written"):
        ended(night, BatchError("cannot be written", where="out", advice="give another folder"))


def test_a_result_takes_the_place_of_an_earlier_failure_and_of_what_was_unfinished(night, monkeypatch):
    results, job = night
    results.write(failure_name(job.key), b'{"sentence": "in vain"}')
    monkeypatch.delenv("HANGTIME_THREADS", raising=False)
    outcome, is_tidied = ended(night)
    assert (outcome.state, is_tidied, outcome.seconds > 0) == ("fitted", True, True)
    assert not results.has(failure_name(job.key))
    assert results.read("fits/k.json") == b"{}"
    assert os.environ["HANGTIME_THREADS"] == "1"
    monkeypatch.setenv("HANGTIME_THREADS", "3")
    assert ended(night, is_kept=lambda: True, done="diagnosed")[0].state == "diagnosed"
    assert os.environ["HANGTIME_THREADS"] == "3"


def test_an_implausible_take_is_fitted_only_where_it_is_accepted(night, tmp_path):
    """Its garment is 1000 times as large; no mesh of 0.1 m fits it, which is the outcome then."""
    take = a_take("a")
    garment = msgspec.structs.replace(take.garment, outline_m=[[1e3 * x for x in at] for at in take.garment.outline_m])
    write_take(tmp_path / "takes/a.mcap", dataclasses.replace(take, garment=garment), overwrite=True)
    results, job = night
    job = dataclasses.replace(job, digest=digest_of((tmp_path / "takes/a.mcap").read_bytes()))
    refused = run_job(job)
    assert refused.state == "refused"
    assert "were millimetres meant" in refused.sentence
    assert not results.has(failure_name(job.key))
    assert run_job(dataclasses.replace(job, anyway=True)).state == "failed"


def test_a_job_holds_where_takes_and_results_are_and_all_options(night, tmp_path):
    results, job = night
    assert (job.take, job.takes_url, job.results_url) == ("a.mcap", str(tmp_path / "takes"), str(tmp_path / "out"))
    assert job.digest == digest_of((tmp_path / "takes/a.mcap").read_bytes())
    assert (job.plan, job.physics, job.anyway, job.patience) == (PLAN, physics_version(), False, 0.0)
    assert job.key == key_of(job.digest, PLAN, job.physics)
    found = survey(open_store(job.takes_url), results, PLAN, anyway=True)
    assert found.jobs == [dataclasses.replace(job, anyway=True)]
    assert (found.keys, found.digests, found.work) == ({"a.mcap": job.key}, {"a.mcap": job.digest}, worker.run_job)
    assert Survey(jobs=[Task(key="k", takes_url="", results_url="", physics="")]).waiting


# --- garments -------------------------------------------------------------------------------------


def seen(name, kind, reach=0.03, **changes):
    known = {"digest": f"sha of {name}", "seconds": 8.0, "is_calibrated": True}
    return Seen(name=name, kind=kind, reach=reach, **{**known, **changes})


@pytest.mark.parametrize(
    ("reaches", "judged"),
    [
        ((0.02, 0.03, 0.05), 1),
        ((0.02, 0.03, 0.05, 0.08), 2),
        ((0.02, 0.0259, 0.05, 0.08), 2),
        ((0.02, 0.0261, 0.05), 1),
    ],
)
def test_strengths_differ_from_a_ratio_of_1_3_on_and_of_an_even_number_the_stronger_middle_one_is_judged_on(
    reaches, judged
):
    takes = [seen(str(k), "face-on", reach) for k, reach in enumerate(reaches)]
    for order in (takes, takes[::-1]):
        assert [take.name for take in wardrobe_of("skirt", order).held_out] == [str(judged)]


def test_of_two_kinds_at_three_strengths_the_more_informative_ones_middle_is_judged_on():
    takes = [seen(f"{kind}{k}", kind, reach) for kind in ("face-on", "twist", "mixed")
             for k, reach in enumerate((0.02, 0.03, 0.05))]  # fmt: skip
    for order in (takes, takes[::-1]):
        assert [take.name for take in wardrobe_of("skirt", order).held_out] == ["face-on1"]
    assert [take.name for take in wardrobe_of("skirt", takes[3:]).held_out] == ["mixed1"]


def test_damage_is_named_beside_what_is_missing_and_a_rig_that_was_never_calibrated_comes_first():
    damaged = seen("a", "face-on", damage="the take a has 1 damaged block")
    lack = wardrobe_of("skirt", [damaged, seen("b", "face-on")]).missing
    assert lack.endswith("; the take a has 1 damaged block")
    still = wardrobe_of("skirt", [dataclasses.replace(damaged, kind="still")]).missing
    assert still.startswith("in no take does its hanger move")
    assert still.endswith("; the take a has 1 damaged block")
    unknown = [dataclasses.replace(damaged, is_calibrated=False), seen("b", "still", is_calibrated=False)]
    assert wardrobe_of("skirt", unknown).missing.startswith("its rig was never calibrated")


def test_a_garments_takes_are_measured_from_their_files(tmp_path):
    take = a_take("a")
    bare = msgspec.structs.replace(
        take.rig, sensor=Sensor(width=640, height=480, fx=575.0, fy=575.0, cx=320.0, cy=240.0)
    )
    rows, found = [], Survey()
    for one in (take, dataclasses.replace(take, take_id="b", rig=bare)):
        write_take(tmp_path / f"{one.take_id}.mcap", one)
        found.digests[f"{one.take_id}.mcap"] = f"sha of {one.take_id}"
        rows.append(Row(take=f"{one.take_id}.mcap", key="k", state="known", sentence="", result=fit_result()))
    (garment,) = wardrobes(rows, found, open_store(str(tmp_path)))
    first, second = garment.takes
    assert (first.name, first.digest, first.kind) == ("a.mcap", "sha of a", "face-on")
    assert first.seconds == pytest.approx(take.time[-1] - take.time[0], abs=1e-6)
    assert first.reach == pytest.approx(math.hypot(*reach_of(take).values()), rel=1e-3)
    assert (first.is_calibrated, second.is_calibrated) == (True, False)


def test_a_diagnosis_job_holds_its_takes_in_order_and_all_options(tmp_path):
    takes, results = open_store("takes"), open_store(str(tmp_path))
    every = [wardrobe_of("skirt", [seen("a", "face-on"), seen("b", "sideways"), seen("c", "face-on")]),
             wardrobe_of("towel", [seen("t", "twist")])]  # fmt: skip
    found = diagnoses_of(every, takes, results, 7, anyway=True)
    (job,) = found.jobs
    assert (job.training, job.held_out) == (("a", "c"), ("b",))
    assert job.digests == ("sha of a", "sha of c", "sha of b")
    assert (job.seed, job.anyway, job.physics) == (7, True, physics_version())
    assert (job.takes_url, job.results_url, found.keys) == (takes.url, results.url, {"skirt": job.key})
    assert not diagnoses_of(every, takes, results, 7).jobs[0].anyway
