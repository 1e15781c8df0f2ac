"""Checksums, faults and limits of sync, worked out by hand."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from capture.errors import SyncError
from capture.sync import server as module
from capture.sync.credentials import Credentials
from capture.sync.faults import fault_of
from capture.sync.pace import Rate
from capture.sync.rounds import _own_disk
from capture.sync.server import FolderServer, Sums, open_server, sums_of
from capture.sync.settings import SyncSettings, SyncSetup, load_settings
from tests.capture.sync.syncing import folder_of, sync_of


def md5(content):
    return hashlib.md5(content, usedforsecurity=False)


@pytest.mark.parametrize(("size", "parts"), [(0, 1), (9, 1), (10, 1), (11, 2), (20, 2), (25, 3)])
@pytest.mark.parametrize("piece", [3, 10, 64])
def test_an_object_of_several_parts_has_the_md5_of_its_parts_md5s(size, parts, piece, monkeypatch):
    """Parts of 10 bytes, added in pieces of other sizes; an object of one part has the MD5 of its bytes."""
    monkeypatch.setattr(module, "PART", 10)
    content = bytes(range(size))
    sums = Sums()
    for at in range(0, size, piece):
        sums.add(content[at : at + piece])
    whole = md5(b"".join(md5(content[10 * k : 10 * k + 10]).digest() for k in range(parts))).hexdigest()
    assert sums.tag == (md5(content).hexdigest() if parts == 1 else f"{whole}-{parts}")
    assert (sums.sha256, sums.size) == (hashlib.sha256(content).hexdigest(), size)


def test_the_checksums_of_a_file_are_of_all_of_it_and_rewind_it():
    file = io.BytesIO(b"0123456789")
    file.seek(4)
    assert sums_of(file).sha256 == hashlib.sha256(b"0123456789").hexdigest()
    assert file.tell() == 0


@pytest.mark.parametrize(
    ("text", "reason", "advice"),
    [
        ("invalid peer certificate: Expired", "Expired", "set the clock of this device"),
        ("invalid peer certificate: NotValidYet", "NotValidYet", "set the clock of this device"),
        ("invalid peer certificate: NotValidForName", "NotValidForName", "use the name in [sync] that"),
        ("invalid peer certificate: UnknownIssuer", "UnknownIssuer", "give the certificate of the server's own"),
    ],
)
def test_a_certificate_that_is_not_trusted_gets_the_step_for_its_reason(text, reason, advice):
    fault = fault_of(RuntimeError(text), "s3://b")
    assert fault.what == f"this device does not trust the server's certificate ({reason})"
    assert fault.advice.startswith(advice)
    assert fault.kind == "person"


def test_an_answer_without_tls_waits_for_a_person_and_says_what_to_write():
    fault = fault_of(RuntimeError("HTTP error: error: InvalidMessage(\n  InvalidContentType,\n)"), "s3://b")
    assert (fault.what, fault.kind) == ("the server answers, and not in TLS", "person")
    assert fault.advice.startswith("write http:// in endpoint and allow_http = true in [sync]")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("", "500 Internal Server Error"),
        (": <Code>Broken</Code><Message>It fell. Again.</Message>", "500 Broken: It fell"),
        (': {"error": {"code": "Odd", "message": "no luck"}}', "500 Odd: no luck"),
    ],
)
def test_an_answer_is_named_by_its_code_and_else_by_its_status(body, words):
    fault = fault_of(RuntimeError(f"Error - status code: 500 Internal Server Error{body}"), "s3://b")
    assert fault.what == f"the server fails ({words})"


def test_a_file_is_read_back_from_the_disk_and_not_from_memory(tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(os, "posix_fadvise", lambda number, *rest: told.append(rest))
    (tmp_path / "a").write_bytes(b"content")
    assert b"".join(FolderServer(tmp_path, Rate(None)).fetch("a")) == b"content"
    assert told == [(0, 0, os.POSIX_FADV_DONTNEED)]


@pytest.mark.parametrize(
    ("endpoint", "where"), [("https://store.example", "s3://takes at https://store.example"), ("", "s3://takes")]
)
def test_a_bucket_is_named_with_its_endpoint_if_it_has_one(endpoint, where, monkeypatch):
    monkeypatch.setattr(module, "open_bucket", lambda *given, **options: None)
    settings = SyncSettings(url="s3://takes", device="box", endpoint=endpoint)
    assert open_server(SyncSetup(settings, Path("spool")), Credentials({}))._where == where


@pytest.mark.parametrize(("name", "where"), [("/spool/receipts/a", "/spool/receipts/a"), (None, Path("/spool"))])
def test_a_full_disk_of_this_device_is_named_by_the_file_or_else_by_the_folder(name, where):
    fault = _own_disk(OSError(errno.ENOSPC, "No space left on device", name), Path("/spool"))
    assert (fault.what, fault.where) == ("this device cannot write receipts (no space left on device)", where)


def test_takes_that_leave_and_takes_that_changed_are_in_the_journal(tmp_path, spool, monkeypatch, caplog):
    sync, _ = sync_of(folder_of(tmp_path, spool))
    room = SimpleNamespace(left=("take-000001",), changed=("take-000002",))
    monkeypatch.setattr(sync.spool, "make_room", lambda *given, **options: room)
    with caplog.at_level("INFO"):
        sync._leave()
    assert [(one.levelname, one.getMessage()) for one in caplog.records] == [
        ("INFO", "take-000001: left this device; the take is safe on the server"),
        (
            "WARNING",
            "take-000002: stays; the file differs from the one that the server verified: replace the disk",
        ),
    ]


@pytest.mark.parametrize(
    ("number", "what", "kind", "advice"),
    [
        (errno.ENOSPC, "the server's disk is full", "person", "make room there"),
        (errno.EDQUOT, "the server's disk is full", "person", "make room there"),
        (errno.EACCES, "the server's folder cannot be written", "person", "check its owner"),
        (errno.EPERM, "the server's folder cannot be written", "person", "check its owner"),
        (errno.EROFS, "the server's folder cannot be written", "person", "check its owner"),
        (errno.ENOENT, "the server's folder is not there", "person", "mount or make it"),
        (errno.ENOTDIR, "the server's folder is not there", "person", "mount or make it"),
        (errno.EIO, "the server's folder fails", "passing", "the sync service tries again"),
    ],
)
def test_each_fault_of_a_servers_folder_has_its_step_and_says_whether_it_passes(number, what, kind, advice):
    fault = fault_of(OSError(number, "So It Is"), "file:///server")
    assert (fault.what, fault.kind, fault.where) == (f"{what} (so it is)", kind, "file:///server")
    assert fault.advice.startswith(advice)
    assert fault_of(OSError(number, "So", "/server/a"), "file:///server").where == "/server/a"


@pytest.mark.parametrize(
    ("status", "what", "kind"),
    [
        ("301 Moved Permanently", "the server sends this device elsewhere", "person"),
        ("308 Permanent Redirect", "the server sends this device elsewhere", "person"),
        ("400 Bad Request", "the server refuses the request", "person"),
        ("401 Unauthorized", "the server does not accept the keys of this device", "person"),
        ("403 Forbidden", "the server refuses this device", "person"),
        ("404 Not Found", "the server knows no such place", "person"),
        ("408 Request Timeout", "the server asks to wait", "passing"),
        ("413 Payload Too Large", "the server takes no file of this size", "take"),
        ("425 Too Early", "the server asks to wait", "passing"),
        ("429 Too Many Requests", "the server asks to wait", "passing"),
        ("500 Internal Server Error", "the server fails", "passing"),
        ("503 Service Unavailable", "the server asks to wait", "passing"),
        ("507 Insufficient Storage", "the server is full", "person"),
    ],
)
def test_each_status_of_an_answer_says_whether_it_passes(status, what, kind):
    fault = fault_of(RuntimeError(f"Error - status code: {status}"), "s3://b")
    assert (fault.what, fault.kind) == (f"{what} ({status})", kind)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("dns error", "the server's name cannot be found"),
        ("ConnectionRefused", "nothing answers at the server's address"),
        ("kind: TimedOut", "the server does not answer in time"),
        ("NetworkUnreachable", "there is no network"),
        ("ConnectionReset by it", "the connection to the server broke (connection reset)"),
        ("odd", "the connection to the server broke (odd)"),
    ],
)
def test_a_server_that_does_not_answer_is_tried_again(text, what):
    fault = fault_of(RuntimeError(text), "s3://b")
    assert (fault.what, fault.kind) == (what, "passing")
    assert "try again; the sync service does so by itself" in fault.advice


def test_a_request_waits_five_minutes_at_most_unless_told_otherwise():
    assert SyncSettings().timeout_s == 300.0


@pytest.mark.parametrize("name", ["days = 2592000", "quota_bytes = 8"])
def test_a_limit_of_retention_beyond_its_range_is_named_with_its_line(tmp_path, name):
    config = tmp_path / "c.toml"
    config.write_text(f'[spool]\nfolder = "spool"\n[sync]\nurl = "file:///server"\nretention.{name}\n')
    words = f"retention.{name.replace('=', 'is')}; give"
    with pytest.raises(SyncError, match=re.escape(f"c.toml, line 5: [sync] is invalid: {words}")):
        load_settings(config, None)
