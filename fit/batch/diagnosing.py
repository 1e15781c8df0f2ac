"""Job of a batch worker that diagnoses the takes of one garment."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from fit.batch.cluster import STAGES
from fit.batch.jobs import DiagnosisJob, Outcome, diagnosis_name, report_name, unfinished_diagnosis
from fit.batch.kept import has_diagnosis, keep
from fit.batch.store import Store, open_store
from fit.batch.worker import Errand, run_errand
from fit.errors import FitError

# s between messages on the progress of a diagnosis. Our choice: half and double change only how old a shown share is.
HEARS_EVERY = 5.0


def run_diagnosis(job: DiagnosisJob) -> Outcome:
    """Diagnose takes of one garment; store the diagnosis and its report.

    The report is written first, so that every stored diagnosis has its report.

    Raises:
        BatchError, UnreachableError: as `fit.batch.worker.run_job`.
    """
    results = open_store(job.results_url)
    checkpoint = results.path(unfinished_diagnosis(job.key))

    def tidy() -> None:
        if checkpoint is not None:
            shutil.rmtree(checkpoint, ignore_errors=True)

    errand = Errand(
        result=diagnosis_name(job.key),
        is_kept=lambda: has_diagnosis(results, job.key),
        digests=dict(zip((*job.training, *job.held_out), job.digests, strict=True)),
        done="diagnosed",
        make=lambda contents: _diagnose(job, contents, results, checkpoint),
        tidy=tidy,
    )
    return run_errand(job, errand, results)


def _diagnose(job: DiagnosisJob, contents: dict[str, bytes], results: Store, checkpoint: Path | None) -> bytes:
    """Return the diagnosis as the bytes of its file, after storing its report.

    In a shared folder the finished fits outlive their worker; with a bucket the diagnosis starts again.
    """
    from fit.api.calls import diagnose, report
    from formats.archive import take_of
    from formats.results import result_bytes

    training = [take_of(contents[name], name) for name in job.training]
    held_out = [take_of(contents[name], name) for name in job.held_out]
    hear = heard(job.key)
    try:
        found = diagnose(
            training, held_out=held_out, seed=job.seed, anyway=job.anyway, checkpoint=checkpoint, progress=hear
        )
    except FitError as error:
        if checkpoint is None or error.where is None or not Path(str(error.where)).is_relative_to(checkpoint):
            raise
        shutil.rmtree(checkpoint, ignore_errors=True)  # unusable saved fits cost time, not the diagnosis
        found = diagnose(
            training, held_out=held_out, seed=job.seed, anyway=job.anyway, checkpoint=checkpoint, progress=hear
        )
    with tempfile.TemporaryDirectory(prefix="hangtime-") as folder:
        page = report(found, Path(folder) / "report.html").read_bytes()
    keep(results, report_name(job.key), page)
    return result_bytes(found.result, Path(diagnosis_name(job.key)))


def heard(key: str) -> Callable[[str, float], None]:
    """Return a progress that the batch hears of every few seconds; outside of a worker nobody does."""
    from distributed import get_worker

    last = -HEARS_EVERY

    def hear(stage: str, share: float) -> None:
        nonlocal last
        if (now := time.monotonic()) - last < HEARS_EVERY:
            return
        last = now
        try:
            worker = get_worker()
        except ValueError:
            return
        worker.log_event(STAGES, [key, stage, share])

    return hear
