"""The spool: the folder in which takes lie until they are safe on the server.

Every take has a number that is never given twice on this device, even if the clock is wrong. The files of take 42:

    sequence                          the last number that was given
    recorder.lock                     locked by the one process that records here
    take-000042.recording.mcap.partial   being written, or what a crash left
    take-000042.recording.mcap        finished by the archive writer, not yet kept
    take-000042.salvaged.mcap         a sound copy of what a crash left, not yet kept
    take-000042.mcap                  KEPT: this name is the only thing that makes a take one
    take-000042.json                  its facts; written before the take gets its name
    take-000042.unreadable            what a crash left and nothing could be read from; never removed by itself
    receipts/take-000042.json         its receipt (see `capture.appliance.receipts`); written last, stays for good

All lie in one folder, so that each change of a name is one rename, which a power cut leaves done or not done.
The order of writes: number, archive (synced), facts, name, receipt, and only then may the take leave. Each is synced,
and its folder after it, before the next begins. Hence after any prefix of them:

    number only                       a gap in the numbers; no take was promised
    a partial archive                 `salvage` writes a sound copy, keeps the copy, then removes the partial one
    a finished archive, facts or not  `salvage` gives it its name
    a name and a leftover             the leftover is an older state of the same take, and is removed
    facts without a take              they belong to a take that left or to none, and are removed
    a take without a receipt          sync verifies or sends it; its key on the server comes from its content
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import msgspec

from capture.appliance.receipts import Receipt, read_receipt
from capture.appliance.recorder_lock import RecorderLock
from capture.appliance.retention import Retention, Room, takes_to_leave
from capture.errors import SpoolError
from formats.archive import read_take, verify_take, write_take
from formats.errors import TakeError
from formats.store_address import without_secrets
from formats.unfinished import unfinished_name
from formats.whole_files import make_folders, read_bounded, sync_folder, write_whole

TAKE_NAME = re.compile(r"take-([0-9]{6,12})\.")
LAST_NUMBER = 10**12 - 1  # a name has at most 12 digits; nobody would find a take with more
PIECE = 1 << 20  # bytes read at once while hashing; our choice: bounds memory, and the hash is the same for any size

CRASHED = "the recorder ended without finishing this take: a power cut or a crash; up to its last second is missing"
UNNAMED = "the recorder ended after the last frame and before the take had its name: a power cut or a crash"


@dataclass(frozen=True)
class RunningTake:
    """A take that is being recorded.

    partial: the path to give to the archive writer (`TakeWriter`), which adds `.partial` while it writes
    """

    sequence: int
    partial: Path

    @property
    def stem(self) -> str:
        """Return the take's name without an ending; also a good `take_id`."""
        return _stem(self.sequence)


@dataclass(frozen=True)
class KeptTake:
    """A take that is on the disk under its name.

    facts: what the recorder said of it, and `sha256`, `bytes` of the archive as it was kept; `salvaged` where a crash
        had left it, with a sentence that says so
    receipt: what says that it is on the server; None while it waits
    """

    sequence: int
    path: Path
    facts: dict[str, Any]
    receipt: Receipt | None

    @property
    def stem(self) -> str:
        """Return its name without an ending."""
        return _stem(self.sequence)

    @cached_property
    def size(self) -> int:
        """Bytes of the archive; 0 if it left meanwhile."""
        with contextlib.suppress(OSError):
            return self.path.stat().st_size
        return 0


class Spool:
    """The takes of one folder. Anybody may look; one process at a time may record."""

    def __init__(self, folder: Path) -> None:
        """Look at a folder; it is made when something is first written.

        The first `begin`, `keep` or `salvage` makes this process the one that records here, until `close`.
        """
        self.folder = folder
        self._lock = RecorderLock(folder)

    # --- recording ----------------------------------------------------------------------------------

    def begin(self) -> RunningTake:
        """Give a number to a take that is about to be recorded. The number is on the disk when this returns.

        Raises:
            SpoolError: another process records here, the folder was replaced, or a spoilt file says that the numbers
                are used up.
            OSError: the folder cannot be written.
        """
        self._lock.take()
        number = self._next_number()
        write_whole(self.folder / "sequence", f"{number}\n".encode())
        return RunningTake(sequence=number, partial=self._file(number, "recording.mcap"))

    def keep(self, running: RunningTake, facts: dict[str, Any]) -> KeptTake:
        """Give a take its name. It is on the disk under this name when this returns.

        An archive that its writer could not finish is salvaged first. Facts for which there is no room are not
        written: the take is kept all the same.

        Raises:
            SpoolError: nothing can be read from what was written.
            OSError: the disk fails; `salvage` tries again what is left.
        """
        self._lock.take()
        finished = running.partial
        if not finished.exists():
            if (kept := self._salvage_partial(running.sequence, facts)) is None:
                raise SpoolError(
                    "nothing was written of this take", where=unfinished_name(finished), advice="record it again"
                )
            return kept
        return self._give_name(running.sequence, finished, facts)  # its writer synced it before it had this name

    def salvage(self) -> list[KeptTake]:
        """Keep the takes that a crash interrupted, and remove all other unfinished files; return the kept takes.

        Raises:
            SpoolError: another process records here, or no number is left, after what was found is kept.
            OSError: the disk fails or is full; nothing is lost, and the next call goes on.
        """
        self._lock.take()
        kept = []
        for number in sorted(self._numbers("recording.mcap.partial") | self._numbers("recording.mcap")):
            found = None
            if not self._file(number, "mcap").exists():
                found = self._salvage_finished(number) or self._salvage_partial(number, None)
            if found is not None:
                kept.append(found)
            self._tidy(number)
        for number in self._numbers("json") - self._numbers("mcap"):
            self._file(number, "json").unlink(missing_ok=True)
        for pattern in ("take-*.json*.partial", "sequence*.partial"):  # what `write_whole` had not named yet
            for litter in self.folder.glob(pattern):
                litter.unlink(missing_ok=True)
        sync_folder(self.folder)
        self._next_number()  # a spool without one is not sound
        return kept

    # --- looking ------------------------------------------------------------------------------------

    def takes(self, url: str | None = None) -> list[KeptTake]:
        """Return the kept takes in the order of their numbers; url: only receipts of this server count."""
        found = [self._take(number) for number in sorted(self._numbers("mcap"))]
        return found if url is None else [_as_seen_from(url, take) for take in found]

    def waiting(self, url: str | None = None) -> list[KeptTake]:
        """Return the kept takes without a receipt, in the order of their numbers; url: as of `takes`."""
        return [take for take in self.takes(url) if take.receipt is None]

    # --- room ---------------------------------------------------------------------------------------

    def make_room(self, retention: Retention, *, now: datetime, need: int = 0, url: str | None = None) -> Room:
        """Let verified takes leave, the oldest first, until quota and free space hold; an unsynced one never leaves.

        Each take that would leave is read and compared with what the server verified.

        need: bytes that are wanted on top; now: the wall clock, with its offset; url: as of `takes`

        Raises:
            OSError: the disk fails.
        """
        make_folders(self.folder)
        takes = self.takes(url)
        free = shutil.disk_usage(self.folder).free
        changed: list[str] = []

        def is_safe(take: KeptTake) -> bool:  # now: a proof that failed may have taken the receipt back meanwhile
            receipt = read_receipt(self.folder, take.stem)
            if receipt is None or receipt != take.receipt or (content := _content_of(take.path)) is None:
                return False
            if content != receipt.sha256:
                changed.append(take.stem)
            return content == receipt.sha256

        leaving = takes_to_leave(takes, retention, free=free, need=need, now=now, is_safe=is_safe)
        used = sum(take.size for take in takes) - sum(take.size for take in leaving)
        for take in leaving:
            take.path.unlink(missing_ok=True)
        if leaving:
            sync_folder(self.folder)  # the take first: facts without a take are tidied, a take needs its facts
            for take in leaving:
                self._file(take.sequence, "json").unlink(missing_ok=True)
        free = shutil.disk_usage(self.folder).free
        is_enough = used + need <= retention.quota_bytes and free - need >= retention.least_free_bytes
        left = tuple(take.stem for take in leaving)
        return Room(left=left, used=used, free=free, is_enough=is_enough, changed=tuple(changed))

    # --- the one that records -----------------------------------------------------------------------

    def check_in_place(self) -> None:
        """Check that the folder in which this process records is still the one at its path.

        Raises:
            SpoolError: it is gone or replaced, as where its disk was unmounted.
        """
        self._lock.check_in_place()

    def close(self) -> None:
        """Let another process record here."""
        self._lock.let_go()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- salvage ------------------------------------------------------------------------------------

    def _salvage_finished(self, number: int) -> KeptTake | None:
        finished = self._file(number, "recording.mcap")
        try:
            if not verify_take(finished).is_sound:
                return None
        except TakeError as error:
            _raise_what_the_disk_said(error)
            return None
        facts = self._facts(number)
        return self._give_name(number, finished, {**facts, "salvaged": UNNAMED})

    def _salvage_partial(self, number: int, facts: dict[str, Any] | None) -> KeptTake | None:
        """Write a sound copy of what can be read and keep it; set aside what cannot be read."""
        finished = self._file(number, "recording.mcap")
        left = finished if finished.exists() else unfinished_name(finished)
        copy = self._file(number, "salvaged.mcap")
        unfinished_name(copy).unlink(missing_ok=True)  # an earlier copy that was cut off: what it was made of is here
        try:
            take = read_take(left)
            write_take(copy, replace(take, notes={**take.notes, "salvaged": CRASHED}))
        except TakeError as error:
            _raise_what_the_disk_said(error)
            if left.exists() and left.stat().st_size:
                left.replace(self._file(number, "unreadable"))
                sync_folder(self.folder)
            return None
        described = {**(self._facts(number) if facts is None else facts), "frames": len(take.time), "salvaged": CRASHED}
        kept = self._give_name(number, copy, described)
        self._tidy(number)
        return kept

    def _give_name(self, number: int, finished: Path, facts: dict[str, Any]) -> KeptTake:
        facts = {**facts, "sequence": number, "sha256": sha256_of(finished), "bytes": finished.stat().st_size}
        with contextlib.suppress(OSError):  # no room even for this: better a take without facts than none
            write_whole(self._file(number, "json"), msgspec.json.format(msgspec.json.encode(facts), indent=2) + b"\n")
        path = self._file(number, "mcap")
        finished.replace(path)
        sync_folder(self.folder)
        return KeptTake(sequence=number, path=path, facts=facts, receipt=None)

    def _tidy(self, number: int) -> None:
        """Remove earlier states of a take."""
        for ending in ("recording.mcap.partial", "recording.mcap", "salvaged.mcap.partial", "salvaged.mcap"):
            self._file(number, ending).unlink(missing_ok=True)

    # --- names --------------------------------------------------------------------------------------

    def _file(self, number: int, ending: str) -> Path:
        return self.folder / f"{_stem(number)}.{ending}"

    def _take(self, number: int) -> KeptTake:
        path, receipt = self._file(number, "mcap"), read_receipt(self.folder, _stem(number))
        if receipt is not None and not _is_of(receipt, path):
            receipt = None
        return KeptTake(sequence=number, path=path, facts=self._facts(number), receipt=receipt)

    def _facts(self, number: int) -> dict[str, Any]:
        with contextlib.suppress(OSError, msgspec.DecodeError):
            return msgspec.json.decode(read_bounded(self._file(number, "json")), type=dict[str, Any])
        return {}

    def _numbers(self, ending: str) -> set[int]:
        """Return the numbers of the files with an ending: a folder, a link or `take-0000042` is nobody's take."""
        return {
            number for number, entry in self._named()
            if entry.name == f"{_stem(number)}.{ending}" and entry.is_file(follow_symlinks=False)
        }  # fmt: skip

    def strays(self) -> list[str]:
        """Return the names of takes in the folder that no recorder of this device has named, in order."""
        names = (path.name for path in self.folder.glob("*.mcap"))
        return sorted(name for name in names if not TAKE_NAME.match(name))

    def _named(self) -> Iterator[tuple[int, os.DirEntry[str]]]:
        """Yield the number of every file that is named after a take."""
        with contextlib.suppress(FileNotFoundError), os.scandir(self.folder) as entries:
            for entry in entries:
                if found := TAKE_NAME.match(entry.name):
                    yield int(found[1]), entry

    def _next_number(self) -> int:
        number = self._last_number() + 1
        if number > LAST_NUMBER:
            raise SpoolError(
                f"the numbers of takes are used up: {number - 1} was given", where=self.folder / "sequence",
                advice="remove what bears this number, and write the true last number into this file",
            )  # fmt: skip
        return number

    def _last_number(self) -> int:
        """Return the last number that was given: the file says so, and no take or receipt may have a higher one."""
        given = 0
        with contextlib.suppress(OSError, ValueError):
            given = int(read_bounded(self.folder / "sequence"))
        received = (
            int(found[1]) for path in (self.folder / "receipts").glob("*.json") if (found := TAKE_NAME.match(path.name))
        )
        return max([given, *(number for number, _ in self._named()), *received])


def _as_seen_from(url: str, take: KeptTake) -> KeptTake:
    """Return a take without a receipt of another server than this one."""
    if take.receipt is None or take.receipt.url == without_secrets(url):
        return take
    return replace(take, receipt=None)


def _is_of(receipt: Receipt, path: Path) -> bool:
    """Whether a receipt can be of a take, by its size: another device's take may have been copied here."""
    try:
        return path.stat().st_size == receipt.bytes
    except OSError:  # it has left meanwhile
        return True


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, read in pieces.

    Raises:
        OSError: it cannot be read.
    """
    import hashlib  # here: see `formats.take_writer.binding_of`

    total = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(PIECE):
            total.update(piece)
    return total.hexdigest()


def _content_of(path: Path) -> str | None:
    """Return the SHA-256 of a take that is here, None where it left meanwhile or the disk does not show it."""
    try:
        return sha256_of(path)
    except OSError:
        return None


def _raise_what_the_disk_said(error: TakeError) -> None:
    """Raise the disk's own error, unlike an error of a take's content; a missing file raises none."""
    if isinstance(error.__cause__, OSError) and not isinstance(error.__cause__, FileNotFoundError):
        raise error.__cause__


def _stem(number: int) -> str:
    return f"take-{number:06d}"
