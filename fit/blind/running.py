"""Diagnose every case of a set through the command line, as a user would; a failed case does not stop the run.

ANSWERS/<id>/diagnosis.json     the diagnosis
ANSWERS/<id>/failure.txt        the error of a case without a diagnosis, which counts as `inconclusive`
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from fit import runtime
from fit.blind.making import changed_files, read_manifest
from fit.errors import INCONCLUSIVE, FitError
from fit.folders import alone, make_folder
from formats.whole_files import write_whole

LIMIT = 3600.0  # s for one case: thirty times the usual time
# s after the terminal's Ctrl-C, until a diagnosis that still runs is interrupted too. Our choice: time for a
# diagnosis to save its state. Half and double were not tried.
INTERRUPT_PATIENCE = 10.0
FAILURE_SHOWN = 2000  # characters of the output's end that a failure repeats; our choice: an error and what led to it
DIAGNOSIS, FAILURE, OUTPUT_FILE = "diagnosis.json", "failure.txt", "output.txt"
KEPT = "diagnosis.partial"  # folder with saved fits of an interrupted diagnosis
Progress = Callable[[int, int, int], None]


def diagnose_command() -> list[str]:
    """Return the command line of `hangtime diagnose` in this Python."""
    return [sys.executable, "-m", "formats.command", "diagnose"]


def run_set(
    folder: Path, answers: Path, *, command: Sequence[str] = (), options: Sequence[str] = (),
    again: bool = False, limit: float = LIMIT, workers: int = 1, takes: int | None = None,
    without: Mapping[str, str] | None = None, progress: Progress = lambda done, total, failed: None,
) -> int:  # fmt: skip
    """Diagnose the unfinished cases; return the number that ended without a diagnosis.

    - `command`: command to run instead of `hangtime diagnose`
    - `options`: further arguments of the command
    - `again`: retry failures
    - `limit` [s]: time for one case
    - `workers`: number of parallel diagnoses, which share the processors
    - `takes`: number of takes of each case, the first ones, without held-out takes; None: all
    - `without`: only these cases, each with an effect to remove from its library

    Raises:
        FitError: there is no set, it is not complete, its files are not those that were made, or another run writes
            the same answers; or `hangtime diagnose` does not know the options.
    """
    manifest = read_manifest(folder)
    if not manifest.complete:
        raise FitError("the set is not complete", where=folder, advice="the same `hangtime blind make` completes it")
    changed = changed_files(folder, manifest)
    if changed:
        raise FitError(
            f"{len(changed)} files are not those that were made, first {changed[0]}", where=folder,
            advice="the same `hangtime blind make` makes them again",
        )  # fmt: skip
    diagnoses = _Diagnoses([*(command or diagnose_command())], options, limit, workers, takes)
    with alone(make_folder(answers)):
        return _run(dict.fromkeys(manifest.cases, "") if without is None else without, folder, answers, diagnoses,
                    again, workers, progress)  # fmt: skip


def _run(
    cases: Mapping[str, str], folder: Path, answers: Path, diagnoses: _Diagnoses, again: bool, workers: int,
    progress: Progress,
) -> int:  # fmt: skip
    """Diagnose these cases, each without one effect of the library or with the whole library."""
    left = [c for c in cases if not _is_done(answers / c) and (again or not (answers / c / FAILURE).exists())]
    failed = sum(not _is_done(answers / c) for c in cases if c not in left)
    progress(len(cases) - len(left), len(cases), failed)
    with ThreadPoolExecutor(workers) as pool:
        waiting = {pool.submit(diagnoses.run, folder / "cases" / c, answers / c, cases[c]): c for c in left}
        try:
            for done, ended in enumerate(as_completed(waiting), len(cases) - len(left) + 1):
                ended.result()
                failed += not _is_done(answers / waiting[ended])
                progress(done, len(cases), failed)
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            diagnoses.interrupt()
            raise
        except (FitError, OSError):  # wrong options or a full disk would fail the next case too
            pool.shutdown(cancel_futures=True)
            raise
    return failed


def _is_done(answer: Path) -> bool:
    return (answer / DIAGNOSIS).exists()


def _keep_outcome(work: Path, said: str, code: int) -> None:
    """Write the output of a diagnosis, and beside it either its result or its failure."""
    write_whole(work / OUTPUT_FILE, said.encode())
    if code in {0, INCONCLUSIVE} and _is_done(work):
        (work / FAILURE).unlink(missing_ok=True)
    else:
        (work / DIAGNOSIS).unlink(missing_ok=True)
        write_whole(work / FAILURE, f"exit code {code}\n{said[-FAILURE_SHOWN:]}".encode())


class _Diagnoses:
    """Parallel diagnoses, each in its own process."""

    def __init__(
        self, command: list[str], options: Sequence[str], limit: float, workers: int, takes: int | None
    ) -> None:
        self._command, self._options, self._limit, self._takes = command, options, limit, takes
        threads = max(1, runtime.available_threads() // workers)
        self._surroundings = {**os.environ, "HANGTIME_THREADS": str(threads)}
        self._running: set[subprocess.Popen[str]] = set()

    def run(self, case: Path, out: Path, without: str) -> None:
        """Run one diagnosis in a temporary folder, and rename the folder to the answer's when the process has ended.

        without: an effect to remove from the library, or nothing
        """
        work = out.with_name(f".{out.name}.partial")
        work.mkdir(parents=True, exist_ok=True)
        words = self._command_line(case, work, without)
        has_kept = (work / KEPT).exists()
        said, code = self._call(words)
        if code == FitError.exit_code and has_kept:  # the saved fits are of another version or of other options
            shutil.rmtree(work / KEPT)
            said, code = self._call(words)
        if code == FitError.exit_code and said.startswith("Usage:"):
            raise FitError(
                said.strip().splitlines()[-1].removeprefix("Error: "),
                where="--option",
                advice="see `hangtime diagnose --help`",
            )
        if code in {130, -signal.SIGINT}:  # the next run continues from the saved fits in its folder
            raise KeyboardInterrupt
        _keep_outcome(work, said, code)
        shutil.rmtree(out, ignore_errors=True)
        work.replace(out)

    def _command_line(self, case: Path, work: Path, without: str) -> list[str]:
        words = [str(p.resolve()) for p in sorted(case.glob("take-*.mcap"))[: self._takes]]
        for path in sorted(case.glob("held-out-*.mcap")) if self._takes is None else ():
            words += ["--held-out", str(path.resolve())]
        words = [*self._command, *words, "--out", str(work), *self._options]
        return [*words, "--without", without] if without else words

    def _call(self, words: list[str]) -> tuple[str, int]:
        """Run a command; return its output and its exit code."""
        try:
            process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                env=self._surroundings,
            )  # fmt: skip
        except OSError as error:
            return f"{error}", 127
        self._running.add(process)
        try:
            return process.communicate(timeout=self._limit)[0], process.returncode
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            return f"took longer than {self._limit:g} s", 124
        finally:
            self._running.discard(process)

    def interrupt(self) -> None:
        """Interrupt the running processes after a grace period."""
        for process in list(self._running):
            try:
                process.wait(INTERRUPT_PATIENCE)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGINT)
