"""A folder or a bucket of named files, each written whole or not at all.

In a folder a file is written beside its place, synced, renamed and its folder synced; in a bucket one PUT makes an
object, which stores show whole or not at all. Whoever reads never meets half a file.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import unquote, urlsplit

from fit.errors import BatchError, UnreachableError
from formats.whole_files import write_whole

BUCKETS = ("s3", "s3a", "gs", "az", "abfs", "abfss")


class Store(Protocol):
    """Files by name; names have slashes and no other meaning."""

    url: str

    def names(self, below: str, suffix: str) -> list[str]:
        """Return the names below this one that end in the suffix, sorted."""
        ...

    def has(self, name: str) -> bool:
        """Return whether there is such a file."""
        ...

    def read(self, name: str) -> bytes:
        """Return a file's content; BatchError if it cannot be read."""
        ...

    def write(self, name: str, content: bytes) -> None:
        """Put a file in place, whole or not at all; BatchError if it cannot be written."""
        ...

    def remove(self, name: str) -> None:
        """Remove a file that may be there."""
        ...

    def path(self, name: str) -> Path | None:
        """Return where a file lies in a file system, None in a bucket."""
        ...


def open_store(url: str) -> Store:
    """Open a folder (a path or file:///...) or a bucket (s3://, gs://, az://).

    Raises:
        BatchError: no address or one of another kind, or a bucket that cannot be addressed.
    """
    if not url.strip():
        raise BatchError("no folder or bucket was given", advice="give a path or an address; is a variable empty?")
    parts = urlsplit(url)
    if "://" not in url:
        return Folder(Path(url))
    if parts.scheme == "file":
        return Folder(Path(unquote(parts.path)))
    if parts.scheme in BUCKETS:
        return Bucket(url)
    raise BatchError(
        f"{url!r} is neither a folder nor a bucket", advice="give a path, file:///..., s3://..., gs://... or az://..."
    )


class Folder:
    """Files of a folder on this machine or on a file system that the workers share."""

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()
        self.url = str(self.root)

    def names(self, below: str, suffix: str) -> list[str]:
        """Return the names below this one that end in the suffix, sorted; links to folders are not followed."""
        top = self.root / below
        found = [p for p in top.rglob(f"*{suffix}") if p.is_file()] if top.is_dir() else []
        return sorted(p.relative_to(self.root).as_posix() for p in found)

    def has(self, name: str) -> bool:
        """Return whether there is such a file."""
        return (self.root / name).is_file()

    def read(self, name: str) -> bytes:
        """Return a file's content."""
        try:
            return (self.root / name).read_bytes()
        except OSError as error:
            raise BatchError(
                f"cannot be read ({error.strerror})", where=self.root / name, advice="check path and permissions"
            ) from error

    def write(self, name: str, content: bytes) -> None:
        """Write beside, sync, rename, sync the folder."""
        path = self.root / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content)
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        except OSError as error:
            raise BatchError(
                f"cannot be written ({error.strerror})", where=path, advice="check space and permissions"
            ) from error

    def remove(self, name: str) -> None:
        """Remove a file that may be there."""
        (self.root / name).unlink(missing_ok=True)

    def path(self, name: str) -> Path | None:
        """Return where the file lies."""
        return self.root / name


class Bucket:
    """Objects of a bucket below a prefix; keys come from the environment (AWS_..., GOOGLE_..., AZURE_...)."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        try:
            import obstore
            from obstore.store import from_url
        except ModuleNotFoundError as error:
            raise BatchError(
                "buckets need the library obstore",
                where=url,
                advice="in Hangtime's checkout: pip install -e '.[batch]'",
            ) from error
        self._library: Any = obstore
        self._errors = (obstore.exceptions.BaseError, OSError)
        try:
            self._store: Any = from_url(url)
        except (*self._errors, ValueError) as error:
            raise BatchError(f"is no bucket: {_first_line(error)}", where=url, advice="check the address") from error

    def names(self, below: str, suffix: str) -> list[str]:
        """Return the names below this one that end in the suffix, sorted."""
        try:
            pages = self._library.list(self._store, prefix=below or None)
            return sorted(o["path"] for page in pages for o in page if o["path"].endswith(suffix))
        except self._errors as error:
            raise self._failure("cannot be listed", self.url, error) from error

    def has(self, name: str) -> bool:
        """Return whether there is such an object."""
        try:
            self._library.head(self._store, name)
        except FileNotFoundError:
            return False
        except self._errors as error:
            raise self._failure("cannot be asked for", f"{self.url}/{name}", error) from error
        return True

    def read(self, name: str) -> bytes:
        """Return an object's content."""
        try:
            return bytes(self._library.get(self._store, name).bytes())
        except self._errors as error:
            raise self._failure("cannot be read", f"{self.url}/{name}", error) from error

    def write(self, name: str, content: bytes) -> None:
        """Put the object in one request."""
        try:
            self._library.put(self._store, name, content, use_multipart=False)
        except self._errors as error:
            raise self._failure("cannot be written", f"{self.url}/{name}", error) from error

    def remove(self, name: str) -> None:
        """Remove an object that may be there."""
        try:
            self._library.delete(self._store, name)
        except FileNotFoundError:
            return
        except self._errors as error:
            raise self._failure("cannot be removed", f"{self.url}/{name}", error) from error

    def path(self, name: str) -> Path | None:
        """Return None: an object has no place in a file system."""
        return None

    def _failure(self, what: str, where: str, error: Exception) -> BatchError:
        # A server that answers and refuses says so with a status; a connection that fails has none.
        is_connection = isinstance(error, self._library.exceptions.GenericError) and "status code" not in str(error)
        kind = UnreachableError if is_connection else BatchError
        return kind(
            f"{what} ({_first_line(error)})", where=where, advice="check the address, the network and the access keys"
        )


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].strip()[:200]
