"""Store of named files in a folder or a bucket, with atomic writes.

In a folder a file is written under a temporary name, synced and renamed; then the folder is synced. In a bucket one PUT
creates an object, which appears whole or not at all. A reader never sees a partial file.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Protocol

from fit.errors import BatchError, UnreachableError
from formats.errors import AddressError
from formats.files_below import files_below
from formats.plain_text import sized
from formats.store_address import advice_on, first_line, folder_of, is_out_of_reach, open_bucket
from formats.system_causes import FULL, step_to_read, step_to_write
from formats.take_reader import LARGEST_FILE
from formats.whole_files import check_ends, write_whole

TRIAL = "trial-of-writing"  # name of the file that `try_writing` leaves only where it cannot be removed


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
        """Return a file's content; BatchError if it cannot be read, or is larger than any take."""
        ...

    def write(self, name: str, content: bytes) -> None:
        """Write a file atomically; BatchError if it cannot be written, UnreachableError if not now."""
        ...

    def remove(self, name: str) -> None:
        """Remove a file that may be there; BatchError if it cannot be removed."""
        ...

    def path(self, name: str) -> Path | None:
        """Return the path of a file in a file system, None in a bucket."""
        ...


def open_store(url: str) -> Store:
    """Open a folder (a path or file:///...) or a bucket (s3://, gs://, az://).

    Raises:
        BatchError: no address or one of another kind, or a bucket that cannot be addressed.
    """
    try:
        folder = folder_of(url)
        return Bucket(url) if folder is None else Folder(folder)
    except AddressError as error:
        raise BatchError(error.what, where=error.where, advice=error.advice) from error


class Folder:
    """Files of a folder on this machine or on a file system that the workers share."""

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()
        self.url = str(self.root)

    def names(self, below: str, suffix: str) -> list[str]:
        """Return the names below this one that end in the suffix, sorted; links to folders are not followed.

        A pipe, a device and a broken link are included, so that they are reported instead of skipped. So is a folder
        that cannot be listed.

        Raises:
            BatchError: the folder itself cannot be listed.
        """
        top = self.root / below
        try:
            found, locked = files_below(top, suffix)
        except OSError as error:
            raise BatchError(f"cannot be read ({error.strerror})", where=top, advice=step_to_read(error)) from error
        return sorted(
            path.relative_to(self.root).as_posix() for path in [*locked, *(p for p in found if not p.is_dir())]
        )

    def has(self, name: str) -> bool:
        """Return whether there is such a file."""
        return (self.root / name).is_file()

    def read(self, name: str) -> bytes:
        """Return the bytes of a file."""
        try:
            check_ends(self.root / name)
            with (self.root / name).open("rb") as file:
                _refuse_a_huge(os.fstat(file.fileno()).st_size, self.root / name)
                return file.read()
        except OSError as error:
            raise BatchError(
                f"cannot be read ({error.strerror})", where=self.root / name, advice=step_to_read(error)
            ) from error

    def write(self, name: str, content: bytes) -> None:
        """Write a temporary file, sync, rename, and sync the folder."""
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
            if error.errno in FULL:
                raise store_is_full(error, path) from error
            raise BatchError(
                f"cannot be written ({error.strerror})", where=path, advice=step_to_write(error)
            ) from error

    def remove(self, name: str) -> None:
        """Remove a file that may be there."""
        path = self.root / name
        try:
            path.unlink(missing_ok=True)
        except NotADirectoryError:  # no file is below a file
            return
        except OSError as error:
            raise BatchError(
                f"cannot be removed ({error.strerror})", where=path, advice=step_to_write(error)
            ) from error

    def path(self, name: str) -> Path | None:
        """Return the path of the file."""
        return self.root / name


class Bucket:
    """Objects of a bucket below a prefix; keys come from the environment (AWS_..., GOOGLE_..., AZURE_...)."""

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self._store: Any = open_bucket(url, extra="batch")
        import obstore

        self._library: Any = obstore
        self._errors = (obstore.exceptions.BaseError, OSError)

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
        """Return the bytes of an object."""
        try:
            found = self._library.get(self._store, name)
            _refuse_a_huge(found.meta["size"], f"{self.url}/{name}")
            return bytes(found.bytes())
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
        """Return None, because an object has no path in a file system."""
        return None

    def _failure(self, what: str, where: str, error: Exception) -> BatchError:
        kind = UnreachableError if is_out_of_reach(error) else BatchError
        return kind(f"{what} ({first_line(error)})", where=where, advice=advice_on(error))


def try_writing(store: Store) -> None:
    """Write and remove an empty file, so that a store that refuses results is noticed before the first fit.

    Raises:
        BatchError: the store refuses either. UnreachableError: it cannot be reached, or cannot write now.
    """
    store.write(TRIAL, b"")
    store.remove(TRIAL)


def store_is_full(error: OSError, where: object) -> UnreachableError:
    """Return the error of a store whose disk is full."""
    return UnreachableError(
        f"cannot be written ({error.strerror})", where=where,
        advice=f"{step_to_write(error)}; finished takes are kept, and the same command continues",
    )  # fmt: skip


def _refuse_a_huge(size: int, where: object) -> None:
    """Refuse a file larger than any take or result, before it is read."""
    if size > LARGEST_FILE:
        raise BatchError(
            f"has {sized(size)}, and a take {sized(LARGEST_FILE)} at most", where=where,
            advice="is it a take?",
        )  # fmt: skip
