"""Diagnose every case of a set through the command line, as a user would, and never stop for one that fails.

ANSWERS/<id>/diagnosis.json     what the diagnosis said
ANSWERS/<id>/failure.txt        where it ended without one: the case counts as `inconclusive`
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from fit.blind.making import changed_files, read_manifest
from fit.errors import FitError
from formats.whole_files import write_whole

LIMIT = 3600.0  # s for one case: thirty times what one takes
DIAGNOSIS, FAILURE, LOG = "diagnosis.json", "failure.txt", "output.txt"
Progress = Callable[[int, int, int], None]


def diagnose_command() -> list[str]:
    """Return the command that diagnoses takes, in this Python."""
    return [sys.executable, "-m", "formats.command", "diagnose"]


def run_set(
    folder: Path, answers: Path, *, command: Sequence[str] = (), options: Sequence[str] = (),
    again: bool = False, limit: float = LIMIT, progress: Progress = lambda done, total, failed: None,
) -> int:  # fmt: skip
    """Diagnose the cases that are not done; return how many ended without a diagnosis.

    command: what to run instead of `hangtime diagnose`; options: more words for it; again: retry failures;
    limit [s]: time for one case

    Raises:
        FitError: there is no set, it is not complete, or its files are not those that were made.
    """
    manifest = read_manifest(folder)
    if not manifest.complete:
        raise FitError("the set is not complete", where=folder, advice="the same `hangtime blind make` goes on with it")
    changed = changed_files(folder, manifest)
    if changed:
        raise FitError(
            f"{len(changed)} files are not those that were made, first {changed[0]}", where=folder,
            advice="the same `hangtime blind make` makes them again",
        )  # fmt: skip
    failed = 0
    for done, case in enumerate(manifest.cases):
        progress(done, len(manifest.cases), failed)
        out = answers / case
        if (out / DIAGNOSIS).exists():
            continue
        if again or not (out / FAILURE).exists():
            _diagnose(folder / "cases" / case, out, [*(command or diagnose_command())], options, limit)
        failed += not (out / DIAGNOSIS).exists()
    progress(len(manifest.cases), len(manifest.cases), failed)
    return failed


def _diagnose(case: Path, out: Path, command: list[str], options: Sequence[str], limit: float) -> None:
    """Diagnose into a folder beside the answer's, and give it its name when the process has ended."""
    work = out.with_name(f".{out.name}.partial")
    work.mkdir(parents=True, exist_ok=True)
    words = [str(p.resolve()) for p in sorted(case.glob("take-*.mcap"))]
    for path in sorted(case.glob("held-out-*.mcap")):
        words += ["--held-out", str(path.resolve())]
    try:
        ended = subprocess.run(
            [*command, *words, "--out", str(work), *options], capture_output=True, text=True,
            stdin=subprocess.DEVNULL, timeout=limit,
        )  # fmt: skip
        said, code = ended.stdout + ended.stderr, ended.returncode
    except OSError as error:
        said, code = f"{error}", 127
    except subprocess.TimeoutExpired:
        said, code = f"took longer than {limit:g} s", 124
    if code in {130, -2}:  # interrupted: the next run goes on with what the diagnosis kept in its folder
        raise KeyboardInterrupt
    write_whole(work / LOG, said.encode())
    if code == 0 and (work / DIAGNOSIS).exists():
        (work / FAILURE).unlink(missing_ok=True)
    else:
        (work / DIAGNOSIS).unlink(missing_ok=True)
        write_whole(work / FAILURE, f"exit code {code}\n{said[-2000:]}".encode())
    shutil.rmtree(out, ignore_errors=True)
    work.replace(out)
