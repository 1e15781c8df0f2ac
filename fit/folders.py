"""Folders of results: checked before the work that fills them, and locked for one command."""

from __future__ import annotations

import fcntl
import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from fit.errors import FitError
from formats.diagnosis_records import Diagnosis
from formats.errors import OutputError, ResultError
from formats.fit_records import BOUND_NOTE, JUDGED_ON, OF_A_TAKE, WARNING, FitResult
from formats.outputs import check_folder_name, make_output_folder
from formats.plain_text import plain, shortened
from formats.results import load_diagnosis, load_fit_result

PARTIAL = {"fit": "fit.partial.json", "diagnose": "diagnosis.partial"}  # what an interrupted command keeps
RESULTS = ("fit.json", "diagnosis.json")
NAMED_BESIDE = f"{WARNING} the diagnosis beside this fit "


def make_folder(folder: Path, *files: str) -> Path:
    """Make a folder in which `files` are to be written, check that they can be, and return it.

    Raises:
        FitError: the folder has the ending of a file, cannot be made or written to, or a folder has the name of one of
            the files.
    """
    try:
        check_folder_name(folder, *(Path(name).suffix for name in files))
        make_output_folder(folder)
    except OutputError as error:
        raise FitError(error.what, where=error.where, advice=error.advice) from error
    for name in files:
        if (folder / name).is_dir():
            raise FitError("is a folder; a file is to be written there", where=folder / name, advice="move it away")
    return folder


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Lock a folder for one command; the kernel releases the lock when the process ends.

    A command that fails or is interrupted before it has written anything leaves no empty folder.

    Raises:
        FitError: another process holds it.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise FitError(
                "another command writes here", where=folder, advice="wait until it has ended, or name another folder"
            ) from error
        except OSError:  # a network file system may not support locks of folders
            pass
        try:
            yield
        except BaseException:
            with suppress(OSError):  # the folder is not empty
                folder.rmdir()
            raise
    finally:
        os.close(handle)


def set_aside_others(
    path: Path, are_of: Callable[[FitResult | Diagnosis], bool], new: FitResult | Diagnosis | None = None
) -> str:
    """Rename an earlier result of other takes or options, and its report, by a number; return a sentence on this.

    Nothing is returned if there is no earlier result, or one of the same takes and options, which the new one replaces.
    A report beside no result at all is somebody's own page, and is renamed too.

    are_of: returns whether a result is of the present takes, such as `Ready.are_of`; new: the result to be written
    """
    both = (path, path.with_name("report.html"), path.with_name("report.motion.npz"))
    if not path.exists():
        there = [one for one in both if os.path.lexists(one)]
        if not there or any(path.with_name(name).exists() for name in RESULTS):
            return ""
        return f"{plain(there[0])} is of no result in this folder: kept as {_kept(there).name}."
    try:
        kept = load_fit_result(path) if path.name == "fit.json" else load_diagnosis(path)
    except ResultError as error:
        whose = f"is not known to be of these takes ({error.what})"
    else:
        whose = f"is of other takes ({_named(kept.take_ids)})"
        if are_of(kept):
            whose = _made_otherwise(kept, new) if new is not None else ""
        if not whose:
            return ""
    return f"{plain(path)} {whose}: kept as {plain(_kept(both).name)}, with its report."


def _named(takes: Sequence[str]) -> str:
    return plain(", ".join(map(shortened, takes)))


def _made_otherwise(kept: FitResult | Diagnosis, new: FitResult | Diagnosis) -> str:
    """Return how a result of the same takes differs from a new one by its options, '' where it does not."""
    if sorted(kept.held_out_ids) != sorted(new.held_out_ids):
        return f"is judged on {_named(kept.held_out_ids) or 'no held-out take'}"
    if isinstance(kept, FitResult) and isinstance(new, FitResult):
        made = [(one.method, one.search, one.engine, one.seed, one.spacing, sorted(one.effects)) for one in (kept, new)]
        words = tuple(f"another {word}" for word in ("method", "search", "engine", "seed", "mesh spacing"))
        words += ("other effects",)
        differing = [word for word, before, after in zip(words, *made, strict=True) if before != after]
        ranges = [[(p.name, p.initial, p.minimum, p.maximum) for p in one.parameters] for one in (kept, new)]
    else:
        library = [{e.id for e in one.effects} if isinstance(one, Diagnosis) else set() for one in (kept, new)]
        differing = ["another library of effects"] if library[0] != library[1] else []
        models = (one.base_parameters if isinstance(one, Diagnosis) else [] for one in (kept, new))
        ranges = [[(p.name, p.initial, p.minimum, p.maximum) for p in parameters] for parameters in models]
    before, after = map(_options_of, (kept, new))
    if before.get(JUDGED_ON, after.get(JUDGED_ON)) != after.get(JUDGED_ON):
        return "is judged on another recording of the same name"
    differing += [f"another {name}" for name, value in after.items() if before.get(name, value) != value]
    if not differing and ranges[0] != ranges[1]:
        differing = ["other starts or ranges of its parameters"]
    return f"has {differing[0]}" if differing else ""


def _options_of(result: FitResult | Diagnosis) -> dict[str, str | float]:
    """Return a result's options, with the takes judged on in one order; older versions state the order given."""
    judged = {key: " ".join(sorted(str(value).split())) for key, value in result.options.items() if key == JUDGED_ON}
    return result.options | judged


def _kept(files: Sequence[Path]) -> Path:
    """Rename files by one number that none of them has yet; return the new name of the first."""
    number = next(n for n in itertools.count(1) if not any(os.path.lexists(_numbered(one, n)) for one in files))
    for one in files:
        if os.path.lexists(one):
            one.rename(_numbered(one, number))
    return _numbered(files[0], number)


def refuse_unfinished(file: Path) -> None:
    """Refuse a result that is not there yet, where its folder holds what an interrupted command kept.

    Raises:
        FitError: names the command that goes on.
    """
    command = {"fit.json": "fit", "diagnosis.json": "diagnose"}.get(file.name)
    if command is None or file.exists():
        return
    kept = file.with_name(PARTIAL[command])
    if kept.exists():
        raise FitError(
            f"holds an unfinished {'fit' if command == 'fit' else 'diagnosis'}, {kept.name}", where=file.parent,
            advice=f"run the same `hangtime {command}` again; the command continues from its last finished step",
        )  # fmt: skip


def notes_of_diagnosis(notes: Sequence[str]) -> list[str]:
    """Return a fit's notes on what a diagnosis beside it names."""
    return [note for note in notes if note.startswith(NAMED_BESIDE)]


def own_warnings(notes: Sequence[str]) -> list[str]:
    """Return a fit's warnings of its own numbers; those of its takes and of a diagnosis have functions of their own."""
    others = (OF_A_TAKE, NAMED_BESIDE)
    return [note for note in notes if note.startswith((WARNING, BOUND_NOTE)) and not note.startswith(others)]


def _numbered(path: Path, number: int) -> Path:
    return path.with_name(f"{path.stem}.{number}{path.suffix}")
