"""Write a command's output files without replacing any file that the user did not name for it."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from formats.errors import OutputError
from formats.plain_text import counted, plain
from formats.system_causes import step_to_write
from formats.unfinished import ANOTHER_NAME, already_there, is_left_over, left_unfinished, not_utf8, unfinished_name
from formats.whole_files import (
    is_device,
    is_folder,
    kind_of_file,
    longest_name,
    make_folders,
    make_writable,
    name_of_its_own,
    write_whole,
)

# How an output is written and its endings, the usual one first: arguments of `check_ending` and `check_place`.
AS_PICTURE = ("pictures are written as PNG", ".png")
AS_PAGE = ("pages are written as HTML", ".html", ".htm")
AS_RESULT = ("results are written as JSON", ".json")
AS_TABLE = ("tables are written as CSV", ".csv", ".txt")
AS_PARQUET = ("one table of all takes is written as Parquet", ".parquet", ".pq")
AS_RIG = ("a rig is written as TOML", ".toml")
AS_GARMENT = ("a garment is written as TOML", ".toml")
AS_SHEET = ("markers are written as SVG", ".svg")

COMPRESSED = (".gz", ".bz2", ".xz", ".zst", ".zip")  # endings of gzip, bzip2, xz, Zstandard and ZIP

NAMED_PARTIAL = (".mcap", ".oni")  # written as NAME.partial; others are written as `name_of_its_own`


def check_name(path: Path) -> None:
    """Refuse a file name that cannot be stored as text.

    Raises:
        OutputError: the name is not UTF-8.
    """
    try:
        path.name.encode()
    except UnicodeEncodeError as error:
        raise not_utf8(path) from error


def check_ending(path: Path, kind: str, *endings: str, may_lack: bool = False) -> None:
    """Check the ending of an output file; programs go by it.

    The arguments are those of `check_place`; `may_lack`: whether a name without any ending is taken as it is.

    Raises:
        OutputError: the file has another ending.
    """
    if endings and path.suffix.lower() not in endings and not (may_lack and not path.suffix):
        advice = uncompressed(path, endings) or f"give a name that ends in {endings[0]}"
        raise OutputError(kind, where=path, advice=advice)


def uncompressed(path: Path, endings: Iterable[str]) -> str:
    """Return the next step for the name of a compressed output file, such as `a.csv.gz`; '' for any other name."""
    if path.suffix.lower() not in COMPRESSED or Path(path.stem).suffix.lower() not in endings:
        return ""
    return f"nothing is compressed here: give {plain(path.stem)}, and compress that file"


def check_folder_name(folder: Path, *endings: str) -> None:
    """Refuse the name of a file where a new folder is to be named, because the file would become a folder.

    endings: of the files that are written into the folder

    Raises:
        OutputError: the name has one of the endings, and no folder has this name.
    """
    if folder.suffix.lower() in endings and not os.path.isdir(folder):
        raise OutputError(
            "is the name of a file, and a folder of files is written", where=folder,
            advice=f"give the folder alone, such as {plain(folder.with_suffix(''))}",
        )  # fmt: skip


def check_place(path: Path, kind: str = "", *endings: str) -> None:
    """Check the ending of an output file and that its folder exists, before the work begins.

    - `kind`: how the file is written, for the error about another ending
    - `endings`: its possible endings, the usual one first; none for any ending

    Raises:
        OutputError: the file has another ending, or its folder does not exist.
    """
    check_ending(path, kind, *endings)
    try:
        os.stat(f"{path.parent}/.")  # a file has no such name
    except OSError as error:
        raise unwritable(path, error) from error


def check_length(path: Path, written_as: Iterable[Path]) -> None:
    """Refuse a file name that becomes too long with the suffix of its unfinished file.

    Raises:
        OutputError: the name is too long; says by how many bytes.
    """
    most = longest_name(path.parent)
    added = max(len(os.fsencode(one.name)) for one in written_as) - len(os.fsencode(path.name))
    over = len(os.fsencode(path.name)) + added - most
    if over > 0:
        raise OutputError(
            f"cannot be written ({os.strerror(errno.ENAMETOOLONG)})", where=path,
            advice=f"choose a shorter name, by {counted(over, 'byte')} or more: {counted(added, 'byte')} are added "
            "while it is written",
        )  # fmt: skip


def check_stem(name: str) -> None:
    """Refuse a name from which no file name can be made.

    Raises:
        OutputError: the name is empty or has a slash.
    """
    if not name or "/" in name:
        raise OutputError(f"no file can have the name {name!r}", where="--name", advice="give one without a slash")


def refuse_to_replace(
    path: Path, text: str | None = None, *, overwrite: bool = False, instead: str = ANOTHER_NAME
) -> None:  # fmt: skip
    """Refuse to replace an existing file of this name, or the beginning of a take that was never finished.

    A folder that cannot be written to is refused too, before the work begins.

    - `text`: content to write; an existing file with this content may stay
    - `overwrite`: refuse only a folder, a pipe, or a file that another process writes
    - `instead`: the next step in the error, for a user who wants to keep both files

    Raises:
        OutputError: the file exists, its name is too long, or its folder cannot be written to.
    """
    if not path.name:  # `.` and `/`
        raise already_there(path, instead=instead)
    partial = unfinished_name(path)
    check_length(path, [partial if path.suffix in NAMED_PARTIAL else name_of_its_own(path)])
    try:
        is_left = path.suffix == ".mcap" and is_left_over(path, instead=instead)  # takes alone are written like this
        is_no_file = overwrite and (is_folder(path) or is_device(path))
    except OSError as error:
        raise unwritable(path, error) from error
    if is_no_file:
        raise already_there(path, instead=instead)
    if not overwrite and os.path.lexists(path):
        if text is not None and holds(path, text.encode()):
            return
        left = f", and {partial.name} is what an interrupted recording or import of it left" * is_left
        raise already_there(path, instead=instead, what=f"is already there{left}")
    if not overwrite and is_left:
        raise left_unfinished(partial, instead=instead)
    if os.path.isdir(path.parent):
        try:
            make_writable(path.parent)
        except OSError as error:
            raise unwritable(path, error) from error


def refuse_an_input(target: Path, inputs: Iterable[Path], *, instead: str = ANOTHER_NAME) -> None:
    """Refuse to write over one of the input files, even with --overwrite.

    instead: as in `refuse_to_replace`

    Raises:
        OutputError: the target is one of them.
    """
    for path in inputs:
        with contextlib.suppress(OSError):
            if target.samefile(path):
                raise OutputError("would replace the take that is read", where=target, advice=instead)


def holds(path: Path, content: bytes) -> bool:
    """Return whether a file exists and holds exactly these bytes.

    Raises:
        OSError: the file cannot be read.
    """
    return stat.S_ISREG(kind_of_file(path)) and path.stat().st_size == len(content) and path.read_bytes() == content


def check_is_no_input(out: Path, inputs: Mapping[str, str | Path]) -> None:
    """Check that an output file is none of the files that other options name.

    Raises:
        OutputError: it is one of them.
    """
    for option, path in inputs.items():
        try:
            is_one = out.samefile(path)
        except OSError:  # it is not there, and whoever reads or writes it says why
            is_one = False
        if is_one:
            raise OutputError(f"is what {option} reads", where=out, advice="give another name to --out")


def make_output_folder(folder: Path) -> None:
    """Make a folder and check that files can be written to it, before the work begins.

    Parents that were made for a folder that cannot be made are removed again.

    Raises:
        OutputError: it cannot be made or written to.
    """
    try:
        with no_empty_folder(folder):
            make_writable(folder)
    except OSError as error:
        raise OutputError(
            f"cannot be made or written to ({error.strerror})", where=folder, advice=step_to_make(error)
        ) from error


def step_to_make(error: OSError) -> str:
    """Return the next step for a folder that could not be made with its parents, or refused a file.

    A new name can then be absent only in a place such as /proc, which is there and refuses every name.
    """
    return "choose another folder: this one takes no files" if error.errno == errno.ENOENT else step_to_write(error)


@contextlib.contextmanager
def output_folder(folder: Path, *endings: str) -> Iterator[None]:
    """Make a folder for the `with` block, as `make_output_folder` does; a block that fails leaves no empty folder.

    endings: as for `check_folder_name`

    Raises:
        OutputError: it has the name of a file, or cannot be made or written to.
    """
    check_folder_name(folder, *endings)
    with no_empty_folder(folder):
        make_output_folder(folder)
        yield


@contextlib.contextmanager
def no_empty_folder(folder: Path) -> Iterator[None]:
    """Remove a folder that the `with` block made, if the block fails and leaves the folder empty."""
    missing = [one for one in (folder, *folder.parents) if not os.path.exists(one)]  # `Path.exists` refuses long names
    try:
        yield
    except BaseException:
        for made in missing:
            with contextlib.suppress(OSError):  # it holds something, or was never made
                made.rmdir()
        raise


def make_parent(path: Path) -> None:
    """Make the folder of an output file, including missing parent folders.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        make_folders(path.parent)
    except OSError as error:
        raise OutputError(
            f"cannot be made ({error.strerror})", where=path.parent, advice=step_to_make(error)
        ) from error


def write_text(path: Path, text: str, *, overwrite: bool = True) -> None:
    """Write a text file as `write_bytes` does.

    Raises:
        OutputError: as `write_bytes`.
    """
    write_bytes(path, text.encode(), overwrite=overwrite)


def write_bytes(
    path: Path, content: bytes | Iterable[bytes], *, overwrite: bool = True, instead: str = ANOTHER_NAME
) -> None:
    """Write a file whole or not at all.

    - `content`: as in `write_whole`
    - `overwrite`: whether to replace a file that appeared after `refuse_to_replace` was called
    - `instead`: as in `refuse_to_replace`

    Raises:
        OutputError: the file exists and may not be replaced, or cannot be written.
    """
    try:
        write_whole(path, content, may_replace=overwrite)
    except FileExistsError as error:
        raise already_there(path, instead=instead) from error
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: OSError) -> OutputError:
    """Return the error of a file that cannot be written, with a next step for its cause."""
    advice = step_to_make(error) if os.path.isdir(path.parent) else step_to_write(error)
    return OutputError(f"cannot be written ({error.strerror})", where=path, advice=advice)
