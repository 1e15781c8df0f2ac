"""Sync in words: of its status file, of its command, of the journal and in the appliance's status."""

from __future__ import annotations

import json
import logging
import os
import time
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import msgspec
import pytest

import capture.sync.process as module
from capture.appliance.log import LOG, log_to_stderr
from capture.appliance.receipts import STORE_CHECKSUM
from capture.appliance.sync_news import SyncNews
from capture.appliance.sync_status import (
    FILE,
    LOCK,
    Fault,
    Proof,
    SyncStatus,
    day_of,
    is_syncing,
    only_sync,
    proved,
    read_status,
    sentences,
    write_status,
)
from capture.errors import SyncError
from capture.sync.credentials import Credentials
from capture.sync.process import LATER, REFUSED, SAFE, listen, note_refusal, work
from capture.sync.proof import is_due

NOW = datetime(2026, 11, 25, 12, tzinfo=UTC)  # a Wednesday
AT = "2026-11-25T09:30:00+00:00"
PLAIN = SyncStatus(at=AT, url="s3://b", device="box", waiting=1, waiting_bytes=5, safe=3, is_encrypted=False)


def status(**given):
    return msgspec.structs.replace(PLAIN, **given)


def proof(outcome, sequence=4):
    return Proof(at=AT, sequence=sequence, outcome=outcome)


def test_without_a_status_sync_has_not_run():
    assert sentences(None, NOW) == ["Sync has not run yet. Next: `hangtime sync now`, or wait for its timer."]


def test_a_quiet_status_is_two_sentences():
    assert sentences(PLAIN, NOW) == [
        "1 take waits, 3 safe on the server, nothing was synced yet.", "Last proved: never.",
    ]  # fmt: skip
    assert sentences(status(waiting=2, last_sync=AT), NOW)[0] == (
        "2 takes wait, 3 safe on the server, last sync: today at 09:30."
    )


def test_a_status_with_everything_says_it_in_order_of_urgency():
    full = status(
        fault=Fault(sentence="no network", advice="check the cable", since=AT, tries=2), damaged=(7, 9),
        proof=proof("missing"), elsewhere=1, verified=STORE_CHECKSUM, is_encrypted=True, notes=("A note.",),
    )  # fmt: skip
    assert [sentence.split(":")[0].split(" of take")[0][:36] for sentence in sentences(full, NOW)] == [
        "Sync fails", "The disk of this device changed take", "The server's copy",
        "1 take waits, 3 safe on the server, ",
        "1 take went to another address befor", "Last proved", "The keys of this device may only wri",
        "Takes are encrypted before upload; t", "A note.",
    ]  # fmt: skip
    assert "after they were kept: 7, 9." in sentences(full, NOW)[1]
    assert "take 4 is missing. " in sentences(full, NOW)[2]


@pytest.mark.parametrize(
    ("ago", "said"),
    [
        (timedelta(hours=12), "today at 00:00"),
        (timedelta(hours=13), "Tuesday"),
        (timedelta(days=7, seconds=-1), "Wednesday"),
        (timedelta(days=7), "2026-11-18"),
        (timedelta(days=-1), "2026-11-26"),
    ],
)
def test_a_time_is_today_or_a_day_of_the_last_week_or_a_date(ago, said):
    assert day_of((NOW - ago).isoformat(), NOW) == said


def test_a_time_that_is_none_is_unknown():
    assert [day_of(at, NOW) for at in ("soon", None, "")] == ["at an unknown time"] * 3


@pytest.mark.parametrize(
    ("outcome", "is_bad", "said"),
    [
        ("sound", False, "sound"),
        ("whole", False, "its hash is right; the encrypted take was not opened"),
        ("damaged", True, "DAMAGED"),
        ("missing", True, "MISSING"),
        ("refused", False, "not possible, the keys of this device may not read"),
    ],
)
def test_each_outcome_of_a_proof_is_said_and_two_are_bad(outcome, is_bad, said):
    assert proved(proof(outcome), NOW) == f"today at 09:30, {said}"
    assert proof(outcome).is_bad is is_bad


@pytest.mark.parametrize(
    ("last", "due"),
    [
        (None, True),
        (NOW - timedelta(days=2), True),
        (NOW - timedelta(days=2, seconds=-1), False),
        (NOW, False),
        (NOW + timedelta(seconds=1), True),
        ("soon", True),
        ("2026-11-25T09:30:00", True),  # no offset: of a clock that nobody knows
    ],
)
def test_a_proof_is_due_after_its_days_and_when_its_date_cannot_be(last, due):
    at = last if isinstance(last, str) or last is None else last.isoformat()
    assert is_due(None if at is None else Proof(at=at, sequence=1, outcome="sound"), 2.0, NOW) is due


# --- the appliance's view -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("written", "said"),
    [
        (PLAIN, ""),
        (status(proof=proof("sound")), ""),
        (status(proof=proof("damaged")), "s3://b: the server's copy of take 4 is damaged; check the server's disk"),
        (status(damaged=(7, 9)), "this device's disk changed takes after they were kept: 7, 9; replace the disk"),
        (
            status(fault=Fault(sentence="no network", advice="check the cable", since=AT, tries=2), damaged=(7,)),
            "takes are not sent: no network; check the cable",
        ),
    ],
)
def test_the_appliance_reports_the_most_urgent_fault_of_sync(tmp_path, written, said):
    news = SyncNews(tmp_path)
    news.look()
    assert (news.error, news.is_sending, news.for_status()["status"]) == (None, False, None)
    write_status(tmp_path, written)
    news.look()
    assert said in str(news.error) if said else news.error is None


def test_the_appliances_status_has_syncs_sentences_and_times_and_a_status_that_goes_is_forgotten(tmp_path):
    write_status(tmp_path, status(last_sync=AT, proof=proof("sound")))
    news = SyncNews(tmp_path)
    news.look()
    told = news.for_status()
    assert (told["last_sync"], told["status"]["safe"], told["is_sending"]) == (AT, 3, False)
    assert told["last_proof"].endswith(", sound")
    assert told["says"][0].startswith("1 take waits, 3 safe")
    json.dumps(told)
    with only_sync(tmp_path):
        news.look()
        assert news.is_sending
    (tmp_path / FILE).unlink()
    news.look()
    assert (news.is_sending, news.for_status()["last_sync"]) == (False, None)


def test_a_second_sync_is_refused_after_half_a_second_and_a_look_at_the_lock_disturbs_none(tmp_path):
    assert not is_syncing(tmp_path)
    with only_sync(tmp_path):
        begun = time.monotonic()
        with (
            pytest.raises(SyncError, match="another process syncs these takes; wait until it ends"),
            only_sync(tmp_path),
        ):
            pass
        assert 0.4 < time.monotonic() - begun < 20  # 24 waits of 20 ms, on a busy machine
        assert is_syncing(tmp_path)
    assert (tmp_path / LOCK).stat().st_mode & 0o777 == 0o644 & ~_umask()
    assert not is_syncing(tmp_path)
    with only_sync(tmp_path):
        pass


def _umask():
    now = os.umask(0)
    os.umask(now)
    return now


# --- the command --------------------------------------------------------------------------------


def sync_like(**given):
    """A sync whose outcome the test sets; `work` asks nothing else of it."""
    credentials = Credentials()
    return SimpleNamespace(credentials=credentials, **given)


SETUP = SimpleNamespace(spool="spool", settings=SimpleNamespace(url="s3://b"))


@pytest.mark.parametrize(
    ("found", "code", "out", "err"),
    [
        (lambda: None, SAFE, "nothing of spool is on s3://b yet", ""),
        (lambda: proof("sound"), SAFE, "", ""),
        (lambda: proof("refused"), SAFE, "", ""),
        (lambda: proof("damaged"), REFUSED, "", ""),
    ],
)
def test_a_proof_has_its_exit_code(capsys, found, code, out, err):
    assert work("prove", sync_like(prove=found), SETUP) == code
    said = capsys.readouterr()
    assert out in said.out + said.err


def test_a_proof_that_cannot_be_made_now_may_be_tried_again(capsys):
    def prove():
        raise SyncError("no network", where="s3://b", advice="check the cable")

    assert work("prove", sync_like(prove=prove), SETUP) == LATER
    assert "hangtime sync: s3://b: no network; check the cable" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("command", "has_asked", "says"), [("now", False, True), ("now", True, False), ("run", False, False)]
)
def test_only_an_upload_by_hand_says_that_nothing_waits(capsys, command, has_asked, says):
    assert work(command, sync_like(run=lambda: None, once=lambda: None, has_asked=has_asked), SETUP) == SAFE
    said = capsys.readouterr()
    assert ("no take waits" in said.out + said.err) is says


@pytest.mark.parametrize(("command", "word"), [("run", "ran"), ("now", "once")])
def test_what_is_in_the_way_is_said_and_may_be_tried_again(capsys, command, word):
    assert work(command, sync_like(run=lambda: "ran", once=lambda: "once"), SETUP) == LATER
    assert f"hangtime sync: {word}\n" in capsys.readouterr().err


def test_a_refusal_is_noted_once_more_each_time_and_since_the_first(tmp_path, monkeypatch):
    error = SyncError("it is no address", where="sync.url", advice="give another")
    for minute in (1, 2):
        now = datetime(2026, 11, 25, 12, minute, 3, 456, tzinfo=UTC)
        monkeypatch.setattr(module, "now_here", lambda now=now: now)
        note_refusal(tmp_path, error, Credentials())
    noted = read_status(tmp_path)
    assert noted.at == "2026-11-25T12:02:03+00:00"
    assert noted.fault == Fault(
        sentence="sync.url: it is no address", advice="give another", since="2026-11-25T12:01:03+00:00", tries=2
    )
    assert (noted.waiting, noted.waiting_bytes, noted.safe) == (0, 0, 0)
    note_refusal(tmp_path / "none", error, Credentials())
    note_refusal(None, error, Credentials())
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(("stream", "begin"), [("8:1", "<{}>"), (None, "")])
def test_the_journal_gets_priorities_and_a_terminal_does_not(capsys, monkeypatch, stream, begin):
    monkeypatch.delenv("JOURNAL_STREAM", raising=False)
    if stream:
        monkeypatch.setenv("JOURNAL_STREAM", stream)
    log = logging.getLogger("hangtime.sync")
    before = (log.handlers[:], log.level, log.propagate), (LOG.handlers[:], LOG.level, LOG.propagate)
    try:
        listen(Credentials())
        log.info("sent")
        log.debug("unsaid")
        log.error("failed")
        log_to_stderr()
        LOG.warning("%s:\nslow", "disk")
        LOG.debug("unsaid")
    finally:
        for one, (handlers, level, propagate) in zip((log, LOG), before, strict=True):
            one.handlers[:], one.propagate = handlers, propagate
            one.setLevel(level)
    said = capsys.readouterr()
    assert "unsaid" not in said.out + said.err
    assert f"{begin.format(6)}sent\n" in said.err
    assert f"{begin.format(3)}failed\n" in said.err
    assert ("<4>disk: slow\n" if stream else "disk:\nslow\n") in said.err
