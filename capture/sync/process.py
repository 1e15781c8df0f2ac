"""The process of sync: reads settings and credentials, logs to stderr and returns an exit code."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import msgspec

from capture.appliance.config_tables import SpoolPart
from capture.appliance.last_good import possible_spools
from capture.appliance.spool import Spool
from capture.appliance.sync_status import Fault, SyncStatus, read_status, write_status
from capture.errors import SyncError
from capture.sync.credentials import Credentials, find_credentials, leave_no_core_dump
from capture.sync.rounds import Sync, now_here
from capture.sync.settings import DEFAULT_FILE, SyncSetup, load_settings
from formats.errors import HangtimeError
from formats.telling import know
from formats.terminal import say

SAFE, REFUSED, LATER = 0, 2, 75  # 75: EX_TEMPFAIL of sysexits.h: the caller may retry
EXIT_CODES = "Exit code 0: all takes are safe; 2: settings, credentials or disk; 75: the server did not accept them."
LEVELS = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3}  # of sd-daemon(3)


class _Journal(logging.Handler):
    """Writes log lines without keys, with journald's priorities if journald reads them."""

    def __init__(self, credentials: Credentials) -> None:
        super().__init__()
        self._credentials = credentials
        self._is_journal = "JOURNAL_STREAM" in os.environ

    def emit(self, record: logging.LogRecord) -> None:
        level = f"<{LEVELS.get(record.levelno, 5)}>" if self._is_journal else ""
        say(level + self._credentials.hide(record.getMessage()), is_error=record.levelno >= logging.ERROR)


def start(command: str, config: Path, spool: Path | None) -> int:
    """Run `run`, `now` or `prove`; every error becomes one sentence and an exit code."""
    leave_no_core_dump()
    credentials = Credentials()
    sync: Sync | None = None
    try:
        setup = load_settings(config, spool)
        file = setup.settings.credentials
        credentials = find_credentials(None if file is None else setup.base / file)
        listen(credentials)
        sync = Sync(setup, credentials)
        return work(command, sync, setup)
    except HangtimeError as error:
        _refuse(credentials, str(error))
        if sync is None and command == "run":
            note_refusal(spool or _spool_of(config), error, credentials)
        return REFUSED
    except OSError as error:
        where = error.filename or "the folder of takes"
        _refuse(credentials, f"{where}: cannot be used ({error.strerror}); check the disk of this device")
        return REFUSED


def note_refusal(spool: Path | None, error: HangtimeError, credentials: Credentials) -> None:
    """Report invalid settings or credentials in the appliance's `status` as the reason why nothing is sent."""
    if spool is None or not spool.is_dir():
        return
    now = now_here().isoformat(timespec="seconds")
    stands = read_status(spool)
    if stands is None:
        stands = SyncStatus(at=now, url="", device="", waiting=0, waiting_bytes=0, safe=0, is_encrypted=False)
    before = stands.fault
    sentence = error.what if error.where is None else f"{error.where}: {error.what}"
    fault = Fault(
        sentence=credentials.hide(sentence), advice=credentials.hide(error.advice),
        since=before.since if before else now, tries=before.tries + 1 if before else 1,
    )  # fmt: skip
    waiting = Spool(spool).waiting()
    write_status(
        spool,
        msgspec.structs.replace(
            stands, at=now, fault=fault, waiting=len(waiting), waiting_bytes=sum(take.size for take in waiting)
        ),
    )


def _spool_of(config: Path) -> Path | None:
    """Return the spool of an invalid configuration file; the default spool belongs to the default file alone."""
    usual = SpoolPart().folder
    return next((one for one in possible_spools(config) if one != usual or config == DEFAULT_FILE), None)


def listen(credentials: Credentials) -> None:
    """Log to stderr."""
    log = logging.getLogger("hangtime.sync")
    log.handlers[:] = [_Journal(credentials)]
    log.setLevel(logging.INFO)
    log.propagate = False


def work(command: str, sync: Sync, setup: SyncSetup) -> int:
    """Run one command; returns its exit code.

    Raises:
        HangtimeError: settings or credentials are invalid, or another process syncs.
        OSError: this device's disk fails.
    """
    if command == "prove":
        try:
            proof = sync.prove()
        except SyncError as fault:
            _refuse(sync.credentials, str(fault))
            return LATER
        if proof is None:
            say(f"hangtime sync: nothing of {setup.spool} is on {setup.settings.url} yet")
            return SAFE
        if proof.is_bad:
            # The journal already has this line.
            know(error=f"take-{proof.sequence:06d} was fetched from the server: {proof.outcome}")
            return REFUSED
        return SAFE
    in_the_way = sync.run() if command == "run" else sync.once()
    if in_the_way is None:
        if command == "now" and not sync.has_asked:  # not for `run`: the unit runs it every two minutes
            say("hangtime sync: no take waits; the server was not asked")
        return SAFE
    _refuse(sync.credentials, str(in_the_way))
    return LATER


def _refuse(credentials: Credentials, sentence: str) -> None:
    """Report the command's error, without keys, on stderr and to `--json`."""
    text = credentials.hide(sentence)
    know(error=text)
    say(f"hangtime sync: {text}", is_error=True)
