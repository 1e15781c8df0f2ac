"""Every fault of sync gives one sentence, and sync retries after failures of the server."""

from __future__ import annotations

import errno
import os
import random
from pathlib import Path

import pytest

from capture.appliance.sync_status import read_status, sentences
from capture.sync.credentials import Credentials
from capture.sync.faults import fault_of
from capture.sync.pace import LONGEST_WAIT, Rate, wait_after
from tests.capture.sync.servers import FAULTS, KEY, setup_of
from tests.capture.sync.syncing import NOW, check_server, folder_of, on_server, sync_of

SAID = {
    "500": ("the server fails (500 InternalError: We encountered an internal error)", "look into the server's log"),
    "403": ("the server refuses this device (403 AccessDenied: Access Denied)", "allow the keys of this device"),
    "skewed": ("the server refuses the clock of this device (403 RequestTimeTooSkewed", "to a time server"),
    "busy": ("the server asks to wait (503 SlowDown", "nothing"),
    "full": ("the server is full (507 InsufficientStorage: The disk is full)", "make room on the server"),
    "reset before": ("the connection to the server broke", "the sync service does so by itself"),
    "reset in request": ("the connection to the server broke", "the sync service does so by itself"),
    "answer lost": ("the connection to the server broke", "the sync service does so by itself"),
    "silent": ("the server does not answer in time", "a slow one needs a longer timeout_s"),
}  # fmt: skip


@pytest.mark.parametrize("fault", SAID)
def test_the_servers_own_reason_is_one_sentence_with_the_next_action(far, spool, three, fault):
    server, proxy, authority = far
    proxy.fault = lambda method, path: fault if method == "PUT" else ""
    setup = setup_of(spool.folder, proxy, authority)
    patience = {"timeout_s": 1.0} if fault == "silent" else {}
    assert sync_of(setup_of(spool.folder, proxy, authority, **patience))[0].once() is not None
    status = read_status(spool.folder)
    sentence, advice = SAID[fault]
    assert sentence in status.fault.sentence
    assert advice in status.fault.advice
    assert (status.waiting, status.fault.tries) == (3, 1)
    (first, *_) = sentences(status, NOW)
    assert first.startswith("Sync fails: ")
    assert first.count(". Next: ") == 1
    assert "\n" not in first
    # Once the fault is over, all takes arrive and the status no longer reports it.
    proxy.fault = lambda method, path: ""
    assert sync_of(setup)[0].run() is None
    check_server(server.objects(), three)
    assert read_status(spool.folder).fault is None


@pytest.mark.parametrize(
    ("named", "sentence", "advice"),
    [
        ({"endpoint": "https://127.0.0.1:9"}, "nothing answers at the server's address", "start the server"),
        ({"endpoint": "https://no-such-host.invalid"}, "the server's name cannot be found", "check the network"),
        ({"ca": None}, "does not trust the server's certificate (UnknownIssuer)", "the server's own authority as ca"),
        ({"url": "s3://other"}, "the server knows no such place (404 NoSuchBucket", "make the bucket"),
    ],
    ids=["refused", "no-name", "unknown-authority", "no-bucket"],
)  # fmt: skip
def test_a_server_that_cannot_be_spoken_to_is_one_sentence(far, spool, three, named, sentence, advice):
    _, proxy, authority = far
    fault = sync_of(setup_of(spool.folder, proxy, authority, **named))[0].once()
    assert sentence in fault.what
    assert advice in fault.advice


def test_an_address_without_tls_that_is_not_allowed_is_a_users_error(far, spool, three):
    _, proxy, authority = far
    fault = sync_of(setup_of(spool.folder, proxy, authority, endpoint="http://127.0.0.1:9"))[0].once()
    assert fault.what == "http://127.0.0.1:9 is an address without TLS, to which nothing is sent unasked"
    assert (fault.kind, fault.advice[:30]) == ("person", "set allow_http = true in [sync")


def test_keys_that_are_not_set_are_reported_as_such_and_not_as_the_refusal_of_another_server():
    """Without keys the library asks the machine's own cloud for some, whose answer is no server's of ours."""
    text = "Generic S3 error: Error performing PUT http://169.254.169.254/latest - status code: 403 Forbidden: no"
    fault = fault_of(RuntimeError(text), "s3://b")
    assert fault.what == "no keys are set, and this computer has none as a machine of the cloud"
    assert (fault.kind, fault.advice) == ("person", "put the keys into the credentials of sync")


def test_wrong_keys_are_one_sentence_and_none_of_them_is_in_it(far, spool, three):
    _, proxy, authority = far
    wrong = Credentials({"access_key_id": KEY, "secret_access_key": "another-secret"})
    fault = sync_of(setup_of(spool.folder, proxy, authority), wrong)[0].once()
    assert "the server does not accept the keys of this device (403 SignatureDoesNotMatch" in fault.what
    assert KEY not in (spool.folder / "sync-status.json").read_text()


def test_a_server_folder_that_is_full_or_forbidden_is_one_sentence(tmp_path, spool, three, monkeypatch):
    setup = folder_of(tmp_path, spool)
    for number, sentence in ((errno.ENOSPC, "the server's disk is full"), (errno.EROFS, "cannot be written")):
        with monkeypatch.context() as patch:
            patch.setattr(
                "capture.sync.server.make_folders", lambda folder, n=number: _raise(OSError(n, os.strerror(n)))
            )
            fault = sync_of(setup)[0].once()
        assert sentence in fault.what
    assert sync_of(setup)[0].once() is None
    check_server(on_server(tmp_path), three)


def _raise(error):
    raise error


def test_one_take_that_cannot_be_read_does_not_keep_the_others(tmp_path, spool, three, monkeypatch):
    """The second take can be listed and not opened: the others are brought, and the fault names it."""
    opened = Path.open

    def failing(path, *words, **options):
        if path == three[1].path:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return opened(path, *words, **options)

    monkeypatch.setattr(Path, "open", failing)
    fault = sync_of(folder_of(tmp_path, spool))[0].once()
    assert "take-000002.mcap: the take cannot be read" in str(fault)
    assert len(on_server(tmp_path)) == 2


def test_a_take_that_the_disk_changed_is_brought_and_named(tmp_path, spool, three):
    raw = bytearray(three[0].path.read_bytes())
    raw[-40] ^= 1
    three[0].path.write_bytes(raw)
    assert sync_of(folder_of(tmp_path, spool))[0].once() is None
    status = read_status(spool.folder)
    assert status.damaged == (1,)
    assert "changed takes after they were kept: 1. Next: replace the disk." in sentences(status, NOW)[0]


def test_waits_double_up_to_five_minutes_and_half_of_each_is_chance():
    chance = random.Random(0)
    waits = [[wait_after(tries, chance) for _ in range(200)] for tries in (1, 2, 5, 50)]
    for whole, found in zip((2.0, 4.0, 32.0, LONGEST_WAIT), waits, strict=True):
        assert whole / 2 <= min(found) < 0.55 * whole
        assert 0.95 * whole < max(found) <= whole


def test_a_server_that_fails_four_times_is_waited_for_ever_longer(far, spool, three):
    server, proxy, authority = far
    answers = iter(["500", "busy", "reset before", "500"])
    proxy.fault = lambda method, path: next(answers, "") if method == "PUT" else ""
    sync, waits = sync_of(setup_of(spool.folder, proxy, authority))
    assert sync.run() is None
    assert [whole / 2 <= wait <= whole for whole, wait in zip((2, 4, 8, 16), waits, strict=True)] == [True] * 4
    check_server(server.objects(), three)


def test_a_rate_of_1000_bytes_a_second_sends_5000_bytes_in_5_seconds():
    now = [100.0]
    rate = Rate(1000.0, clock=lambda: now[0], sleep=lambda seconds: now.__setitem__(0, now[0] + seconds))
    for _ in range(6):
        rate.wait_for(1000)
    assert now[0] == pytest.approx(105.0)


def test_every_fault_of_the_proxy_is_one_that_the_rounds_meet():
    assert len(FAULTS) == len(set(FAULTS)) == 13
