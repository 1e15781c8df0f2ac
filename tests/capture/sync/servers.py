"""Servers for tests of sync: rclone's and moto's S3 over TLS, and a proxy that simulates network faults."""

from __future__ import annotations

import contextlib
import http.client
import re
import shutil
import socket
import ssl
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import trustme

from capture.sync.credentials import Credentials
from capture.sync.settings import SyncSettings, SyncSetup

PROGRAMS = Path(sys.executable).parent
KEY, SECRET = "AKIAPLAINNAME", "canary-4f1c9b7e2d"
CREDENTIALS = Credentials({"access_key_id": KEY, "secret_access_key": SECRET})
HOST = "127.0.0.1"
UNSIGNED = "AWS4-HMAC-SHA256 Credential=a/20260101/us-east-1/s3/aws4_request, SignedHeaders=host, Signature=x"
XML = "<?xml version='1.0'?><Error><Code>{}</Code><Message>{}</Message></Error>"
ANSWERS = {
    "500": ("500 Internal Server Error", XML.format("InternalError", "We encountered an internal error.")),
    "403": ("403 Forbidden", XML.format("AccessDenied", "Access Denied")),
    "skewed": ("403 Forbidden", XML.format("RequestTimeTooSkewed", "The difference is too large.")),
    "busy": ("503 Service Unavailable", XML.format("SlowDown", "Please reduce your request rate.")),
    "full": ("507 Insufficient Storage", XML.format("InsufficientStorage", "The disk is full.")),
}
RESETS = ("reset before", "reset in request", "answer lost", "reset in answer")
OTHERS = ("slow", "silent", "damaged answer", "damaged request")
BUCKETS = 100  # made before the server starts, which remembers for minutes what a folder held
FAULTS = (*ANSWERS, *RESETS, *OTHERS)


def free_port() -> int:
    with socket.socket() as one:
        one.bind((HOST, 0))
        return one.getsockname()[1]


def wait_until_listening(port: int, seconds: float = 600.0) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        with socket.socket() as one:
            if one.connect_ex((HOST, port)) == 0:
                return
        time.sleep(0.02)
    raise AssertionError(f"nothing listens at {port} after {seconds:g} s")


@dataclass(frozen=True)
class Authority:
    """A private certificate authority and a certificate that it signed."""

    ca: Path
    certificate: Path
    key: Path

    @classmethod
    def make(cls, folder: Path) -> Authority:
        folder.mkdir(parents=True, exist_ok=True)
        authority = trustme.CA()
        issued = authority.issue_cert(HOST, "localhost")
        made = cls(folder / "ca.pem", folder / "certificate.pem", folder / "key.pem")
        authority.cert_pem.write_to_path(made.ca)
        made.certificate.write_bytes(b"".join(blob.bytes() for blob in issued.cert_chain_pems))
        issued.private_key_pem.write_to_path(made.key)
        return made


class Rclone:
    """An S3 server on a folder whose subfolders are buckets; it checks signatures and ignores If-None-Match."""

    def __init__(self, root: Path, authority: Authority) -> None:
        self.root, self.port, self._authority = root, free_port(), authority
        self.bucket = "takes"
        for bucket in ("takes", *(f"takes-{k}" for k in range(BUCKETS))):
            (root / bucket).mkdir(parents=True, exist_ok=True)
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        program = shutil.which("rclone", path=str(PROGRAMS)) or "rclone"
        self._process = subprocess.Popen(
            [program, "serve", "s3", str(self.root), "--addr", f"{HOST}:{self.port}", "--auth-key", f"{KEY},{SECRET}",
             "--cert", str(self._authority.certificate), "--key", str(self._authority.key), "--config", ""],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        wait_until_listening(self.port)

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def objects(self) -> dict[str, bytes]:
        top = self.root / self.bucket
        return {str(path.relative_to(top)): path.read_bytes() for path in sorted(top.rglob("*")) if path.is_file()}

    def __enter__(self) -> Rclone:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


class Moto:
    """Moto's S3 server: it honours conditional requests and forgets everything when it is killed."""

    def __init__(self, authority: Authority) -> None:
        self.port, self.bucket, self._authority = free_port(), "takes", authority

    def __enter__(self) -> Moto:
        self._process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-m", "moto.server", "-H", HOST, "-p", str(self.port), "-s", "-c",
             str(self._authority.certificate), "-k", str(self._authority.key)],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        wait_until_listening(self.port)
        self._request("PUT", "/takes")
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def objects(self) -> dict[str, bytes]:
        listing = self._request("GET", "/takes?list-type=2").decode()
        return {key: self._request("GET", f"/takes/{key}") for key in re.findall(r"<Key>([^<]*)</Key>", listing)}

    def _request(self, method: str, path: str) -> bytes:
        context = ssl.create_default_context(cafile=str(self._authority.ca))
        connection = http.client.HTTPSConnection(HOST, self.port, context=context)
        connection.request(method, path, headers={"Authorization": UNSIGNED})
        answer = connection.getresponse().read()
        connection.close()
        return answer


class Proxy:
    """A proxy that applies `fault` to each request to a server; "" forwards the request."""

    def __init__(self, server: Rclone, authority: Authority) -> None:
        self.fault: Callable[[str, str], str] = lambda method, path: ""
        self.done: list[tuple[str, str]] = []  # method and fault of each request
        self._server = server
        self._inwards = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._inwards.load_cert_chain(authority.certificate, authority.key)
        self._outwards = ssl.create_default_context(cafile=str(authority.ca))
        self._listener = socket.create_server((HOST, 0), backlog=50)
        self.port = self._listener.getsockname()[1]

    @property
    def bucket(self) -> str:
        return self._server.bucket

    def __enter__(self) -> Proxy:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                plain, _ = self._listener.accept()
                threading.Thread(target=self._serve, args=(plain,), daemon=True).start()

    def _serve(self, plain: socket.socket) -> None:
        plain.settimeout(60.0)
        closed = contextlib.suppress(OSError, ValueError)
        with closed, plain, self._inwards.wrap_socket(plain, server_side=True) as client:
            head, body = _head_of(client)
            lines = head.decode("latin-1").split("\r\n")
            method, path, _ = lines[0].split(" ", 2)
            fault = self.fault(method, path)
            self.done.append((method, fault))
            length = next((int(x.split(":")[1]) for x in lines if x.lower().startswith("content-length:")), 0)
            self._do(client, fault, head, body, length)
            client.unwrap()

    def _do(self, client: ssl.SSLSocket, fault: str, head: bytes, body: bytes, length: int) -> None:
        if fault == "reset before":
            return _reset(client)
        if fault == "reset in request":
            while len(body) < length // 2:
                body += client.recv(4096)
            return _reset(client)
        while len(body) < length:
            body += client.recv(65536)
        if fault in ANSWERS:
            status, words = ANSWERS[fault]
            body = b"" if head.startswith(b"HEAD") else words.encode()
            client.sendall(
                f"HTTP/1.1 {status}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n".encode() + body
            )
            return None
        if fault == "silent":
            with contextlib.suppress(OSError):
                client.recv(1)  # until the client gives up
            return _reset(client)
        if fault == "damaged request" and body:
            body = body[:-1] + bytes([body[-1] ^ 1])
        try:
            answer = self._ask(head, body)
        except OSError:  # no server behind
            return _reset(client)
        if fault == "answer lost":
            return _reset(client)
        if fault == "reset in answer":
            client.sendall(answer[: len(answer) // 2])
            return _reset(client)
        if fault == "damaged answer" and not answer.endswith(b"\r\n\r\n"):
            answer = answer[:-1] + bytes([answer[-1] ^ 1])
        if fault == "slow":
            for start in range(0, len(answer), 1024):
                client.sendall(answer[start : start + 1024])
                time.sleep(0.02)
            return None
        client.sendall(answer)
        return None

    def _ask(self, head: bytes, body: bytes) -> bytes:
        plain = socket.create_connection((HOST, self._server.port), timeout=30)
        with plain, self._outwards.wrap_socket(plain, server_hostname=HOST) as server:
            server.sendall(head[:-2] + b"Connection: close\r\n\r\n" + body)
            answer = b""
            while piece := server.recv(65536):
                answer += piece
        return answer


def _head_of(client: ssl.SSLSocket) -> tuple[bytes, bytes]:
    said = b""
    while b"\r\n\r\n" not in said:
        piece = client.recv(65536)
        if not piece:
            raise ValueError("no request")
        said += piece
    head, _, body = said.partition(b"\r\n\r\n")
    return head + b"\r\n\r\n", body


def _reset(client: ssl.SSLSocket) -> None:
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def setup_of(spool: Path, server: Rclone | Moto | Proxy, authority: Authority, **named: object) -> SyncSetup:
    """Return the setup of sync for a server on this machine."""
    settings = SyncSettings(
        **{
            "url": f"s3://{server.bucket}", "endpoint": f"https://{HOST}:{server.port}", "region": "us-east-1",
            "ca": authority.ca, "device": "box", "timeout_s": 30.0, **named,
        }
    )  # fmt: skip
    return SyncSetup(settings, spool)


@contextlib.contextmanager
def chain(folder: Path) -> Iterator[tuple[Rclone, Proxy, Authority]]:
    """rclone behind the proxy."""
    authority = Authority.make(folder / "authority")
    with Rclone(folder / "s3", authority) as server, Proxy(server, authority) as proxy:
        yield server, proxy, authority
