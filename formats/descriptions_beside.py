"""The rig and the garment beside an imported take: they change once the take has its name, and not before.

Both are written under names of their own first: `NAME.rig.toml.partial` and `NAME.garment.toml.partial` of the take
`NAME.mcap`. Then the take gets its name, and then they get theirs. An import that is killed before the take has its
name has replaced nothing. One that is killed later leaves descriptions under their first names. Whoever reads the take
names these, and the next import into the folder renames them. One import at a time is at the descriptions of a folder.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from formats.descriptions import check_garment, check_rig, dump_description, refuse_codes, says
from formats.errors import DescriptionError, OutputError, TakeError
from formats.garment import Garment
from formats.outputs import check_length, holds, unwritable
from formats.rig import Rig
from formats.take_reader import read_take
from formats.unfinished import (
    ANOTHER_FOLDER,
    DESCRIBED_BESIDE,
    TellAside,
    already_there,
    prepared_name,
    put_aside,
    unfinished_name,
)
from formats.whole_files import sync_folder

PATIENCE = 10.0  # s; an import needs some milliseconds for its descriptions and the name of its take


def check_room_beside(take: Path) -> None:
    """Refuse a take whose rig and garment could not be written beside it, since their first names are longer.

    Raises:
        OutputError: its name is too long.
    """
    check_length(take, [prepared_name(take, name) for name in DESCRIBED_BESIDE])


def check_description(path: Path, description: Garment | Rig, *, overwrite: bool) -> None:
    """Check that a rig or garment of a take may be written; one that is there and says the same is no hindrance.

    Raises:
        DescriptionError: an impossible rig or garment, which no command would read.
        OutputError: another one is there, one that cannot be read, or a folder.
    """
    kind = "rig" if isinstance(description, Rig) else "garment"
    if isinstance(description, Rig):
        check_rig(description, path)
    else:
        check_garment(description, path)
    refuse_codes(path, msgspec.to_builtins(description))
    if not os.path.lexists(path) or (overwrite and not path.is_dir()):
        return
    try:
        if says(path, description):
            return
        what = f"is already there and describes another {kind} than that of this take"
    except DescriptionError as error:
        what = f"is already there and cannot be compared with the {kind} of this take: {error.what}"
    raise already_there(path, instead=ANOTHER_FOLDER, what=what)


@contextlib.contextmanager
def described_beside(
    take: Path, descriptions: Mapping[str, Garment | Rig], *, overwrite: bool, tell_aside: TellAside | None = None
) -> Iterator[None]:
    """Let work give a take that is whole its name, and then give its rig and garment theirs beside it.

    Work that fails leaves both as they were. One that is there and says the same stays as it is.

    - `descriptions`: by the names of `DESCRIBED_BESIDE`
    - `tell_aside`: called with the names of a file in the way that was put aside, before and after

    Raises:
        DescriptionError, OutputError: as `check_description`, or one cannot be written.
    """
    folder = take.parent
    with _alone_in(folder):
        _settle(folder)
        for name, description in descriptions.items():
            check_description(folder / name, description, overwrite=overwrite)
        changed = {name: one for name, one in descriptions.items() if not _is_said(folder / name, one)}
        made = list[str]()
        try:
            for name, description in changed.items():
                _prepare(take, name, dump_description(description), tell_aside)
                made.append(name)
            if changed:
                sync_folder(folder)
            yield
        except BaseException:
            _settle(folder)
            for name in set(made) - set(_left(take)):
                prepared_name(take, name).unlink(missing_ok=True)
            raise
        for name in changed:
            _give_name(take, name)
        if changed:
            sync_folder(folder)


def settle(folder: Path) -> list[Path]:
    """Give the descriptions that a killed import left their names, and return these.

    A description that was edited since stays, and one that cannot be renamed: whoever reads the take names both.

    Raises:
        OutputError: another program keeps the folder locked, or it cannot be read.
    """
    with _alone_in(folder):
        return _settle(folder)


def _settle(folder: Path) -> list[Path]:
    settled = []
    for name in DESCRIBED_BESIDE:
        ending = unfinished_name(Path(f".{name}")).name
        for prepared in sorted(folder.glob(f"*{ending}")):
            take = folder / f"{prepared.name.removesuffix(ending)}.mcap"
            if name in _left(take) and not _is_newer(folder / name, prepared):
                with contextlib.suppress(OutputError):
                    _give_name(take, name)
                    settled.append(folder / name)
    return settled


def _left(take: Path) -> tuple[str, ...]:
    """Return the descriptions that were left beside a take and are its own; none where it cannot be read."""
    try:
        report = read_take(take).report
    except TakeError:
        return ()
    return report.left if report is not None else ()


def _is_newer(path: Path, prepared: Path) -> bool:
    """Return whether a description was changed, or came there, after another was prepared to replace it."""
    try:
        return path.stat().st_ctime_ns > prepared.stat().st_ctime_ns
    except OSError:
        return False


def _give_name(take: Path, name: str) -> None:
    path = take.with_name(name)
    try:
        prepared_name(take, name).replace(path)
    except OSError as error:
        raise unwritable(path, error) from error


def _prepare(take: Path, name: str, text: str, tell_aside: TellAside | None) -> None:
    """Write a description under its first name; anything else that has this name is put aside."""
    path = prepared_name(take, name)
    try:
        if path.is_file() and not path.is_symlink() and holds(path, text.encode()):
            path.unlink()
        elif os.path.lexists(path):
            aside = put_aside(path, take.with_name(f"{take.stem}.{name}"))
            if tell_aside is not None:
                tell_aside(path, aside)
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise unwritable(path, error) from error


@contextlib.contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Wait until no other import is at the descriptions of a folder.

    Raises:
        OutputError: it is locked for longer than an import takes, or it cannot be read.
    """
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise unwritable(folder, error) from error
    try:
        until = time.monotonic() + PATIENCE
        while not _locked(handle):
            if time.monotonic() > until:
                raise OutputError(
                    f"has been locked by another program for {PATIENCE:g} s", where=folder,
                    advice="wait until that program ends, or choose another folder with --out",
                )  # fmt: skip
            time.sleep(0.02)
        yield
    finally:
        os.close(handle)


def _locked(handle: int) -> bool:
    """Return whether a folder is this process's own now, also where a file system has no locks of folders."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _is_said(path: Path, description: Garment | Rig) -> bool:
    """Return whether a file says what a description says; False of one that is not there or cannot be read."""
    with contextlib.suppress(DescriptionError):
        return says(path, description)
    return False
