"""Uploads to Google's and Azure's stores, simulated by fake-gcs-server and Azurite.

`scripts/setup --with-stores` installs both; other places of the two programs go into HANGTIME_FAKE_GCS_SERVER and
HANGTIME_AZURITE. Neither checks a key's permissions, and both are used without TLS.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import hmac
import http.client
import io
import json
import os
import random
import shutil
import subprocess
import threading
from contextlib import contextmanager
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from capture.appliance.receipts import READ_BACK, receipts
from capture.appliance.sync_status import read_status
from capture.sync.credentials import Credentials
from capture.sync.server import PART, ReadRefusedError, open_server
from capture.sync.settings import SyncSettings, SyncSetup
from fit.batch.store import open_store
from tests.capture.sync.servers import HOST, free_port, wait_until_listening
from tests.capture.sync.syncing import check_server, sync_of

pytestmark = pytest.mark.slow  # a server's start takes seconds
ROOT = Path(__file__).parents[3]
ACCOUNT = "devstoreaccount1"  # Azurite's well-known account and key (its documentation, "Default storage account")
ACCOUNT_KEY = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw=="
API = "2021-08-06"  # of Azure's protocol, which this test itself speaks


def program(variable, *places):
    """Return where a program is, or skip the test."""
    named = os.environ.get(variable)
    found = [path for place in places for path in sorted(ROOT.glob(place))]
    for path in [*([Path(named)] if named else []), *found]:
        if path.exists():
            return path
    pytest.skip(f"neither {variable} nor `scripts/setup --with-stores` names the program")


@contextmanager
def running(*words, port):
    process = subprocess.Popen([*map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_until_listening(port)
        yield
    finally:
        process.kill()
        process.wait()


def asked(port, method, path, body, headers):
    """Send a request and return its answer and content."""
    with contextlib.closing(http.client.HTTPConnection(HOST, port)) as connection:
        connection.request(method, path, body or None, headers)
        answer = connection.getresponse()
        return answer, answer.read()


class Signed(BaseHTTPRequestHandler):
    """Forwards requests, and adds parts of Google's XML interface that fake-gcs-server lacks.

    The server takes a plain upload only where its address looks signed, and answers it without the ETag, which is the
    content's MD5 (Cloud Storage, "XML API headers").
    """

    protocol_version = "HTTP/1.1"
    behind = 0

    def _pass_on(self):
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        path = self.path + ("?X-Goog-Algorithm=none" if self.command == "PUT" else "")
        headers = {name: value for name, value in self.headers.items() if name.lower() != "content-length"}
        answer, content = asked(self.behind, self.command, path, body, headers)
        self.send_response(answer.status)
        for name, value in answer.getheaders():
            if name.lower() not in ("transfer-encoding", "connection", "content-length", "date"):
                self.send_header(name, value)
        if self.command == "PUT":
            self.send_header("ETag", f'"{hashlib.md5(body).hexdigest()}"')
        length = answer.getheader("Content-Length", "0") if self.command == "HEAD" else len(content)
        self.send_header("Content-Length", str(length))
        self.end_headers()
        self.wfile.write(content)

    do_GET = do_PUT = do_HEAD = _pass_on  # noqa: N815

    def log_message(self, *_):
        pass


@contextmanager
def signed(port):
    """Run the proxy in front of fake-gcs-server; yield its port."""
    server = ThreadingHTTPServer((HOST, 0), type("Before", (Signed,), {"behind": port}))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()


class Google:
    """A bucket of fake-gcs-server, which keeps it in memory."""

    url = "gs://takes"
    endpoint = None

    def __init__(self, port, before):
        self._port = port
        service = {"gcs_base_url": f"http://{HOST}:{before}", "disable_oauth": True}
        service |= dict.fromkeys(("client_email", "private_key", "private_key_id"), "")
        self.keys = {"service_account_key": json.dumps(service)}
        self._ask("POST", "/storage/v1/b?project=p", json.dumps({"name": "takes"}).encode())

    def objects(self):
        listed = json.loads(self._ask("GET", "/storage/v1/b/takes/o"))
        names = [one["name"] for one in listed.get("items", [])]
        return {name: self._ask("GET", f"/storage/v1/b/takes/o/{name.replace('/', '%2F')}?alt=media") for name in names}

    def _ask(self, method, path, body=b""):
        answer, content = asked(self._port, method, path, body, {"Content-Type": "application/json"})
        assert answer.status == 200, content
        return content


class Azure:
    """A container of Azurite, which keeps it in memory and checks signatures."""

    url = "az://takes"

    def __init__(self, port):
        self._port = port
        self.endpoint = f"http://{HOST}:{port}/{ACCOUNT}"
        self.keys = {"account_name": ACCOUNT, "account_key": ACCOUNT_KEY}
        self._ask("PUT", "/takes", "restype=container")

    def objects(self):
        listing = self._ask("GET", "/takes", "restype=container&comp=list").decode()
        names = [part.split("</Name>")[0] for part in listing.split("<Name>")[1:]]
        return {name: self._ask("GET", f"/takes/{name}", "") for name in names}

    def _ask(self, method, path, query):
        """Send a request signed with the shared key (Azure, "Authorize with Shared Key", version of 2015-02-21)."""
        headers = {"x-ms-date": formatdate(usegmt=True), "x-ms-version": API}
        said = "".join(f"{name}:{value}\n" for name, value in sorted(headers.items()))
        said += f"/{ACCOUNT}/{ACCOUNT}{path}"
        said += "".join("\n" + pair.replace("=", ":") for pair in sorted(query.split("&")) if pair)
        signed = hmac.digest(base64.b64decode(ACCOUNT_KEY), f"{method}{12 * chr(10)}{said}".encode(), "sha256")
        headers["Authorization"] = f"SharedKey {ACCOUNT}:{base64.b64encode(signed).decode()}"
        answer, content = asked(self._port, method, f"/{ACCOUNT}{path}" + (f"?{query}" if query else ""), b"", headers)
        assert answer.status in (200, 201), content
        return content


@pytest.fixture(scope="module", params=["Google", "Azure"])
def store(request, tmp_path_factory):
    port = free_port()
    if request.param == "Google":
        server = program("HANGTIME_FAKE_GCS_SERVER", ".venv-stores/**/fake-gcs-server-linux-*")
        with signed(port) as before:
            words = (
                server,
                "-scheme",
                "http",
                "-host",
                HOST,
                "-port",
                port,
                "-backend",
                "memory",
                "-external-url",
                f"http://{HOST}:{port}",
                "-public-host",
                f"{HOST}:{before}",
            )
            with running(*words, port=port):
                yield Google(port, before)
        return
    server = program("HANGTIME_AZURITE", ".venv-stores/node_modules/.bin/azurite-blob")
    if shutil.which("node") is None:
        pytest.skip("Azurite needs node")
    words = ("node", server, "--blobHost", HOST, "--blobPort", port, "--inMemoryPersistence", "--silent",
             "--skipApiVersionCheck", "--disableTelemetry")  # fmt: skip
    with running(*words, port=port):
        yield Azure(port)


def setup_of_store(store, spool, **named):
    settings = {"url": store.url, "endpoint": store.endpoint, "device": "box", "allow_http": True, **named}
    return SyncSetup(SyncSettings(**settings), spool)


def test_three_takes_come_to_it_once_and_are_read_back_and_proved(store, spool, three):
    sync, waits = sync_of(setup_of_store(store, spool.folder), Credentials(store.keys))
    assert (sync.run(), waits) == (None, [])
    assert sync.once() is None
    check_server({key: content for key, content in store.objects().items() if key.startswith("box/")}, three)
    assert [(one.sequence, one.verified) for one in receipts(spool.folder)] == [(k, READ_BACK) for k in (1, 2, 3)]
    status = read_status(spool.folder)
    assert (status.waiting, status.safe, status.fault, status.proof.outcome) == (0, 3, None, "sound")


def test_a_prefix_of_the_address_is_a_prefix_of_the_names_and_the_night_finds_the_takes(
    store, spool, three, monkeypatch
):
    url = f"{store.url}/home/kitchen"
    setup = setup_of_store(store, spool.folder, url=url)
    assert sync_of(setup, Credentials(store.keys))[0].once() is None
    names = sorted(name for name in store.objects() if name.startswith("home/"))
    assert [name.split("/")[:3] for name in names] == [["home", "kitchen", "box"]] * 3
    names_there = {"service_account_key": "GOOGLE_SERVICE_ACCOUNT_KEY"}
    for name, value in store.keys.items():
        monkeypatch.setenv(names_there.get(name, f"AZURE_STORAGE_{name}".upper()), value)
    if store.endpoint:
        monkeypatch.setenv("AZURE_STORAGE_ENDPOINT", store.endpoint)
        monkeypatch.setenv("AZURE_ALLOW_HTTP", "true")
    night = open_store(url)
    assert sorted(f"home/kitchen/{name}" for name in night.names("", ".mcap")) == names


def test_an_upload_in_parts_arrives_whole(store, spool):
    if isinstance(store, Google):
        pytest.skip("fake-gcs-server knows no uploads in parts of Google's XML interface")
    server = open_server(setup_of_store(store, spool.folder), Credentials(store.keys))
    content = random.Random(1).randbytes(2 * PART + 12345)
    tag = server.send("large", io.BytesIO(content), len(content))
    assert server.size("large") == len(content)
    assert hashlib.sha256(b"".join(server.fetch("large"))).digest() == hashlib.sha256(content).digest()
    assert tag
    assert server.size("absent") is None


def test_without_the_right_to_read_nothing_is_called_safe_on_a_store_without_comparable_checksums(
    store, spool, three, monkeypatch
):
    """Azure answers an upload with a number of its own. Google's MD5 would be this test's own."""
    if isinstance(store, Google):
        pytest.skip("the ETag is made up here")

    def forbidden(*_):
        raise ReadRefusedError("the server does not let this device read", where="a", kind="person", advice="b")

    monkeypatch.setattr("capture.sync.server.BucketServer.size", forbidden)
    monkeypatch.setattr("capture.sync.server.BucketServer.fetch", forbidden)
    sync, _ = sync_of(setup_of_store(store, spool.folder, url=f"{store.url}/mute"), Credentials(store.keys))
    assert "gives no checksum that can be compared" in str(sync.once())
    assert receipts(spool.folder) == []
    assert len(spool.waiting()) == 3
