"""A result of a newer format is left as it is, and a copied result without its checksum is made again."""

from __future__ import annotations

import pytest

from fit.batch.cli import SOME_NOT_FITTED
from fit.batch.garments import Seen, Wardrobe, diagnoses_of
from fit.batch.jobs import diagnosis_key, diagnosis_name, report_name, result_name
from fit.batch.kept import CHECKSUM_SUFFIX, has_diagnosis, has_fit, keep
from fit.batch.morning import morning_of
from fit.batch.runner import survey
from fit.batch.summary import as_csv, rows_of, sentence_of
from fit.batch.worker import Errand, run_errand
from fit.identification.request import Plan
from fit.provenance import physics_version
from formats.errors import NewerFormatError
from formats.results import result_bytes
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result

PLAN = Plan(method="kinect-skirt", iterations=1)


def newer_fit(version=b"2"):
    return result_bytes(fit_result(), "fit").replace(b"hangtime-fit/1", b"hangtime-fit/" + version)


def newer_under(night, how):
    """Keep a fit of a newer format under the key of the take; return its name and content."""
    _, results = night
    (key,) = survey(*night, PLAN).keys.values()
    if how == "no checksum":
        results.write(result_name(key), newer_fit())
    else:
        keep(results, result_name(key), newer_fit())
    if how == "another checksum":
        results.write(result_name(key) + CHECKSUM_SUFFIX, b"sha512:00\n")
    return result_name(key), key


@pytest.mark.parametrize("how", ["its checksum", "no checksum", "another checksum"])
def test_a_fit_of_a_newer_format_is_left_counted_and_named(night, how):
    _, results = night
    name, key = newer_under(night, how)
    found = survey(*night, PLAN)
    assert (found.jobs, found.outcomes[key].state) == ([], "newer")
    (row,) = rows_of(found, results)
    assert row.sentence == (
        "its result has the format hangtime-fit/2, and this version of Hangtime reads hangtime-fit/1, and stays as "
        f"it is: {results.url}/{name}; run the batch of the version that wrote it, or move the file away"
    )
    assert sentence_of([row]) == "1 take: 1 of a newer version."
    assert "hangtime-fit/2" in as_csv([row])
    needs = morning_of([row], [], found, results).needs
    assert needs == (("a.mcap", row.sentence),)


def test_the_batch_ends_with_3_beside_a_newer_fit_and_keeps_its_bytes(night, tmp_path):
    _, results = night
    name, _ = newer_under(night, "its checksum")
    done = hangtime_here("batch", "takes", "--out", "out", "--method", "kinect-skirt", "--iterations", 1,
                         "--workers", 1, "--dashboard-port", 0, folder=tmp_path)  # fmt: skip
    assert done.returncode == SOME_NOT_FITTED == 3
    assert "1 take: 1 of a newer version." in done.stdout
    assert results.read(name) == newer_fit()


def test_a_worker_leaves_a_fit_that_a_newer_batch_wrote_meanwhile(night):
    _, results = night
    (job,) = survey(*night, PLAN).jobs
    name, _ = newer_under(night, "its checksum")
    errand = Errand(
        result=name, is_kept=lambda: has_fit(results, job.key), digests={job.take: job.digest}, done="fitted",
        make=lambda contents: pytest.fail("it was made again"), tidy=lambda: None,
    )  # fmt: skip
    assert run_errand(job, errand, results).state == "newer"


@pytest.mark.parametrize("version", [b"0", b"1b", "²".encode(), b""])
def test_a_format_that_is_not_newer_is_made_again(night, version):
    _, results = night
    (key,) = survey(*night, PLAN).keys.values()
    keep(results, result_name(key), newer_fit(version))
    assert not has_fit(results, key)


def test_a_diagnosis_of_a_newer_format_is_left_also_without_a_report(night):
    takes, results = night
    seen = Seen(name="a.mcap", digest="d", kind="twist", reach=0.1, seconds=1.0, is_calibrated=True)
    one = Wardrobe(name="skirt", takes=(seen,), training=(seen,), held_out=(seen,))
    key = diagnosis_key(["d"], ["d"], 0, physics_version())
    newer = result_bytes(diagnosis(), "d").replace(b"hangtime-diagnosis/1", b"hangtime-diagnosis/12")
    assert b"hangtime-diagnosis/12" in newer
    keep(results, diagnosis_name(key), newer)
    assert not results.has(report_name(key))
    with pytest.raises(NewerFormatError):
        has_diagnosis(results, key)
    found = diagnoses_of([one], takes, results, 0)
    assert (found.jobs, found.outcomes[key].state) == ([], "newer")
    ((who, what),) = morning_of([], [one], found, results).needs
    assert who == "skirt"
    assert "hangtime-diagnosis/12" in what


def test_a_fit_that_was_copied_without_its_checksum_is_made_again(night):
    """Its bytes are sound, and nothing in them says which key they belong to."""
    _, results = night
    (key,) = survey(*night, PLAN).keys.values()
    results.write(result_name(key), result_bytes(fit_result(), "fit"))
    assert not has_fit(results, key)
    assert [job.key for job in survey(*night, PLAN).jobs] == [key]
