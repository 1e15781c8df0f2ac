"""Rounds of sync: upload waiting takes in order of sequence, prove one take a week, remove verified takes."""

from __future__ import annotations

import logging
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

from capture.appliance.receipts import receipt_path, receipts
from capture.appliance.spool import KeptTake, Spool
from capture.appliance.sync_status import Fault, Proof, SyncStatus, only_sync, read_status, write_status
from capture.errors import SyncError
from capture.sync.bringing import Target, bring, has_changed, read_back
from capture.sync.credentials import Credentials
from capture.sync.encryption import recipients_of
from capture.sync.faults import ServerError
from capture.sync.pace import wait_after
from capture.sync.proof import is_due, prove
from capture.sync.server import open_server
from capture.sync.settings import SyncSetup
from formats.store_address import folder_of, without_secrets
from formats.whole_files import make_folders

LOG = logging.getLogger("hangtime.sync")
SAME_DISK = "The server's folder is on the same disk as the takes: a broken disk loses both."
# s between two writes of the status during uploads. Our choice: half and double change only how old a shown status
# is.
STATUS_SECONDS = 5.0
PASSES_IN_A_ROW = 1000  # takes recorded meanwhile are uploaded too; this bound ends the loop


def now_here() -> datetime:
    """Return the wall-clock time with its UTC offset."""
    return datetime.now(UTC).astimezone()


@dataclass
class Standing:
    """The state of a sync process between rounds."""

    last_sync: str | None = None
    verified: str | None = None
    fault: Fault | None = None
    proof: Proof | None = None
    damaged: tuple[int, ...] = ()
    tries: int = 0


@dataclass
class Sync:
    """The takes of one spool folder and their server.

    - `has_asked`: whether the server was asked for or given anything
    """

    setup: SyncSetup
    credentials: Credentials
    clock: Callable[[], datetime] = now_here
    sleep: Callable[[float], None] = time.sleep
    chance: random.Random = field(default_factory=random.Random)
    has_asked: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        """Open the spool and the server that the settings name.

        Raises:
            HangtimeError: the settings or the credentials are invalid.
        """
        settings, self.folder = self.setup.settings, self.setup.spool
        self.spool = Spool(self.folder)
        self.target = Target(
            server=open_server(self.setup, self.credentials), url=settings.url, device=self.setup.device,
            recipients=recipients_of(settings.encrypt_to),
        )  # fmt: skip
        self._written_at = time.monotonic()
        self.standing = self._standing_before()

    def _standing_before(self) -> Standing:
        """Return the state that the last process left; after a change of address, only what holds for the new one."""
        before, url = read_status(self.folder), without_secrets(self.target.url)
        if before is None:
            return Standing()
        if before.url != url:
            newest = max((one for one in receipts(self.folder) if one.url == url), key=lambda one: one.at, default=None)
            return Standing(
                last_sync=newest.at if newest else None, verified=newest.verified if newest else None,
                damaged=before.damaged,
            )  # fmt: skip
        return Standing(
            last_sync=before.last_sync, verified=before.verified, fault=before.fault, proof=before.proof,
            damaged=before.damaged, tries=before.fault.tries if before.fault else 0,
        )  # fmt: skip

    def run(self) -> SyncError | None:
        """Run rounds until no take waits; return a fault that needs a person, None if every take is safe.

        Raises:
            SyncError: another process syncs these takes.
            OSError: this device's disk fails.
        """
        for _ in range(PASSES_IN_A_ROW):
            fault = self.once()
            if fault is None:
                return None
            if not isinstance(fault, ServerError) or fault.kind != "passing":
                return fault
            delay = wait_after(self.standing.tries, self.chance)
            self._write_next_try(delay)
            self.sleep(delay)
        return fault

    def once(self) -> SyncError | None:
        """Upload all waiting takes, prove if due, remove verified takes; return the fault that stopped it, if any.

        Raises:
            SyncError: another process syncs these takes.
            OSError: this device's disk fails.
        """
        make_folders(self.folder)
        with only_sync(self.folder):
            self._tidy()
            fault = self._bring_all()
            if fault is None and is_due(self.standing.proof, self.setup.settings.proof_days, self.clock()):
                try:
                    self._prove()
                except ServerError as error:
                    fault = error
            self._leave()
            self._note(fault)
            return fault

    def prove(self) -> Proof | None:
        """Prove a take now; None if no take was uploaded yet.

        Raises:
            ServerError: the server is unreachable.
            SyncError: another process syncs these takes.
        """
        make_folders(self.folder)
        with only_sync(self.folder):
            proof = self._prove()
            self._write()
            return proof

    # --- parts of a round ---------------------------------------------------------------------------

    def _bring_all(self) -> SyncError | None:
        first_fault: SyncError | None = None
        tried: set[int] = set()
        while waiting := [take for take in self.spool.waiting(self.target.url) if take.sequence not in tried]:
            for take in waiting:
                tried.add(take.sequence)
                try:
                    self._bring(take)
                except (SyncError, OSError) as error:
                    fault = error if isinstance(error, SyncError) else _own_disk(error, self.folder)
                    first_fault = first_fault or fault
                    LOG.warning("%s: %s", take.stem, self.credentials.hide(str(fault)))
                    if isinstance(fault, ServerError) and fault.kind != "take":
                        return fault
        return first_fault

    def _bring(self, take: KeptTake) -> None:
        self.has_asked = True
        receipt = bring(take, self.folder, self.target, now=self.clock())
        LOG.info("%s: safe on the server (%s)", take.stem, receipt.verified)
        if has_changed(take, receipt.sha256) and take.sequence not in self.standing.damaged:
            self.standing.damaged = (*self.standing.damaged, take.sequence)
        self.standing.last_sync, self.standing.verified = receipt.at, receipt.verified
        self.standing.fault, self.standing.tries = None, 0
        if time.monotonic() >= self._written_at + STATUS_SECONDS:
            self._write()

    def _prove(self) -> Proof | None:
        url = without_secrets(self.target.url)
        candidates = [receipt for receipt in receipts(self.folder) if receipt.url == url]
        self.has_asked = self.has_asked or bool(candidates)
        proof = prove(self.target.server, candidates, now=self.clock(), chance=self.chance)
        if proof is None:
            return None
        self.standing.proof = proof
        LOG.log(
            logging.ERROR if proof.is_bad else logging.INFO,
            "take-%06d was fetched from the server: %s", proof.sequence, proof.outcome,
        )  # fmt: skip
        if proof.is_bad:
            self._doubt_all()
        return proof

    def _doubt_all(self) -> None:
        """Check the server for every take still on this device, and withdraw the receipt of each missing one.

        A server that lost one take may have lost others. Without a receipt a take stays, and the next round sends it.
        """
        is_asked = True
        for take in self.spool.takes(self.target.url):
            if take.receipt is None:
                continue
            try:
                found = read_back(self.target.server, take.receipt.key) if is_asked else None
            except ServerError:
                found, is_asked = None, False
            if found is None or found.sha256 != take.receipt.stored_sha256:
                receipt_path(self.folder, take.stem).unlink(missing_ok=True)

    def _leave(self) -> None:
        room = self.spool.make_room(self.setup.settings.retention, now=self.clock(), url=self.target.url)
        for stem in room.left:
            LOG.info("%s: left this device; the take is safe on the server", stem)
        for stem in room.changed:
            LOG.warning("%s: stays; the file differs from the one that the server verified: replace the disk", stem)

    def _tidy(self) -> None:
        """Remove partial files of an earlier sync process that was killed."""
        for litter in [*self.folder.glob("sync-status.json*.partial"), *(self.folder / "receipts").glob("*.partial")]:
            litter.unlink(missing_ok=True)

    # --- status -------------------------------------------------------------------------------------

    def _note(self, fault: SyncError | None) -> None:
        now = self.clock().isoformat(timespec="seconds")
        if fault is not None:
            self.standing.tries += 1
            sentence = fault.what if fault.where is None else f"{fault.where}: {fault.what}"
            before = self.standing.fault
            self.standing.fault = Fault(
                sentence=self.credentials.hide(sentence), advice=self.credentials.hide(fault.advice),
                since=before.since if before else now, tries=self.standing.tries,
            )  # fmt: skip
        else:
            self.standing.fault, self.standing.tries = None, 0
        self._write()

    def _write_next_try(self, delay: float) -> None:
        if (fault := self.standing.fault) is not None:
            when = (self.clock() + timedelta(seconds=delay)).isoformat(timespec="seconds")
            self.standing.fault = Fault(
                sentence=fault.sentence, advice=fault.advice, since=fault.since, tries=fault.tries, next_try=when
            )
        self._write()

    def _write(self) -> None:
        self._written_at = time.monotonic()
        waiting, kept = self.spool.waiting(self.target.url), receipts(self.folder)
        here = sum(receipt.url == without_secrets(self.target.url) for receipt in kept)
        write_status(
            self.folder,
            SyncStatus(
                at=self.clock().isoformat(timespec="seconds"), url=without_secrets(self.target.url),
                device=self.target.device, waiting=len(waiting), waiting_bytes=sum(take.size for take in waiting),
                safe=here, elsewhere=len(kept) - here, is_encrypted=bool(self.target.recipients),
                last_sync=self.standing.last_sync, verified=self.standing.verified, fault=self.standing.fault,
                proof=self.standing.proof, damaged=self.standing.damaged, notes=self._notes(),
            ),
        )  # fmt: skip

    def _notes(self) -> tuple[str, ...]:
        folder = folder_of(self.target.url)
        if folder is None:
            return ()
        root = self.setup.base / folder
        existing: Path = next(path for path in (root, *root.absolute().parents) if path.exists())
        return (SAME_DISK,) if existing.stat().st_dev == self.folder.stat().st_dev else ()


def _own_disk(error: OSError, folder: Path) -> SyncError:
    """Return the fault of this device's disk, on which receipts are written."""
    return SyncError(
        f"this device cannot write receipts ({(error.strerror or 'its disk fails').lower()})",
        where=error.filename or folder,
        advice="make room on its disk or replace it; takes on the server are not sent twice",
    )  # fmt: skip
