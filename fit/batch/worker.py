"""Run one job of a batch: read its takes, fit or diagnose them, and store the result or the reason of a failure."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from fit import runtime
from fit.batch.cluster import SCHEDULER_RETRY, WAITS
from fit.batch.jobs import Job, Outcome, Task, digest_of, failure_name, result_name, search_name
from fit.batch.kept import has_fit, keep, left_alone
from fit.batch.store import Store, open_store, store_is_full
from fit.errors import BatchError, FitError, UnreachableError
from fit.kernel_cache.place import at_work
from fit.provenance import physics_version
from formats.errors import HangtimeError, ImplausibleError, NewerFormatError
from formats.system_causes import FULL

# s between messages of a waiting worker to the batch. Our choice: half and double change only how late a wait is
# shown.
HEARS_WITHIN = 5.0


@dataclass(frozen=True, kw_only=True)
class Errand:
    """The definition of one kind of job.

    - `result`: name of the file with the job's result
    - `is_kept`: whether this file exists with a correct checksum
    - `digests`: sha256 of each take by its name
    - `done`: state of the outcome after success
    - `make`: contents of the takes by name -> the bytes of the result
    - `tidy`: removes a stored unfinished state
    """

    result: str
    is_kept: Callable[[], bool]
    digests: dict[str, str]
    done: str
    make: Callable[[dict[str, bytes]], bytes]
    tidy: Callable[[], None]


def run_job(job: Job) -> Outcome:
    """Fit one take and store its result.

    A job may run twice, if the worker that had finished it was lost; the second run finds the stored result.

    Raises:
        BatchError: takes or results cannot be read or written; that is no fault of the take.
        UnreachableError: a bucket cannot be reached now; a finished fit waits for it as long as the job's patience.
    """
    results = open_store(job.results_url)
    errand = Errand(
        result=result_name(job.key), is_kept=lambda: has_fit(results, job.key),
        digests={job.take: job.digest}, done="fitted",
        make=lambda contents: _fit(job, contents[job.take], results),
        tidy=lambda: results.remove(search_name(job.key)),
    )  # fmt: skip
    return run_errand(job, errand, results)


def run_errand(job: Task, errand: Errand, results: Store) -> Outcome:
    """Run a job unless its result exists; store the result, or the reason why these takes give none.

    Raises:
        BatchError, UnreachableError: as `run_job`.
    """
    # One job, one core: jobs scale over takes. Must be set before Taichi starts.
    os.environ.setdefault("HANGTIME_THREADS", "1")
    with at_work():
        return _run(job, errand, results)


def _run(job: Task, errand: Errand, results: Store) -> Outcome:
    started = time.monotonic()

    def ended(state: str, sentence: str = "") -> Outcome:
        return Outcome(key=job.key, state=state, sentence=sentence, seconds=time.monotonic() - started)

    if physics_version() != job.physics:
        return ended(
            "refused",
            "the worker has another Hangtime or other libraries than the batch; install the same versions on both",
        )
    takes = open_store(job.takes_url)
    try:
        if errand.is_kept():
            return ended(errand.done)
    except NewerFormatError as error:  # another batch wrote it meanwhile
        return ended("newer", left_alone(error))
    try:
        runtime.start()  # before any fault of a take
    except (FitError, OSError, ImportError) as error:
        return ended("refused", f"this worker cannot do it ({error})")
    contents = {name: takes.read(name) for name in errand.digests}
    if any(digest_of(contents[name]) != digest for name, digest in errand.digests.items()):
        return ended("refused", "the take was changed while the batch ran; run the batch again")
    try:
        result = errand.make(contents)
    except BatchError:
        raise
    except ImplausibleError as error:  # not stored, because --anyway accepts the take
        return ended("refused", words_of(error))
    except MemoryError:
        return ended("refused", "not enough memory; use fewer workers")
    except (OSError, ImportError) as error:
        if isinstance(error, OSError) and error.errno in FULL:
            raise store_is_full(error, error.filename or results.url) from error
        return ended("refused", f"this worker cannot do it ({_cause_of(error)})")
    except Exception as error:  # no fault of a take may end a batch
        sentence = words_of(error)
        record = {"format": "hangtime-batch-failure/1", "take": ", ".join(errand.digests), "sentence": sentence,
                  "created": datetime.now(UTC).isoformat(timespec="seconds")}  # fmt: skip
        results.write(failure_name(job.key), json.dumps(record, indent=2).encode())
        return ended("failed", sentence)
    write_patiently(results, errand.result, result, job.patience)
    errand.tidy()
    results.remove(failure_name(job.key))
    return ended(errand.done)


def _cause_of(error: OSError | ImportError) -> str:
    """Return the system's reason and the file, without the system's number of the error."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {error.filename}" if error.filename else error.strerror
    return str(error)


def write_patiently(results: Store, name: str, content: bytes, patience: float) -> None:
    """Write a costly result, with retries while a bucket is unreachable or a disk is full.

    The batch receives a message at once (`WAITS`), long before the patience [s] ends.
    """
    from distributed import get_worker

    deadline = None
    while True:
        try:
            return keep(results, name, content)
        except UnreachableError as error:
            # The batch learns of the first failure a moment later, when its own patience must have ended too.
            deadline = deadline or time.monotonic() + patience + (HEARS_WITHIN if patience else 0.0)
            if time.monotonic() >= deadline:
                raise
            with contextlib.suppress(ValueError):  # no worker of dask runs this
                get_worker().log_event(WAITS, str(error))
        time.sleep(SCHEDULER_RETRY)


def _fit(job: Job, content: bytes, results: Store) -> bytes:
    """Return the fit result as the bytes of its file.

    Before the end only the unfinished search is written, because files of a killed worker would remain in its folder.
    """
    from fit.identification.calibrate import calibrate
    from formats.archive import take_of
    from formats.plausible import check_plausible_take
    from formats.results import result_bytes

    take = take_of(content, job.take)
    if not job.anyway:
        check_plausible_take(take, job.take, offers_anyway=True)
    # In a shared folder an unfinished search outlives its worker; with a bucket the fit starts again.
    checkpoint = results.path(search_name(job.key))
    if checkpoint is not None:
        checkpoint.parent.mkdir(parents=True, exist_ok=True)
    try:
        result = calibrate([take], [], job.plan.request(), checkpoint=checkpoint)
    except FitError as error:
        if checkpoint is None or error.where != checkpoint:
            raise
        checkpoint.unlink(missing_ok=True)  # an unusable saved search costs time, not the take
        result = calibrate([take], [], job.plan.request(), checkpoint=checkpoint)
    return result_bytes(result, Path(result_name(job.key)))


def words_of(error: Exception) -> str:
    """Return an error of a take as text, without the take's name."""
    if isinstance(error, HangtimeError):
        return error.words
    return f"{type(error).__name__}: {error}; please report this fault of Hangtime with this take"
