"""Run a batch: find what is new, hand it out, collect what becomes of it, begin again when the scheduler was lost.

Nothing is kept in dask: a worker writes its own result, and the batch asks the store what is there. So a killed worker
costs the fit it was at, a lost scheduler a new connection, and the death of the batch itself another start of it.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from fit.batch.cluster import Workers, connect
from fit.batch.jobs import Job, Outcome, Plan, digest_of, failure_name, key_of, result_name
from fit.batch.store import Store
from fit.batch.worker import run_job
from fit.errors import BatchError
from fit.physics import physics_version

POLL = 0.25  # s
FRUITLESS = 10  # connections in a row without a single outcome, after which something else is wrong
GATHER = 60.0  # s for a finished job's word to arrive

Progress = Callable[[int, int, str], None]


@dataclass
class Survey:
    """Takes by name, each with its key, and what is known of each key."""

    keys: dict[str, str] = field(default_factory=dict)
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    jobs: list[Job] = field(default_factory=list)

    @property
    def waiting(self) -> list[Job]:
        """Jobs of which nothing is known yet."""
        return [job for job in self.jobs if job.key not in self.outcomes]


def survey(takes: Store, results: Store, plan: Plan, *, retry_failed: bool = False) -> Survey:
    """Read every take once and say what has to be done.

    Raises:
        BatchError: there is no take, or the results cannot be listed.
    """
    names = takes.names("", ".mcap")
    if not names:
        raise BatchError("holds no take (*.mcap)", where=takes.url, advice="check the address")
    fitted, failed = set(results.names("fits", ".json")), set(results.names("failed", ".json"))
    physics = physics_version()
    found = Survey()
    for name in names:
        try:
            digest = digest_of(takes.read(name))
        except BatchError as error:
            key = key_of(name, plan, physics)
            found.keys[name] = key
            found.outcomes[key] = Outcome(key=key, state="refused", sentence=str(error))
            continue
        key = key_of(digest, plan, physics)
        is_new = key not in found.keys.values()
        found.keys[name] = key
        if result_name(key) in fitted:
            found.outcomes[key] = Outcome(key=key, state="known")
        elif failure_name(key) in failed and not retry_failed:
            found.outcomes[key] = Outcome(key=key, state="failed", sentence=_kept_sentence(results, key))
        elif is_new:
            found.jobs.append(
                Job(key=key, take=name, digest=digest, takes_url=takes.url, results_url=results.url, plan=plan,
                    physics=physics)
            )  # fmt: skip
    return found


def run(
    found: Survey,
    workers: Workers,
    *,
    progress: Progress = lambda done, total, text: None,
    say: Callable[[str], None] = lambda line: None,
    deadline: float | None = None,
) -> None:
    """Fit what is waiting; outcomes are added to the survey as they come, so that an interrupted run shows them too.

    deadline: instant of time.monotonic() [s] after which no more results are waited for.

    Raises:
        BatchError: no scheduler answers for longer than patience lasts.
    """
    fruitless, connections = 0, 0
    while found.waiting and not _is_over(deadline):
        before = len(found.waiting)
        with connect(workers) as client:
            connections += 1
            say(f"Dashboard: {client.dashboard_link}" if connections == 1 else "Connected again.")
            is_lost = _round(client, found, progress, deadline)
        if is_lost:
            say(f"The scheduler was lost; {len(found.waiting)} takes are left. Waiting for it to come back.")
        fruitless = 0 if len(found.waiting) < before else fruitless + 1
        if fruitless == FRUITLESS:
            raise BatchError(
                f"{FRUITLESS} connections in a row brought no result",
                where=workers.scheduler or "this machine",
                advice="look at the logs of scheduler and workers; what is finished is kept",
            )


def _round(client: Any, found: Survey, progress: Progress, deadline: float | None) -> bool:
    """Hand out what is waiting and collect until nothing is left; true when the scheduler was lost."""
    total, begun, done_before = len(found.jobs), time.monotonic(), len(found.jobs) - len(found.waiting)
    pending = {client.submit(run_job, job, key=f"hangtime-{job.key}"): job for job in found.waiting}
    progress(done_before, total, "handed out")
    while pending:
        if _is_over(deadline):
            with contextlib.suppress(Exception):
                client.cancel(list(pending), force=True)
            return False
        for future in [f for f in pending if f.status != "pending"]:
            if future.status in ("cancelled", "lost"):
                return True
            job = pending[future]
            outcome = _outcome_of(future, job)
            if outcome is None:
                return True  # its word did not arrive: ask the store by handing it out again
            del pending[future]
            future.release()
            found.outcomes[job.key] = outcome
            done = total - len(found.waiting)
            progress(done, total, _left(done - done_before, total - done, time.monotonic() - begun))
        time.sleep(POLL)
    return False


def _outcome_of(future: Any, job: Job) -> Outcome | None:
    """What became of a job that ended, None when that could not be learned."""
    from distributed import KilledWorker

    if future.status == "error":
        try:
            error = future.exception(timeout=GATHER)
        except Exception:
            return None
        if isinstance(error, KilledWorker):
            sentence = "every worker that took it on died; another start of the batch tries again"
            return Outcome(key=job.key, state="refused", sentence=sentence)
        return Outcome(key=job.key, state="refused", sentence=f"{type(error).__name__}: {error}")
    try:
        found = future.result(timeout=GATHER)
    except Exception:
        return None
    return found if isinstance(found, Outcome) else None


def _left(done: int, left: int, seconds: float) -> str:
    """Say how much longer it will take, from the pace so far."""
    minutes = seconds / max(done, 1) * left / 60
    return f"about {minutes:.0f} min left" if left else "all done"


def _is_over(deadline: float | None) -> bool:
    return deadline is not None and time.monotonic() >= deadline


def _kept_sentence(results: Store, key: str) -> str:
    with contextlib.suppress(BatchError, ValueError, KeyError, TypeError):
        return str(json.loads(results.read(failure_name(key)))["sentence"])
    return "failed before"
