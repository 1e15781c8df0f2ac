"""The disk thread: it writes and recovers takes and checks the disk, so that a slow disk never delays frames.

`behind` gives the thread's lag: the age of the oldest job that has not reached the disk.
"""

from __future__ import annotations

import errno
import os
import queue
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from capture.appliance.retention import Retention
from capture.appliance.spool import KeptTake, RunningTake, Spool
from capture.recording.frame_reader import Seen
from capture.recording.upside_down import of_the_sensor
from firmware_host.depth_sensor import SensorFrame
from formats.archive import TakeWriter, read_take
from formats.errors import HangtimeError, OutputError
from formats.findings import Finding
from formats.garment import Garment
from formats.judgement import judge
from formats.rig import Rig
from formats.whole_files import make_writable

# s of processor time allowed for reading and checking a take before the disk counts as slow. Our choice: half and
# double change only how late a slow disk is told.
READING_TIME = 60.0
COUNT_EVERY = 10.0  # s between two counts of the takes: sync adds receipts meanwhile


@dataclass(frozen=True, kw_only=True)
class TakePlan:
    """The metadata of a take at its beginning; `created`: wall-clock time of its first frame, ISO 8601."""

    rig: Rig
    garment: Garment
    source: str
    created: str
    notes: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class DiskNews:
    """A message from the disk thread; each field that is set is one event or state.

    - `room`: bytes free
    - `kept`: a take that has just received its final name
    - `findings`: the defects of this take that matter to a fit
    - `failure`: the error that ended a take, or that makes the spool unusable
    - `is_over`: the running take has ended
    - `salvaged`: takes that were recovered after a crash
    - `counts`: number of takes in the spool, and of those that wait for upload
    """

    room: int | None = None
    kept: KeptTake | None = None
    findings: tuple[Finding, ...] = ()
    failure: HangtimeError | None = None
    is_over: bool = False
    salvaged: tuple[KeptTake, ...] = ()
    is_sound: bool = False
    counts: tuple[int, int] | None = None


@dataclass
class _Work:
    do: Callable[[], None]
    asked_at: float


@dataclass
class _Running:
    running: RunningTake
    writer: TakeWriter
    frames: int = 0
    failure: HangtimeError | None = None
    facts: dict[str, Any] = field(default_factory=dict)


class Disk:
    """One spool folder and the thread that writes to it."""

    def __init__(
        self, folder: Path, *, least_free: int, retention: Retention, clock: Callable[[], float],
        url: str | None = None,
    ) -> None:  # fmt: skip
        """Prepare; url: only receipts from this server count as proof of an upload, None for any server."""
        self._spool, self._folder, self._url = Spool(folder), folder, url
        self._least_free, self._retention, self._clock = least_free, retention, clock
        self._work: queue.SimpleQueue[_Work | None] = queue.SimpleQueue()
        self._news: queue.SimpleQueue[DiskNews] = queue.SimpleQueue()
        self._busy_since: float | None = None
        self._pending = 0
        self._counted_at = -float("inf")
        self._is_look_queued = False
        self._lock = threading.Lock()
        self._take: _Running | None = None
        self._thread = threading.Thread(target=self._run, name="disk", daemon=True)

    def start(self) -> None:
        """Start the disk thread."""
        self._thread.start()

    def close(self, timeout_s: float) -> None:
        """Finish the queued jobs, within a time limit [s], and stop the thread."""
        self._work.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        if not self._thread.is_alive():
            self._spool.close()

    def behind(self, now: float) -> float:
        """Return the age [s] of the thread's oldest job, 0 if it has none."""
        since = self._busy_since
        return 0.0 if since is None else max(now - since, 0.0)

    @property
    def is_idle(self) -> bool:
        """Return whether no job is queued or running."""
        with self._lock:
            return self._pending == 0

    def news(self) -> list[DiskNews]:
        """Return the thread's messages since the last call."""
        found = []
        while True:
            try:
                found.append(self._news.get_nowait())
            except queue.Empty:
                return found

    def salvage(self) -> None:
        """Check that the folder is writable, recover takes after a crash and report whether the spool is sound."""
        self._put(self._do_salvage)

    def look(self) -> None:
        """Check folder and free space of the disk; a busy thread is asked once, however often this is called."""
        if not self._is_look_queued:
            self._is_look_queued = True
            self._put(self._do_queued_look)

    def begin(self, plan: TakePlan) -> None:
        """Begin a take."""
        self._put(lambda: self._do_begin(plan))

    def add(self, seen: Seen) -> None:
        """Add a frame to the running take."""
        self._put(lambda: self._do_add(seen))

    def end(self, facts: dict[str, Any], *, is_worth_keeping: bool, shown: SensorFrame | None = None) -> None:
        """Finish the running take; keep it with its metadata, or remove it.

        shown: a frame of the take with both markers, which tells a sensor that hangs upside down
        """
        self._put(lambda: self._do_end(facts, is_worth_keeping, shown))

    # --- in the thread -------------------------------------------------------------------------------

    def _put(self, do: Callable[[], None]) -> None:
        with self._lock:
            self._pending += 1
        self._work.put(_Work(do, self._clock()))

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Mark that the thread reads a take; processor time spent here does not count as a slow disk."""
        self._busy_since = self._clock() + READING_TIME
        yield
        self._busy_since = self._clock()

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            self._busy_since = work.asked_at
            try:
                work.do()
            except Exception as error:  # the thread must survive: a green lamp without it is the worst failure
                self._news.put(DiskNews(failure=_named(error, self._folder)))
            finally:
                self._busy_since = None
                with self._lock:
                    self._pending -= 1

    def _do_queued_look(self) -> None:
        self._is_look_queued = False
        self._do_look()

    def _do_look(self) -> None:
        self._spool.check_in_place()
        usage = shutil.disk_usage(self._folder)
        if os.statvfs(self._folder).f_flag & os.ST_RDONLY:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self._folder))  # worded as where a write fails
        if usage.free < self._least_free and self._take is None:
            with self._reading():
                room = self._spool.make_room(
                    self._retention, now=datetime.now(UTC), need=self._least_free, url=self._url
                )
            usage = shutil.disk_usage(self._folder)
            if room.left and usage.free >= self._least_free:
                self._news.put(DiskNews(room=usage.free))
                return
        self._news.put(DiskNews(room=usage.free))
        if self._clock() - self._counted_at >= COUNT_EVERY and self._take is None:
            self._count()

    def _count(self) -> None:
        self._counted_at = self._clock()
        takes = self._spool.takes(self._url)
        self._news.put(DiskNews(counts=(len(takes), sum(take.receipt is None for take in takes))))

    def _do_salvage(self) -> None:
        self._spool.check_in_place()
        make_writable(self._folder)
        with self._reading():
            salvaged = self._spool.salvage()
        self._news.put(DiskNews(salvaged=tuple(salvaged), is_sound=True))
        self._count()
        self._do_look()

    def _do_begin(self, plan: TakePlan) -> None:
        running = self._spool.begin()
        notes = {"sequence": str(running.sequence), **plan.notes}
        try:
            writer = TakeWriter(
                running.partial, take_id=running.stem, created=plan.created, rig=plan.rig, garment=plan.garment,
                source=plan.source, notes=notes, overwrite=False,
            )  # fmt: skip
        except OSError as error:
            raise _named(error, self._folder) from error
        self._take = _Running(running, writer)

    def _do_add(self, seen: Seen) -> None:
        take = self._take
        if take is None or take.failure is not None:
            return
        try:
            take.writer.append(seen.frame)
            if seen.scan is not None:
                take.writer.append_scan(seen.scan)
            take.frames += 1
        except Exception as error:  # as `_run`
            take.failure = _named(error, self._folder)
            take.writer.keep()
            self._news.put(DiskNews(failure=take.failure))

    def _do_end(self, facts: dict[str, Any], is_worth_keeping: bool, shown: SensorFrame | None = None) -> None:
        take, self._take = self._take, None
        if take is None:
            self._news.put(DiskNews(is_over=True))
            return
        try:
            kept, findings = self._kept(take, facts, shown) if is_worth_keeping else (None, ())
            if not is_worth_keeping:
                take.writer.discard()
            self._news.put(DiskNews(is_over=True, kept=kept, findings=findings))
            self._count()
        except Exception as error:  # as `_run`
            take.writer.keep()
            self._news.put(DiskNews(is_over=True, failure=_named(error, self._folder)))

    def _kept(
        self, take: _Running, facts: dict[str, Any], shown: SensorFrame | None
    ) -> tuple[KeptTake, tuple[Finding, ...]]:
        findings: tuple[Finding, ...] = ()
        if take.failure is None:
            take.writer.finish()
            with self._reading():
                kept = read_take(take.running.partial)
                findings = of_the_sensor(judge(kept), shown, kept.rig)
            facts = facts | {"findings": [finding.as_fact() for finding in findings]}
        else:
            facts = facts | {"ended_by": str(take.failure)}
        return self._spool.keep(take.running, facts), findings


def _named(error: Exception, folder: Path) -> HangtimeError:
    """Return an exception of the thread as a `HangtimeError` with its cause and the next action."""
    if isinstance(error, HangtimeError):
        return error
    if not isinstance(error, OSError):
        return OutputError(
            f"the recorder has a defect ({type(error).__name__}: {error})", where=folder,
            advice="move what the folder holds elsewhere, and report the defect with the journal",
        )  # fmt: skip
    advice = {
        errno.ENOSPC: "make room, or let `hangtime sync` send takes away", errno.EFBIG: "make room on the disk",
        errno.EDQUOT: "make room in the quota", errno.EROFS: _advice_if_read_only(folder),
        errno.EIO: "replace the card, which fails", errno.EACCES: "give it to the account of the recorder",
        errno.EISDIR: "remove what bears this name", errno.ENOTDIR: "remove what bears this name",
        errno.EEXIST: "remove what bears this name",
    }.get(error.errno or 0, "check the disk")  # fmt: skip
    where = error.filename or folder
    return OutputError(f"the disk cannot be written ({error.strerror or error})", where=where, advice=advice)


def _advice_if_read_only(folder: Path) -> str:
    """Return the next action where nothing can be written: systemd lets the unit write to its own folders alone."""
    own = os.environ.get("STATE_DIRECTORY", "")
    if not own or any(folder.is_relative_to(one) for one in own.split(":")):
        return "replace the card, which is worn out"
    return (
        f"if the card is sound, the unit may not write here: give spool.folder a place below {own}, or allow this one "
        f"with ReadWritePaths={folder} (`sudo systemctl edit hangtime-capture`)"
    )
