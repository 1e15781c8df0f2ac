"""The server that stores takes: a folder or a bucket behind one small interface.

Uploads are atomic: in a folder, a temporary file is written, synced and renamed; a bucket shows an upload when it is
complete. An object's key depends on its content, so that a repeated upload writes the same object.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, Protocol

from capture.appliance.spool import PIECE
from capture.sync.credentials import Credentials
from capture.sync.faults import ReadRefusedError, ServerError, fault_of
from capture.sync.pace import Rate
from capture.sync.settings import SyncSetup
from formats.store_address import folder_of, open_bucket, without_secrets
from formats.whole_files import make_folders, read_bounded, sync_folder

PART = 5 << 20  # bytes: the smallest part of an upload in parts that S3 accepts
CONNECT_TIMEOUT = "10s"


class Server(Protocol):
    """A store of objects by key; every method raises ServerError."""

    def size(self, key: str) -> int | None:
        """Return an object's size [bytes], None if there is none; ReadRefusedError if the keys forbid the query."""
        ...

    def send(self, key: str, content: IO[bytes], size: int) -> str | None:
        """Upload an object; return the store's own checksum of the received content, if it gives one."""
        ...

    def fetch(self, key: str) -> Iterator[bytes]:
        """Yield an object's content; ReadRefusedError if the keys forbid it, FileNotFoundError if it is missing."""
        ...


def open_server(setup: SyncSetup, credentials: Credentials) -> Server:
    """Open the server of the settings. No request is sent before its first use.

    Raises:
        AddressError: the address or a setting is refused.
        SyncError: the certificate of the server's authority cannot be read.
    """
    settings = setup.settings
    rate = Rate(settings.bytes_per_second)
    folder = folder_of(settings.url)
    if folder is not None:
        return FolderServer(setup.base / folder, rate)
    config = dict(credentials.values)
    client: dict[str, Any] = {"connect_timeout": CONNECT_TIMEOUT, "timeout": f"{settings.timeout_s * 1000:.0f}ms"}
    if settings.url.startswith("s3"):
        config["checksum_algorithm"] = "sha256"  # a store that supports it rejects content that was damaged in transit
        for name in ("endpoint", "region"):
            if value := getattr(settings, name):
                config[name] = value
    elif settings.endpoint:
        config["endpoint" if settings.url.startswith(("az", "abfs")) else "base_url"] = settings.endpoint
    if settings.allow_http:
        client["allow_http"] = True
    if settings.ca is not None:
        client["root_certificate"] = _certificate(setup.base / settings.ca)
    store = open_bucket(settings.url, extra="capture", config=config, client=client, retries=0)
    where = f"{settings.url} at {settings.endpoint}" if settings.endpoint else settings.url
    return BucketServer(store, rate, without_secrets(where))


def _certificate(file: Path) -> bytes:
    from capture.errors import SyncError

    try:
        return read_bounded(file, may_be_pipe=True)  # as keys may be, of a shell's <(...)
    except OSError as error:
        raise SyncError(
            f"the server's authority cannot be read ({error.strerror})", where=file, advice="check ca in [sync]"
        ) from error


class FolderServer:
    """A folder: on another disk, on a mounted server, or on this device."""

    def __init__(self, root: Path, rate: Rate) -> None:
        """Use a folder; the first upload creates it."""
        self.root = root.absolute()
        self._rate = rate

    def size(self, key: str) -> int | None:
        """Return a file's size [bytes], None if there is none."""
        try:
            return (self.root / key).stat().st_size
        except FileNotFoundError:
            return None
        except OSError as error:
            raise fault_of(error, str(self.root / key)) from error

    def send(self, key: str, content: IO[bytes], size: int) -> None:
        """Write a temporary file, sync it, rename it, sync the folder."""
        path = self.root / key
        beside = path.with_name(f".{path.name}.partial")  # a fixed name: the rest of a killed process is overwritten
        try:
            make_folders(path.parent)
            with beside.open("wb") as file:
                while piece := content.read(PIECE):
                    self._rate.wait_for(len(piece))
                    file.write(piece)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(path)
            sync_folder(path.parent)
        except OSError as error:
            with contextlib.suppress(OSError):
                beside.unlink(missing_ok=True)
            raise fault_of(error, str(self.root / key)) from error

    def fetch(self, key: str) -> Iterator[bytes]:
        """Yield a file's content, read from the disk if the kernel drops its cache."""
        try:
            with (self.root / key).open("rb") as file:
                os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
                while piece := file.read(PIECE):
                    yield piece
        except FileNotFoundError:
            raise
        except OSError as error:
            raise fault_of(error, str(self.root / key)) from error


class BucketServer:
    """A bucket, below a prefix of its keys."""

    def __init__(self, store: Any, rate: Rate, where: str) -> None:
        """Use obstore's store; where: its address in messages."""
        import obstore

        self._library: Any = obstore
        self._errors = (obstore.exceptions.BaseError, OSError)
        self._store, self._rate, self._where = store, rate, where

    def size(self, key: str) -> int | None:
        """Return an object's size [bytes], None if there is none."""
        try:
            return int(self._library.head(self._store, key)["size"])
        except FileNotFoundError:
            return None
        except self._errors as error:
            raise fault_of(error, self._where, writing=False) from error

    def send(self, key: str, content: IO[bytes], size: int) -> str | None:
        """Upload an object in one request, or a large one in parts, with one part in memory at a time."""
        try:
            if size <= PART:
                self._rate.wait_for(size)
                result = self._library.put(self._store, key, content.read(), use_multipart=False)
            else:
                parts = self._paced(content)
                result = self._library.put(self._store, key, parts, chunk_size=PART, max_concurrency=1)
        except self._errors as error:
            raise fault_of(error, self._where) from error
        tag = result.get("e_tag")
        return None if tag is None else str(tag).strip('"')

    def fetch(self, key: str) -> Iterator[bytes]:
        """Yield an object's content."""
        try:
            for piece in self._library.get(self._store, key).stream(min_chunk_size=PIECE):
                yield bytes(piece)
        except FileNotFoundError:
            raise
        except self._errors as error:
            raise fault_of(error, self._where, writing=False) from error

    def _paced(self, content: IO[bytes]) -> Iterator[bytes]:
        while part := content.read(PART):
            self._rate.wait_for(len(part))
            yield part


class Sums:
    """Running checksums of a stream: SHA-256, and the MD5 with which S3 and Google answer an upload.

    An upload in parts is answered with the MD5 of the parts' MD5s and their number; the S3 API names it an ETag.
    """

    def __init__(self) -> None:
        """Start the checksums of an empty object."""
        self._sha256, self._whole = hashlib.sha256(), hashlib.md5(usedforsecurity=False)
        self._part, self._in_part = hashlib.md5(usedforsecurity=False), 0
        self._parts: list[bytes] = []
        self.size = 0

    def add(self, content: bytes) -> None:
        """Add the object's next bytes to all checksums."""
        self._sha256.update(content)
        self._whole.update(content)
        self.size += len(content)
        while content:
            room = PART - self._in_part
            self._part.update(content[:room])
            self._in_part += len(content[:room])
            content = content[room:]
            if self._in_part == PART:
                self._end_part()

    @property
    def sha256(self) -> str:
        """Return the SHA-256 in hexadecimal digits."""
        return self._sha256.hexdigest()

    @property
    def tag(self) -> str:
        """Return the checksum with which the store should answer."""
        if self.size <= PART:
            return self._whole.hexdigest()
        parts = [*self._parts, *([self._part.digest()] if self._in_part else [])]
        return f"{hashlib.md5(b''.join(parts), usedforsecurity=False).hexdigest()}-{len(parts)}"

    def _end_part(self) -> None:
        self._parts.append(self._part.digest())
        self._part, self._in_part = hashlib.md5(usedforsecurity=False), 0


def sums_of(content: IO[bytes]) -> Sums:
    """Return the checksums of a file from its beginning, and rewind the file."""
    content.seek(0)
    sums = Sums()
    while piece := content.read(PIECE):
        sums.add(piece)
    content.seek(0)
    return sums


__all__ = [
    "BucketServer",
    "FolderServer",
    "ReadRefusedError",
    "Server",
    "ServerError",
    "Sums",
    "open_server",
    "sums_of",
]
