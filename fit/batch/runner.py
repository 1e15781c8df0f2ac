"""Main loop of a batch: find new jobs, submit them, collect their outcomes, and reconnect after a lost scheduler.

Dask holds no results: a worker writes its own result, and the batch reads the store. So a killed worker costs its
current fit, and a lost scheduler costs a new connection. If the batch itself is killed, start the same command again.
"""

from __future__ import annotations

import contextlib
import json
import math
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from fit.batch.cluster import SCHEDULER_RETRY, STAGES, WAITS, Workers, connect, has_workers
from fit.batch.ending import Ending
from fit.batch.jobs import Job, Outcome, Task, digest_of, failure_name, key_of, result_name
from fit.batch.kept import has_fit, known_outcome
from fit.batch.room import room_here
from fit.batch.store import Store
from fit.batch.worker import run_job, words_of
from fit.errors import BatchError, FitError, UnreachableError
from fit.identification.request import Plan
from fit.provenance import physics_version
from formats.errors import HangtimeError, ImplausibleError, TakeError
from formats.plain_text import counted

POLL = 0.25  # s; our choice: fits take minutes, and Ctrl-C is answered at once
FRUITLESS = 10  # connections in a row without any outcome, after which the batch gives up
# s of waiting for a finished job's message. Our choice: longer than a message waits on a busy network. Half and
# double were not tried.
GATHER = 60.0
WORKER_INTERVAL = 5.0  # s between checks for workers; our choice: fits take minutes, half and double were not tried
ARRIVAL = 60.0  # s: time for workers to start or restart, even if the patience is shorter
SILENCE = 300.0  # s; a request to an unreachable bucket fails after 180 s at the latest (obstore's retry_timeout)
THIS_MACHINE = "this machine"
NEVER = Ending()

Progress = Callable[[float, int, str], None]  # jobs done, with the shares of those at work; all jobs; and words
Say = Callable[[str], None]


@dataclass
class Survey:
    """Takes (or garments) by name, each with the key of its result, and the known outcomes by key.

    digests: sha256 of each take that could be read, by name; work: a worker's function for one of the jobs
    """

    keys: dict[str, str] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    jobs: list[Task] = field(default_factory=list)
    work: Callable[[Any], Outcome] = run_job

    @property
    def waiting(self) -> list[Task]:
        """Jobs without a known outcome."""
        return [job for job in self.jobs if job.key not in self.outcomes]


def survey(takes: Store, results: Store, plan: Plan, *, retry_failed: bool = False, anyway: bool = False) -> Survey:
    """Read every take once and return the outstanding jobs and known outcomes.

    Raises:
        BatchError: there is no take, or the results cannot be listed.
        FitError: no garment of these takes has a mesh of the plan's spacing.
        UnreachableError: takes or results cannot be reached now.
    """
    names = takes.names("", ".mcap")
    if not names:
        folder = takes.path("")
        is_missing = folder is not None and not folder.is_dir()
        what = "is no folder that is there" if is_missing else "holds no take (*.mcap)"
        raise BatchError(what, where=takes.url, advice="check the address")
    failed = set(results.names("failed", ".json"))
    physics = physics_version()
    found, sizes = Survey(), {}
    no_meshes: dict[str, FitError] = {}
    for name in names:
        try:
            content = takes.read(name)
        except UnreachableError:
            raise  # this is no fault of the take
        except BatchError as error:
            key = key_of(name, plan, physics)
            found.keys[name] = key
            found.outcomes[key] = Outcome(key=key, state="refused", sentence=str(error))
            continue
        digest = digest_of(content)
        sizes[name] = len(content)
        key = key_of(digest, plan, physics)
        is_new = key not in found.keys.values()
        found.keys[name], found.digests[name] = key, digest
        why = kept_sentence(results, key) if failure_name(key) in failed and not retry_failed else None
        known = known_outcome(results, key, has_fit, "known", why, [result_name(key)])
        if known is not None:
            found.outcomes[key] = known
        elif is_new and (no_mesh := _refused_mesh(content, name, plan, anyway=anyway)):
            found.outcomes[key] = Outcome(key=key, state="refused", sentence=words_of(no_mesh))
            if isinstance(no_mesh, FitError):
                no_meshes[key] = no_mesh
        elif is_new:
            found.jobs.append(
                Job(key=key, take=name, digest=digest, takes_url=takes.url, results_url=results.url, plan=plan,
                    physics=physics, anyway=anyway)
            )  # fmt: skip
    if no_meshes and no_meshes.keys() == {*found.keys.values()}:
        first = next(iter(no_meshes.values()))
        what = first.what if len(names) == 1 else f"suits none of the {len(names)} takes: {first.what}"
        raise FitError(what, where="--spacing", advice=first.advice)
    # The smallest first, so that a huge take delays no other.
    found.jobs.sort(key=lambda job: sizes[job.take] if isinstance(job, Job) else 0)
    return found


def _refused_mesh(content: bytes, name: str, plan: Plan, *, anyway: bool) -> FitError | ImplausibleError | None:
    """Return why `fit` refuses a take whose garment has no mesh of this spacing; None if a worker decides.

    An implausible take, which `anyway` accepts, is refused for this reason, as its size may be in another unit.
    """
    from fit.cloth.mesh import check_mesh
    from formats.archive import take_of
    from formats.plausible import check_plausible_take

    if plan.spacing is None:
        return None
    try:
        take = take_of(content, name)
    except TakeError:
        return None
    try:
        if not anyway:
            check_plausible_take(take, name, offers_anyway=True)
        check_mesh(take.garment, plan.spacing)
    except (FitError, ImplausibleError) as error:
        return error
    return None


def run(
    found: Survey,
    workers: Workers,
    *,
    progress: Progress = lambda done, total, text: None,
    say: Say = lambda line: None,
    ending: Ending = NEVER,
) -> None:
    """Run the waiting jobs; outcomes enter the survey as they arrive, so that an interrupted run includes them.

    ending: end of the waiting for results

    Raises:
        BatchError: connections bring no result, one after the other.
        UnreachableError: no scheduler answers, it has no workers, or workers cannot reach takes or results, for longer
            than patience lasts.
    """
    fruitless, connections, told = 0, 0, ""
    while found.waiting and not ending.is_over:
        before = len(found.waiting)
        here, why_fewer = workers.at_most(before, room_here())
        if workers.scheduler is None and why_fewer not in ("", told):
            say(why_fewer)
            told = why_fewer
        with connect(here) as client:
            connections += 1
            say(f"Dashboard: {client.dashboard_link}" if connections == 1 else "Connected again.")
            is_lost = _Round(client, found, workers, progress, say).run(ending)
        if is_lost:
            left = counted(len(found.waiting), "job")
            say(f"The scheduler was lost; {left} left. Waiting for it to come back.")
        fruitless = 0 if len(found.waiting) < before else fruitless + 1
        if fruitless == FRUITLESS:
            raise BatchError(
                f"{FRUITLESS} connections in a row brought no result",
                where=workers.scheduler or THIS_MACHINE,
                advice="look at the logs of scheduler and workers; finished takes are kept",
            )


class _Round:
    """Submission and collection of jobs over one connection to a scheduler."""

    def __init__(self, client: Any, found: Survey, workers: Workers, progress: Progress, say: Say) -> None:
        self.client, self.found, self.workers, self.progress, self.say = client, found, workers, progress, say
        self.pending: dict[Any, Task] = {}
        self.later: list[tuple[float, Task]] = []  # jobs to submit again, and the instants [s]
        self.attempts: Counter[str] = Counter()
        self.last_seen = self.last_look = time.monotonic()  # instants of the last worker and of the last check [s]
        self.outage = Outage()
        self.waits: deque[str] = deque()  # messages of workers that wait to store a finished result
        self._is_news = False
        self.stages: dict[str, tuple[str, float]] = {}  # of jobs at work, by key
        self.client.subscribe_topic(WAITS, lambda event: self.waits.append(event[1]))
        self.client.subscribe_topic(STAGES, lambda event: self._hear(*event[1]))

    def run(self, ending: Ending) -> bool:
        """Submit the waiting jobs and collect all outcomes; return true if the scheduler was lost."""
        for job in self.found.waiting:
            self._hand_out(job)
        self.progress(len(self.found.jobs) - len(self.found.waiting), len(self.found.jobs), "handed out")
        while self.pending or self.later:
            if ending.is_over:
                with contextlib.suppress(Exception):
                    self.client.cancel(list(self.pending), force=True)
                return False
            for future in [f for f in self.pending if f.status != "pending"]:
                if not self._collect(future):
                    return True
            self._show_stages()
            while self.waits:
                self._note_outage(self.waits.popleft())
            self._look_for_workers()
            now = time.monotonic()
            due = [job for at, job in self.later if at <= now]
            self.later = [(at, job) for at, job in self.later if at > now]
            for job in due:
                self._hand_out(job)
            time.sleep(POLL)
        return False

    def _hear(self, key: str, stage: str, share: float) -> None:
        self.stages[key] = (stage, share)
        self._is_news = True

    def _show_stages(self) -> None:
        """Show the stages of the jobs at work, once a worker told of one."""
        if not self._is_news:
            return
        self._is_news = False
        names = {key: name for name, key in self.found.keys.items()}
        waiting = {job.key for job in self.found.waiting}
        working = {key: told for key, told in self.stages.items() if key in waiting}
        words = [f"{names.get(key, key)}: {stage}" for key, (stage, _) in working.items()]
        total = len(self.found.jobs)
        self.progress(total - len(waiting) + sum(share for _, share in working.values()), total, "; ".join(words))

    def _hand_out(self, job: Task) -> None:
        # Each attempt has its own key, because dask would return the old answer under the old key.
        attempt = self.attempts[job.key]
        self.attempts[job.key] += 1
        key = f"hangtime-{job.key}" + (f"-again{attempt}" if attempt else "")
        future = self.client.submit(self.found.work, replace(job, patience=self.workers.patience), key=key)
        self.pending[future] = job

    def _collect(self, future: Any) -> bool:
        """Record the outcome of an ended job; return false if it shows that the scheduler was lost."""
        if future.status in ("cancelled", "lost"):
            return False
        job = self.pending[future]
        outcome = _outcome_of(future, job)
        if outcome is None:
            return False  # its message is missing: submit it again, which checks the store
        del self.pending[future]
        future.release()
        if isinstance(outcome, UnreachableError):
            self._wait_for_store(outcome, job)
            return True
        if outcome.state != "refused":
            self.outage = Outage()
        self.found.outcomes[job.key] = outcome
        total = len(self.found.jobs)
        done = total - len(self.found.waiting)
        self.progress(done, total, "" if done < total else "all done")
        return True

    def _wait_for_store(self, error: UnreachableError, job: Task) -> None:
        if self._note_outage(str(error)) >= self.workers.patience:
            raise error
        self.later.append((time.monotonic() + SCHEDULER_RETRY, job))

    def _note_outage(self, sentence: str) -> float:
        """Report once that takes or results are unreachable; return the duration of this outage [s]."""
        is_new, seconds = self.outage.goes_on(time.monotonic())
        if is_new:
            self.say(f"{sentence}. Waiting for it to come back.")
        return seconds

    def _look_for_workers(self) -> None:
        now = time.monotonic()
        if now - self.last_look < WORKER_INTERVAL:
            return
        self.last_look = now
        if has_workers(self.client):
            self.last_seen = now
        elif now - self.last_seen >= max(self.workers.patience, ARRIVAL):
            raise UnreachableError(
                f"there have been no workers for {(now - self.last_seen) / 60:.0f} min",
                where=self.workers.scheduler or THIS_MACHINE,
                advice="start workers (dask worker ... --nthreads 1) and run the batch again: finished takes are kept",
            )


@dataclass
class Outage:
    """Duration in which workers cannot reach takes or results, from the jobs that end with this error."""

    first: float = -math.inf  # s
    last: float = -math.inf  # s

    def goes_on(self, now: float) -> tuple[bool, float]:
        """Record a failure to reach them now [s]; return whether the outage is new, and its duration [s].

        A resubmitted job that runs for longer than a failing request takes has reached the store.
        """
        is_new = now - self.last > SILENCE
        if is_new:
            self.first = now
        self.last = now
        return is_new, now - self.first


def _outcome_of(future: Any, job: Task) -> Outcome | UnreachableError | None:
    """Return the outcome of an ended job, the error if a retry is due, or None if the outcome is unknown."""
    from distributed import KilledWorker

    if future.status == "error":
        try:
            error = future.exception(timeout=GATHER)
        except Exception:
            return None
        if isinstance(error, UnreachableError):
            return error
        if isinstance(error, KilledWorker):
            sentence = "every worker that took it on died; another start of the batch tries again"
            return Outcome(key=job.key, state="refused", sentence=sentence)
        sentence = str(error) if isinstance(error, HangtimeError) else f"{type(error).__name__}: {error}"
        return Outcome(key=job.key, state="refused", sentence=sentence)
    try:
        found = future.result(timeout=GATHER)
    except Exception:
        return None
    return found if isinstance(found, Outcome) else None


def kept_sentence(results: Store, key: str) -> str | None:
    """Return the recorded reason of an earlier failure; None if unreadable, so that the job runs again."""
    try:
        return str(json.loads(results.read(failure_name(key)))["sentence"])
    except UnreachableError:
        raise
    except (BatchError, ValueError, KeyError, TypeError):
        return None
