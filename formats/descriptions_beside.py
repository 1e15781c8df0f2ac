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
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from formats.descriptions import check_garment, check_rig, dump_description, load_garment, load_rig, refuse_codes
from formats.errors import DescriptionError, TakeError
from formats.garment import Garment
from formats.outputs import check_length, unwritable
from formats.rig import Rig
from formats.take_reader import read_take
from formats.unfinished import (
    ANOTHER_FOLDER,
    DESCRIBED_BESIDE,
    already_there,
    left_beside,
    prepared_name,
    unfinished_name,
)
from formats.whole_files import sync_folder


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
        if _says(path, description):
            return
        what = f"is already there and describes another {kind} than that of this take"
    except DescriptionError as error:
        what = f"is already there and cannot be compared with the {kind} of this take: {error.what}"
    raise already_there(path, instead=ANOTHER_FOLDER, what=what)


@contextlib.contextmanager
def described_beside(take: Path, descriptions: Mapping[str, Garment | Rig], *, overwrite: bool) -> Iterator[None]:
    """Let work give a take that is whole its name, and then give its rig and garment theirs beside it.

    Work that fails leaves both as they were. One that is there and says the same stays as it is.

    descriptions: by the names of `DESCRIBED_BESIDE`

    Raises:
        DescriptionError, OutputError: as `check_description`, or one cannot be written.
    """
    folder = take.parent
    with _alone_in(folder):
        _settle(folder)
        for name, description in descriptions.items():
            check_description(folder / name, description, overwrite=overwrite)
        changed = {name: one for name, one in descriptions.items() if not _is_said(folder / name, one)}
        try:
            for name, description in changed.items():
                _prepare(prepared_name(take, name), dump_description(description))
            if changed:
                sync_folder(folder)
            yield
        except BaseException:
            _settle(folder)
            raise
        for name in changed:
            _give_name(take, name)
        if changed:
            sync_folder(folder)


def settle(folder: Path) -> list[Path]:
    """Give the descriptions that a killed import left their names, and return these; remove those of no take.

    Raises:
        OutputError: one cannot be renamed.
        OSError: one cannot be removed.
    """
    with _alone_in(folder):
        return _settle(folder)


def _settle(folder: Path) -> list[Path]:
    settled = []
    for name in DESCRIBED_BESIDE:
        ending = unfinished_name(Path(f".{name}")).name
        for prepared in sorted(folder.glob(f"*{ending}")):
            take = folder / f"{prepared.name.removesuffix(ending)}.mcap"
            if name in left_beside(take) and _is_of(prepared, name, take):
                _give_name(take, name)
                settled.append(folder / name)
            elif not prepared.is_dir():
                prepared.unlink()
    return settled


def _is_of(prepared: Path, name: str, take: Path) -> bool:
    """Return whether a prepared file is of a take that has its name: else its import never came so far."""
    try:
        found = read_take(take)
    except TakeError:
        return False
    return _is_said(prepared, found.rig if name == DESCRIBED_BESIDE[0] else found.garment)


def _give_name(take: Path, name: str) -> None:
    path = take.with_name(name)
    try:
        prepared_name(take, name).replace(path)
    except OSError as error:
        raise unwritable(path, error) from error


def _prepare(path: Path, text: str) -> None:
    """Write a file that no other writer is at, as the lock of its take tells, and that counts only once it is whole."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise unwritable(path, error) from error


@contextlib.contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Wait until no other import is at the descriptions of a folder."""
    handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with contextlib.suppress(OSError):  # a file system without locks of folders
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _is_said(path: Path, description: Garment | Rig) -> bool:
    """Return whether a file says what a description says; False of one that is not there or cannot be read."""
    with contextlib.suppress(DescriptionError):
        return _says(path, description)
    return False


def _says(path: Path, description: Garment | Rig) -> bool:
    """Return whether a file that is there says what a description says, in whatever spelling.

    Raises:
        DescriptionError: it cannot be read or is none; the user may have accepted an implausible one, so that counts.
    """
    if isinstance(description, Rig):
        return load_rig(path, anyway=True) == description
    return load_garment(path, anyway=True).as_meant == description.as_meant
