"""Checksums, faults and limits of sync, worked out by hand."""

from __future__ import annotations

import errno
import hashlib
import io
import os
from pathlib import Path

import pytest

from capture.sync import server as module
from capture.sync.credentials import Credentials
from capture.sync.faults import fault_of
from capture.sync.pace import Rate
from capture.sync.rounds import _own_disk
from capture.sync.server import FolderServer, Sums, open_server, sums_of
from capture.sync.settings import SyncSettings, SyncSetup


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
