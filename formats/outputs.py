"""Files that a command writes: never one in the place of another that nobody named as to be replaced."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import msgspec

from formats.descriptions import check_garment, check_rig, dump_description, load_garment, load_rig, refuse_codes
from formats.errors import DescriptionError, OutputError
from formats.garment import Garment
from formats.rig import Rig
from formats.system_causes import step_to_write
from formats.unfinished import (
    ANOTHER_NAME,
    already_there,
    left_unfinished,
    not_utf8,
    refuse_what_is_no_file,
    unfinished_name,
)
from formats.whole_files import make_folders, make_writable, write_whole

NO_LINKS = {errno.EPERM, errno.ENOTSUP, errno.ENOSYS}  # of file systems without second names, as `man 2 link` says


def check_name(path: Path) -> None:
    """Refuse a name that is to be written into a file and cannot be.

    Raises:
        OutputError: it is not UTF-8.
    """
    try:
        path.name.encode()
    except UnicodeEncodeError as error:
        raise not_utf8(path) from error


def check_stem(name: str) -> None:
    """Refuse a name from which files' names are to be made and cannot be.

    Raises:
        OutputError: it is empty or has a slash.
    """
    if not name or "/" in name:
        raise OutputError(
            f"the name {name!r} is none that a file can have", where="--name", advice="give one without a slash"
        )


def refuse_to_replace(path: Path, text: str | None = None, *, instead: str = ANOTHER_NAME) -> None:
    """Do nothing unless a file of this name is there, or the beginning of a take that was never finished.

    - `text`: the content to write, where a file that holds just this may stay
    - `instead`: a person's next step who wants both

    Raises:
        OutputError: it is there, or its name is too long.
    """
    partial = unfinished_name(path)
    is_left = path.suffix == ".mcap" and _is_left(partial, path)  # takes alone are written under this name
    if os.path.lexists(path) and not (text is not None and _holds(path, text.encode())):
        left = f", and {partial.name} is what an interrupted recording or import of it left" * is_left
        raise already_there(path, instead=instead, what=f"is already there{left}")
    if is_left:
        raise left_unfinished(partial, instead=instead)


def _is_left(partial: Path, path: Path) -> bool:
    """Return whether an unfinished take is there; an empty one lost nothing, or its writer's lock refuses."""
    try:
        refuse_what_is_no_file(partial)
        return partial.exists() and partial.stat().st_size > 0
    except OSError as error:
        raise unwritable(path, error) from error


def refuse_an_input(target: Path, inputs: Iterable[Path]) -> None:
    """Refuse to write over one of the files that are read, whatever may be replaced.

    Raises:
        OutputError: the target is one of them.
    """
    for path in inputs:
        with contextlib.suppress(OSError):
            if target.samefile(path):
                raise OutputError("would replace the take that is read", where=target, advice="give another name")


def _holds(path: Path, content: bytes) -> bool:
    return path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content


def check_is_no_input(out: Path, inputs: Mapping[str, str | Path]) -> None:
    """Check that a file to be written is none of those that other options name.

    Raises:
        OutputError: it is.
    """
    for option, path in inputs.items():
        if out.exists() and Path(path).exists() and out.samefile(path):
            raise OutputError(f"is what {option} reads", where=out, advice="give another name to --out")


def make_output_folder(folder: Path) -> None:
    """Make a folder and check that it can be written to, before the work that is to fill it.

    Raises:
        OutputError: it cannot.
    """
    try:
        make_writable(folder)
    except OSError as error:
        raise OutputError(
            f"cannot be made or written to ({error.strerror})", where=folder, advice=step_to_write(error)
        ) from error


@contextlib.contextmanager
def output_folder(folder: Path) -> Iterator[None]:
    """Make a folder for the work inside, as `make_output_folder` does; work that fails leaves no empty one behind.

    Raises:
        OutputError: it cannot be made or written to.
    """
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        make_output_folder(folder)
        yield
    except BaseException:
        with contextlib.suppress(OSError):  # it holds something, or was never made
            for made in missing:
                made.rmdir()
        raise


@contextlib.contextmanager
def put_back_on_failure(*paths: Path) -> Iterator[None]:
    """Let work replace files of a folder that is there; work that fails leaves them as they were, or absent.

    Until its end each file has a second name, so that a full disk keeps none from being put back.

    Raises:
        OutputError: the folder cannot be written to.
    """
    former = {path: path.with_name(f"{path.name}.{os.urandom(6).hex()}.partial") for path in paths}
    there = {path for path in paths if os.path.lexists(path)}
    try:
        for path in there:
            if path.is_file() or path.is_symlink():  # nothing else can be replaced
                _name_twice(path, former[path])
        yield
    except BaseException:
        for path in paths:
            if os.path.lexists(former[path]):
                former[path].replace(path)
            elif path not in there:
                path.unlink(missing_ok=True)
        raise
    finally:
        for second in former.values():
            second.unlink(missing_ok=True)


def _name_twice(path: Path, second: Path) -> None:
    """Give a file a second name, or a copy where its file system knows no second names."""
    try:
        try:
            second.hardlink_to(path)
        except OSError as error:
            if error.errno not in NO_LINKS:
                raise
            shutil.copy2(path, second, follow_symlinks=False)
    except OSError as error:
        raise unwritable(path, error) from error


def make_parent(path: Path) -> None:
    """Make the folder of a file to be written, with those above it that are missing.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        make_folders(path.parent)
    except OSError as error:
        raise OutputError(
            f"cannot be made ({error.strerror})", where=path.parent, advice=step_to_write(error)
        ) from error


def write_text(path: Path, text: str, *, overwrite: bool = True) -> None:
    """Write a text as `write_bytes` does.

    Raises:
        OutputError: as `write_bytes`.
    """
    write_bytes(path, text.encode(), overwrite=overwrite)


def write_bytes(path: Path, content: bytes, *, overwrite: bool = True) -> None:
    """Write a file whole or not at all.

    overwrite: whether one may be replaced that came there since `refuse_to_replace` looked

    Raises:
        OutputError: it is there and may not be replaced, or cannot be written.
    """
    try:
        write_whole(path, content, may_replace=overwrite)
    except FileExistsError as error:
        raise already_there(path) from error
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: OSError) -> OutputError:
    """Return the error of a file that cannot be written, with the next step by its cause."""
    return OutputError(f"cannot be written ({error.strerror})", where=path, advice=step_to_write(error))


def check_description(
    path: Path, description: Garment | Rig, *, overwrite: bool, instead: str = ANOTHER_NAME
) -> None:  # fmt: skip
    """Check that a rig or garment of a take may be written; one that is there and says the same is no hindrance.

    instead: as of `refuse_to_replace`

    Raises:
        DescriptionError: an impossible rig or garment, which no command would read.
        OutputError: another one is there, or a folder.
    """
    is_rig = isinstance(description, Rig)
    if isinstance(description, Rig):
        check_rig(description, path)
    else:
        check_garment(description, path)
    refuse_codes(path, msgspec.to_builtins(description))
    if os.path.lexists(path) and (not overwrite or path.is_dir()) and not _says(path, description):
        what = f"is already there and describes another {'rig' if is_rig else 'garment'} than that of this take"
        raise already_there(path, instead=instead, what=what)


def write_description(
    path: Path, description: Garment | Rig, *, overwrite: bool, instead: str = ANOTHER_NAME
) -> None:  # fmt: skip
    """Write a rig or garment, making its folder; one that is there and says the same stays as it is.

    Raises:
        DescriptionError: as `check_description`.
        OutputError: another one is there, or it cannot be written.
    """
    check_description(path, description, overwrite=overwrite, instead=instead)
    make_parent(path)
    if _says(path, description):
        return
    try:
        write_text(path, dump_description(description), overwrite=overwrite)
    except OutputError:
        if not _says(path, description):  # another command may have written the same just now
            raise


def _says(path: Path, description: Garment | Rig) -> bool:
    """Return whether a file is there that says what a description says."""
    if path.exists():
        with contextlib.suppress(DescriptionError):
            return (load_rig(path) if isinstance(description, Rig) else load_garment(path)) == description
    return False
