"""Replace the rig and garment files beside an imported take, only once the take is complete.

Both are first written under unfinished names: `NAME.rig.toml.partial` and `NAME.garment.toml.partial` for the take
`NAME.mcap`. Then the take gets its final name, and then the two files get theirs. An import that is killed before the
take has its name has replaced nothing. An import that is killed later leaves files under their unfinished names. Every
command that reads the take names these files. The next import into the folder renames them where the final names are
free. One import at a time may change the descriptions of a folder.

A file that is written otherwise than an import writes is put aside before it is replaced: it may be a person's work.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import msgspec

from formats.descriptions import check_garment, check_rig, dump_description, load_garment, load_rig, refuse_codes, says
from formats.errors import DescriptionError, OutputError, TakeError
from formats.garment import Garment
from formats.left_descriptions import DESCRIBED_BESIDE, GARMENT_FILE, is_said, named, prepared_name
from formats.outputs import check_length, holds, unwritable
from formats.rig import Rig
from formats.system_causes import step_to_read
from formats.take_reader import read_take
from formats.take_report import LeftState
from formats.unfinished import ANOTHER_FOLDER, TellAside, already_there, put_aside, unfinished_name
from formats.whole_files import give_name, is_device, is_folder, sync_folder

TellLeft = Callable[[str, OutputError], None]

OF_A_SENSOR = (b"hanger", b"sensor", b"calibration", b"bodies", b"camera_at_m")  # parts of a rig that no import writes
PATIENCE = 10.0  # s, longest wait for the lock; an import holds it for some milliseconds


def check_room_beside(take: Path) -> None:
    """Refuse a take beside which rig and garment cannot be written.

    Raises:
        OutputError: the name is too long for the unfinished names, or a pipe or device has one of these names.
    """
    check_length(take, [prepared_name(take, name) for name in DESCRIBED_BESIDE])
    for path in (take.with_name(name) for name in DESCRIBED_BESIDE):
        if is_device(path):
            raise already_there(path, instead=ANOTHER_FOLDER)


def check_description(path: Path, description: Garment | Rig, *, overwrite: bool) -> None:
    """Check that a take's rig or garment may be written; an existing file with the same values may stay.

    Raises:
        DescriptionError: the rig or garment is impossible, so no command would read it.
        OutputError: another or an unreadable description, or a folder, has the name.
    """
    kind = "rig" if isinstance(description, Rig) else "garment"
    if isinstance(description, Rig):
        check_rig(description, path)
    else:
        check_garment(description, path)
    refuse_codes(path, msgspec.to_builtins(description))
    if not os.path.lexists(path) or (overwrite and not is_folder(path)):
        return
    try:
        if says(path, description):
            return
        what = f"is already there and describes another {kind} than that of this take"
    except DescriptionError as error:
        what = f"is already there and cannot be compared with the {kind} of this take: {error.what}"
    raise already_there(path, instead=ANOTHER_FOLDER, what=what)


def is_of_a_sensor(path: Path) -> bool:
    """Return whether a file describes a rig that no import writes: with a hanger, sensor, calibration or bodies.

    A file that cannot be read counts if its text has one of these words.
    """
    try:
        rig = load_rig(path, anyway=True)
    except DescriptionError:
        with contextlib.suppress(OSError):
            return path.is_file() and any(word in path.read_bytes() for word in OF_A_SENSOR)
        return False
    parts = (rig.hanger, rig.sensor, rig.calibration, rig.bodies, rig.camera_at_m)
    return any(part not in (None, msgspec.UNSET) for part in parts)


@contextlib.contextmanager
def described_beside(
    take: Path, descriptions: Mapping[str, Garment | Rig], *, overwrite: bool, tell_aside: TellAside | None = None,
    tell_left: TellLeft,
) -> Iterator[None]:  # fmt: skip
    """Let the `with` block name a complete take, and then rename its rig and garment files beside it.

    If the block fails, existing files stay. An existing file with the same values also stays.

    - `descriptions`: by the names of `DESCRIBED_BESIDE`
    - `tell_aside`: called with the old and the new name of a file that was renamed out of the way
    - `tell_left`: called with the name of a file that cannot be replaced although the take has its name, and the reason

    Raises:
        DescriptionError, OutputError: as `check_description`, or a file cannot be written.
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
                    _put_beside(take, name, tell_aside, overwrite=overwrite)
            raise
        for name in changed:
            try:
                _put_beside(take, name, tell_aside, overwrite=overwrite)
            except OSError as error:
                tell_left(name, _irreplaceable(take, name, error))
        if changed:
            sync_folder(folder)


def _put_beside(take: Path, name: str, tell_aside: TellAside | None, *, overwrite: bool) -> None:
    """Give a prepared description its final name; a file there by a person becomes `garment.kept-1.toml`.

    Raises:
        OSError: it cannot be renamed, or the file there cannot be kept.
    """
    path, aside = take.with_name(name), None
    if overwrite and os.path.lexists(path) and _may_be_by_hand(path):
        every = (path.with_name(f"{path.stem}.kept-{number}{path.suffix}") for number in itertools.count(1))
        aside = next(one for one in every if not os.path.lexists(one))
        try:
            os.link(path, aside, follow_symlinks=False)
        except OSError:  # a file system without hard links
            shutil.copy2(path, aside, follow_symlinks=False)
    try:
        give_name(prepared_name(take, name), path, may_replace=overwrite)
    except OSError:
        if aside is not None:
            aside.unlink()
        raise
    if aside is not None and tell_aside is not None:
        tell_aside(path, aside)


def _may_be_by_hand(path: Path) -> bool:
    try:
        written = load_garment(path, anyway=True) if path.name == GARMENT_FILE else load_rig(path, anyway=True)
        return path.read_text(encoding="utf-8") != dump_description(written)
    except (OSError, UnicodeDecodeError, DescriptionError):
        return True


def _irreplaceable(take: Path, name: str, error: OSError) -> OutputError:
    prepared = prepared_name(take, name).name
    return OutputError(
        f"cannot be replaced ({error.strerror}), and {take.name} is there", where=take.with_name(name),
        advice=f"remove it, or have its owner do so, then rename {prepared} to {name}",
    )  # fmt: skip


def settle(folder: Path) -> list[Path]:
    """Rename the descriptions that a killed import left, where their final names are free; return their final names.

    A left file beside one with the same values is removed. No file is replaced, since a person may have put it there.
    Every command that reads the take names a description that keeps its unfinished name.

    Raises:
        OutputError: another program keeps the folder locked, or the folder cannot be read.
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
    """Write a description under its unfinished name; any other file of this name is renamed out of the way."""
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
    """Return the descriptions that an import left beside a take; none where the take cannot be read."""
    try:
        report = read_take(take).report
    except TakeError:
        return {}
    return report.left if report is not None else {}


@contextlib.contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Wait until no other import changes the descriptions of a folder, and lock the folder.

    Raises:
        OutputError: the folder stays locked for longer than an import takes, or cannot be read.
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
    """Return whether this process now holds the folder's lock; a file system without folder locks counts as locked."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True
