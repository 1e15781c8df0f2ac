"""The rig and the garment beside an imported take: they change once the take has its name, and not before.

Both are written under names of their own first: `NAME.rig.toml.partial` and `NAME.garment.toml.partial` of the take
`NAME.mcap`. Then the take gets its name, and then they get theirs. An import that is killed before the take has its
name has replaced nothing. One that is killed later leaves descriptions under their first names. Whoever reads the take
names these, and the next import into the folder renames them where no other has their place. One import at a time is at
the descriptions of a folder.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import msgspec

from formats.descriptions import check_garment, check_rig, dump_description, refuse_codes, says
from formats.errors import DescriptionError, OutputError, TakeError
from formats.garment import Garment
from formats.left_descriptions import DESCRIBED_BESIDE, is_said, named, prepared_name
from formats.outputs import check_length, holds, unwritable
from formats.rig import Rig
from formats.system_causes import step_to_read
from formats.take_reader import read_take
from formats.take_report import LeftState
from formats.unfinished import ANOTHER_FOLDER, TellAside, already_there, put_aside, unfinished_name
from formats.whole_files import give_name, is_device, sync_folder

TellLeft = Callable[[str, OutputError], None]

PATIENCE = 10.0  # s; an import needs some milliseconds for its descriptions and the name of its take


def check_room_beside(take: Path) -> None:
    """Refuse a take whose rig and garment could not be written beside it.

    Raises:
        OutputError: its name is too long, since their first names are longer; or a pipe or device has one of theirs.
    """
    check_length(take, [prepared_name(take, name) for name in DESCRIBED_BESIDE])
    for path in (take.with_name(name) for name in DESCRIBED_BESIDE):
        if is_device(path):
            raise already_there(path, instead=ANOTHER_FOLDER)


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
    take: Path, descriptions: Mapping[str, Garment | Rig], *, overwrite: bool, tell_aside: TellAside | None = None,
    tell_left: TellLeft,
) -> Iterator[None]:  # fmt: skip
    """Let work give a take that is whole its name, and then give its rig and garment theirs beside it.

    Work that fails leaves both as they were. One that is there and says the same stays as it is.

    - `descriptions`: by the names of `DESCRIBED_BESIDE`
    - `tell_aside`: called with the names of a file in the way that was put aside, before and after
    - `tell_left`: called with the name of one that cannot be replaced although the take has its name, and with why

    Raises:
        DescriptionError, OutputError: as `check_description`, or one cannot be written.
    """
    folder = take.parent
    with _alone_in(folder):
        _settle(folder)
        for name, description in descriptions.items():
            check_description(folder / name, description, overwrite=overwrite)
        changed = {name: one for name, one in descriptions.items() if not is_said(folder / name, one)}
        made = list[str]()
        try:
            for name, description in changed.items():
                _prepare(take, name, dump_description(description), tell_aside)
                made.append(name)
            if changed:
                sync_folder(folder)
            yield
        except BaseException:
            left = _left_of(take)
            for name in made:
                if name not in left:
                    prepared_name(take, name).unlink(missing_ok=True)
                    continue
                with contextlib.suppress(OSError):  # it stays, and whoever reads the take names it
                    give_name(prepared_name(take, name), folder / name, may_replace=overwrite)
            raise
        for name in changed:
            try:
                give_name(prepared_name(take, name), folder / name, may_replace=overwrite)
            except OSError as error:
                tell_left(name, _irreplaceable(take, name, error))
        if changed:
            sync_folder(folder)


def _irreplaceable(take: Path, name: str, error: OSError) -> OutputError:
    prepared = prepared_name(take, name).name
    return OutputError(
        f"cannot be replaced ({error.strerror}), and {take.name} is there", where=take.with_name(name),
        advice=f"remove it, or have its owner do so, then rename {prepared} to {name}",
    )  # fmt: skip


def settle(folder: Path) -> list[Path]:
    """Give the descriptions that a killed import left their names where these are free, and return these.

    One that is left beside another that says the same is removed. Nothing is replaced, since a person may have put it
    there. A description that stays without its name is named by whoever reads the take.

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
            with contextlib.suppress(OSError, TakeError):
                take = read_take(folder / f"{prepared.name.removesuffix(ending)}.mcap")
                own = named(take.rig, take.garment)[name]
                if is_said(folder / name, own) and is_said(prepared, own):
                    prepared.unlink()
                elif take.report is not None and take.report.left.get(name) == "waiting":
                    give_name(prepared, folder / name, may_replace=False)
                    settled.append(folder / name)
    return settled


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


def _left_of(take: Path) -> Mapping[str, LeftState]:
    """Return the descriptions that were left beside a take; none where it cannot be read."""
    try:
        report = read_take(take).report
    except TakeError:
        return {}
    return report.left if report is not None else {}


@contextlib.contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Wait until no other import is at the descriptions of a folder.

    Raises:
        OutputError: it is locked for longer than an import takes, or it cannot be read.
    """
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise OutputError(
            f"cannot be read ({error.strerror})", where=folder, advice=f"{step_to_read(error)}, or {ANOTHER_FOLDER}"
        ) from error
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
