"""Takes reach the server once, complete and in order, and are verified there."""

from __future__ import annotations

import hashlib
import random
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta

import pytest

from capture.appliance.receipts import READ_BACK, STORE_CHECKSUM, receipts
from capture.appliance.retention import Retention
from capture.appliance.spool import Spool
from capture.appliance.sync_status import is_syncing, only_sync, read_status, sentences
from capture.errors import SyncError
from capture.sync.rounds import SAME_DISK
from capture.sync.server import PART, sums_of
from capture.sync.settings import SyncSettings, SyncSetup
from formats.archive import read_take
from tests.capture.appliance.spool_takes import record
from tests.capture.sync.servers import Moto, setup_of
from tests.capture.sync.syncing import NOW, check_server, folder_of, on_server, sync_of


@pytest.mark.parametrize("kind", ["folder", "bucket"])
def test_three_takes_are_on_the_server_once_with_receipts_that_say_how_it_was_checked(
    kind, request, tmp_path, spool, three
):
    if kind == "folder":
        setup = folder_of(tmp_path, spool)
    else:
        server, proxy, authority = request.getfixturevalue("far")
        setup = setup_of(spool.folder, proxy, authority)
    sync, waits = sync_of(setup)
    assert (sync.run(), waits) == (None, [])
    assert sync.once() is None  # a second time changes nothing
    check_server(on_server(tmp_path) if kind == "folder" else server.objects(), three)
    assert spool.waiting() == []
    assert [(one.sequence, one.verified) for one in receipts(spool.folder)] == [(k, READ_BACK) for k in (1, 2, 3)]
    status = read_status(spool.folder)
    assert (status.waiting, status.safe, status.fault, status.proof.outcome) == (0, 3, None, "sound")
    assert (SAME_DISK in status.notes) == (kind == "folder")


def test_takes_go_in_the_order_of_their_numbers_whatever_the_clock_said(far, spool):
    server, proxy, authority = far
    for created in ("2026-11-20T10:00:00+00:00", "1970-01-01T00:00:10+00:00", "2031-01-01T00:00:00+00:00"):
        record(spool, 40, created=created)
    order = []
    proxy.fault = lambda method, path: order.append(path) or "" if method == "PUT" else ""
    sync, _ = sync_of(setup_of(spool.folder, proxy, authority))
    assert sync.once() is None
    assert [[*path.split("/")[3:4], path.split("/")[4][:6]] for path in order] == [
        ["2026-11-20", "000001"], ["1970-01-01", "000002"], ["2031-01-01", "000003"],
    ]  # fmt: skip
    assert len(server.objects()) == 3


def test_files_that_an_earlier_run_sent_are_found_and_not_sent_again(far, spool, three):
    """The receipts are lost: three takes are searched for, read back and not sent."""
    server, proxy, authority = far
    setup = setup_of(spool.folder, proxy, authority)
    assert sync_of(setup)[0].once() is None
    for path in (spool.folder / "receipts").iterdir():
        path.unlink()
    proxy.done.clear()
    assert sync_of(setup)[0].once() is None
    assert "PUT" not in {method for method, _ in proxy.done}
    check_server(server.objects(), three)


def test_an_object_that_is_damaged_on_the_server_is_sent_again(far, spool, three):
    server, proxy, authority = far
    setup = setup_of(spool.folder, proxy, authority)
    assert sync_of(setup)[0].once() is None
    (spool.folder / "receipts/take-000002.json").unlink()
    (path,) = (server.root / server.bucket).rglob("000002-*")
    raw = bytearray(path.read_bytes())
    raw[100] ^= 1
    path.write_bytes(raw)
    assert sync_of(setup)[0].once() is None
    check_server(server.objects(), three)


def test_the_settings_hide_a_bucket_below_a_prefix(far, spool, three):
    server, proxy, authority = far
    assert sync_of(setup_of(spool.folder, proxy, authority, url=f"s3://{server.bucket}/home/kitchen"))[0].once() is None
    assert {key.split("/")[0:3:2] == ["home", "box"] for key in server.objects()} == {True}


def keep_large(spool):
    """A fourth take, of 6 MB: it goes in two parts."""
    big = spool.begin()
    big.partial.write_bytes(random.Random(2).randbytes(6_000_000))
    spool.keep(big, {})


def test_a_large_take_goes_in_parts_and_arrives_whole(far, spool, three):
    server, proxy, authority = far
    keep_large(spool)
    sent = []
    proxy.fault = lambda method, path: sent.append(path) or "" if method == "PUT" else ""
    assert sync_of(setup_of(spool.folder, proxy, authority, timeout_s=30.0))[0].once() is None
    objects = server.objects()
    assert len(objects) == 4
    assert {hashlib.sha256(content).hexdigest() in key for key, content in objects.items()} == {True}
    assert ["/000004-" in path for path in sent] == [False, False, False, True, True]


@pytest.mark.slow
def test_moto_takes_them_too(far, spool, three):
    """A second server, which honours conditions and parts."""
    _, _, authority = far
    keep_large(spool)
    with Moto(authority) as moto:
        sync, _ = sync_of(setup_of(spool.folder, moto, authority, timeout_s=30.0))
        assert sync.once() is None
        objects = moto.objects()
    assert len(objects) == 4
    assert {hashlib.sha256(content).hexdigest() in key for key, content in objects.items()} == {True}
    assert [key for key in objects if key.startswith("box/undated/000004-")]


# --- verification -----------------------------------------------------------------------------------


def test_keys_that_may_only_write_are_enough_and_the_status_says_so(far, spool, three):
    """GET and HEAD are refused: the store's checksum of what it received stands in."""
    server, proxy, authority = far
    proxy.fault = lambda method, path: "" if method == "PUT" else "403"
    assert sync_of(setup_of(spool.folder, proxy, authority))[0].once() is None
    assert {one.verified for one in receipts(spool.folder)} == {STORE_CHECKSUM}
    said = sentences(read_status(spool.folder), NOW)
    assert "may only write: takes are verified by the store's checksum" in " ".join(said)
    assert "Last proved: today at 12:00, not possible, the keys of this device may not read." in said
    check_server(server.objects(), three)


def test_a_store_that_may_not_be_read_and_gives_a_wrong_checksum_verifies_nothing(far, spool, three, monkeypatch):
    _, proxy, authority = far
    proxy.fault = lambda method, path: "" if method == "PUT" else "403"
    monkeypatch.setattr("capture.sync.server.Sums.tag", property(lambda self: "0" * 32))
    fault = sync_of(setup_of(spool.folder, proxy, authority))[0].once()
    assert "gives no checksum that can be compared" in fault.what
    assert receipts(spool.folder) == []


def test_a_receipt_that_was_damaged_in_transfer_is_none(far, spool, three):
    _, proxy, authority = far
    proxy.fault = lambda method, path: "damaged answer" if method == "GET" else ""
    fault = sync_of(setup_of(spool.folder, proxy, authority))[0].once()
    assert "the server holds something else than was sent" in fault.what
    assert receipts(spool.folder) == []


def test_the_checksum_of_an_upload_in_parts_is_that_of_the_s3_api(tmp_path):
    """6 MiB of zeros in parts of 5 MiB: MD5 of two MD5s, worked with md5sum."""
    file = tmp_path / "zeros"
    file.write_bytes(bytes(6 << 20))
    with file.open("rb") as opened:
        whole = sums_of(opened)
    first, second = hashlib.md5(bytes(PART)).digest(), hashlib.md5(bytes(1 << 20)).digest()
    assert whole.tag == f"{hashlib.md5(first + second).hexdigest()}-2"


# --- encryption --------------------------------------------------------------------------------------


def test_an_encrypted_take_opens_with_the_key_and_with_nothing_on_the_device(far, spool, three, tmp_path):
    import pyrage

    server, proxy, authority = far
    identity = pyrage.x25519.Identity.generate()
    setup = setup_of(spool.folder, proxy, authority, encrypt_to=(str(identity.to_public()),))
    assert sync_of(setup)[0].once() is None
    objects = server.objects()
    assert len(objects) == 3
    for key, content in objects.items():
        assert key.endswith(".mcap.age")
        assert b"MCAP" not in content
        plain = pyrage.decrypt(content, [identity])
        assert hashlib.sha256(plain).hexdigest() in key
        (tmp_path / "opened.mcap").write_bytes(plain)
        assert read_take(tmp_path / "opened.mcap").is_complete
    assert read_status(spool.folder).proof.outcome == "whole"
    # Sent again after the receipts are lost: still one object a take.
    for path in (spool.folder / "receipts").iterdir():
        path.unlink()
    assert sync_of(setup)[0].once() is None
    assert sorted(server.objects()) == sorted(objects)
    assert str(identity) not in "".join(path.read_text() for path in spool.folder.rglob("*.json"))


@pytest.mark.parametrize(
    ("text", "words"),
    [("AGE-SECRET-KEY-1QQQ", "encrypt_to holds a secret key"), ("age1nonsense", "is no age recipient")],
    ids=["secret", "nonsense"],
)
def test_a_secret_key_or_nonsense_is_no_recipient(tmp_path, spool, text, words):
    with pytest.raises(Exception, match=words):
        sync_of(folder_of(tmp_path, spool, encrypt_to=(text,)))


# --- proof and retention -----------------------------------------------------------------------------


def test_a_take_is_proved_once_a_week_and_the_status_says_which_day(tmp_path, spool, three):
    setup = folder_of(tmp_path, spool)
    assert sync_of(setup)[0].once() is None
    for days, proved in ((6.9, NOW), (7.1, NOW + timedelta(days=7.1))):
        now = NOW + timedelta(days=days)
        assert sync_of(setup, now=now)[0].once() is None
        assert datetime.fromisoformat(read_status(spool.folder).proof.at) == proved.replace(microsecond=0)
    status = read_status(spool.folder)
    assert "Last proved: Wednesday, sound." in sentences(status, NOW + timedelta(days=8))
    assert "Last proved: 2026-12-02, sound." in sentences(status, NOW + timedelta(days=20))


@pytest.mark.parametrize("harm", ["damaged", "missing"])
def test_a_proof_that_finds_damage_says_so_and_the_take_is_sent_again(tmp_path, spool, harm):
    take = record(spool, 40)
    setup = folder_of(tmp_path, spool)
    sync, _ = sync_of(setup)
    assert sync.once() is None
    (path,) = (tmp_path / "server").rglob("*.mcap")
    path.write_bytes(path.read_bytes()[:-1]) if harm == "damaged" else path.unlink()
    assert sync.prove().outcome == harm
    assert (
        f"The server's copy of take 1 is {harm}. Next: check the server's disk"
        in sentences(read_status(spool.folder), NOW)[0]
    )
    assert sync.once() is None
    check_server(on_server(tmp_path), [take])
    assert sync.prove().outcome == "sound"


@pytest.mark.parametrize("is_encrypted", [False, True])
def test_a_server_that_lost_takes_between_two_proofs_gets_them_again_and_none_leaves_meanwhile(
    tmp_path, spool, is_encrypted
):
    """The proof draws one take of six; the five others must not leave for the receipts that they still have."""
    import pyrage

    takes = [record(spool, 40 + k, seed=k) for k in range(6)]
    recipients = (str(pyrage.x25519.Identity.generate().to_public()),) if is_encrypted else ()
    setup = folder_of(tmp_path, spool, encrypt_to=recipients, retention=Retention(least_free_bytes=0))
    assert sync_of(setup)[0].once() is None
    (there,) = (tmp_path / "server/box/2026-11-20").glob("000004-*")
    for path in (tmp_path / "server").rglob("*.mcap*"):
        if path != there:
            path.unlink()
    sync = sync_of(setup)[0]
    while not sync.prove().is_bad:
        pass
    assert [take.sequence for take in spool.waiting()] == [1, 2, 3, 5, 6]
    assert spool.make_room(Retention(quota_bytes=0, least_free_bytes=0), now=NOW).left == ("take-000004",)
    before = there.stat().st_mtime_ns
    assert sync_of(setup)[0].once() is None
    assert len(on_server(tmp_path)) == len(takes)
    assert there.stat().st_mtime_ns == before


def test_verified_takes_leave_the_device_and_are_still_proved(tmp_path, spool, three):
    setup = folder_of(tmp_path, spool, retention=Retention(quota_bytes=0, least_free_bytes=0))
    sync, _ = sync_of(setup)
    assert sync.once() is None
    assert spool.takes() == []
    assert sync.prove().outcome == "sound"
    assert read_status(spool.folder).safe == 3


def test_one_process_syncs_and_who_asks_whether_it_does_is_no_second_one(tmp_path, spool, three):
    """The daemon asks once a second: 300 questions during one run neither stop it nor see it after its end."""
    setup = folder_of(tmp_path, spool)
    with only_sync(spool.folder):
        assert is_syncing(spool.folder)
        with pytest.raises(SyncError, match="another process syncs these takes"):
            sync_of(setup)[0].once()
    with ThreadPoolExecutor(1) as pool:
        asked = pool.submit(lambda: [is_syncing(spool.folder) for _ in range(300)])
        for _ in range(3):
            assert sync_of(setup)[0].once() is None
        asked.result()
    assert not is_syncing(spool.folder)


def test_takes_go_to_a_new_server_when_the_address_changes_and_stay_until_they_are_there(tmp_path, spool, three):
    """The first address is the default, a folder of this very disk; nothing may leave for being safe there."""
    assert sync_of(folder_of(tmp_path, spool))[0].once() is None
    none_stays = Retention(quota_bytes=0, least_free_bytes=0)
    second = SyncSetup(SyncSettings(url=f"file://{tmp_path}/second", device="box", retention=none_stays), spool.folder)
    (tmp_path / "second").write_text("no folder")
    sync, _ = sync_of(second)
    assert sync.once() is not None
    stands = read_status(spool.folder)
    assert (stands.waiting, stands.safe, stands.elsewhere) == (3, 0, 3)
    told = " ".join(sentences(stands, NOW))
    assert "3 takes went to another address before" in told
    assert "0 safe on the server, nothing was synced yet. " in told
    assert "Last proved: never." in told
    assert [take.sequence for take in spool.takes()] == [1, 2, 3]
    (tmp_path / "second").unlink()
    assert sync.once() is None
    objects = {
        str(path.relative_to(tmp_path / "second")): path.read_bytes() for path in (tmp_path / "second").rglob("*.mcap")
    }
    check_server(objects, three)
    assert spool.takes() == []
    assert {one.url for one in receipts(spool.folder)} == {second.settings.url}
    stands = read_status(spool.folder)
    assert (stands.safe, stands.elsewhere) == (3, 0)
    assert stands.proof.outcome == "sound"  # due at once: the first address was proved, not this one


def test_an_address_that_is_named_again_has_the_last_sync_of_its_own_receipts(tmp_path, spool, three):
    """Three takes go to the first address; the second one is named and takes nothing, and the first one comes back."""
    first = folder_of(tmp_path, spool)
    assert sync_of(first)[0].once() is None
    before = read_status(spool.folder)
    (tmp_path / "second").write_text("no folder")
    assert sync_of(SyncSetup(SyncSettings(url=f"file://{tmp_path}/second", device="box"), spool.folder))[0].once()
    assert sync_of(first)[0].once() is None
    after = read_status(spool.folder)
    assert (after.last_sync, after.verified) == (before.last_sync, before.verified) == (NOW.isoformat(), READ_BACK)
    assert (after.fault, after.proof.outcome) == (None, "sound")


def test_a_take_of_another_device_under_a_number_with_a_receipt_is_sent_and_not_considered_safe(tmp_path, spool, three):
    setup = folder_of(tmp_path, spool, retention=Retention(quota_bytes=0, least_free_bytes=0))
    assert sync_of(setup)[0].once() is None
    assert spool.takes() == []
    with Spool(tmp_path / "other") as other:
        foreign = record(other, 90, seed=7)
        foreign.path.rename(spool.folder / foreign.path.name)
    assert [take.sequence for take in spool.waiting()] == [1]
    assert spool.make_room(setup.settings.retention, now=NOW).left == ()
    assert sync_of(setup)[0].once() is None
    assert sum(f"-{foreign.facts['sha256']}" in key for key in on_server(tmp_path)) == 1
