"""Storage of results with checksums; a damaged or unreadable result counts as absent and is computed again.

The file `fits/KEY.json.sha256` belongs to `fits/KEY.json`, in the format of `sha256sum --check`. The checksum is
written first, so that every result has its own. A result without a checksum is of an earlier Hangtime; its schema alone
judges it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from fit.batch.jobs import diagnosis_name, digest_of, report_name, result_name
from fit.batch.store import Store
from fit.errors import BatchError, UnreachableError
from formats.errors import ResultError
from formats.results import diagnosis_from, fit_result_from

Kept = TypeVar("Kept")

CHECKSUM_SUFFIX = ".sha256"  # suffix of a checksum file, after the name of its file


def keep(results: Store, name: str, content: bytes) -> None:
    """Write a file and its checksum.

    Raises:
        BatchError, UnreachableError: file or checksum cannot be written.
    """
    base = name.rsplit("/", 1)[-1]
    results.write(name + CHECKSUM_SUFFIX, f"{digest_of(content)}  {base}\n".encode())
    results.write(name, content)


def sound(results: Store, name: str) -> bytes:
    """Return the content of a file with a correct checksum or without any.

    Raises:
        BatchError: the file cannot be read, or its checksum is wrong. UnreachableError: the results cannot be reached
        now.
    """
    content = results.read(name)
    if results.has(name + CHECKSUM_SUFFIX):
        stated = results.read(name + CHECKSUM_SUFFIX).split()
        if stated != [digest_of(content).encode(), name.rsplit("/", 1)[-1].encode()]:  # a copy has another name
            raise BatchError(
                "is damaged: its checksum does not fit", where=f"{results.url}/{name}",
                advice="run the batch again, which makes it again",
            )  # fmt: skip
    return content


def kept(results: Store, name: str, load: Callable[[bytes, object], Kept]) -> Kept:
    """Return an undamaged result, decoded by `load`.

    Raises:
        BatchError, ResultError: it cannot be read, or is damaged.
        UnreachableError: the results cannot be reached now.
    """
    return load(sound(results, name), f"{results.url}/{name}")


def has_fit(results: Store, key: str) -> bool:
    """Return whether the store has an undamaged fit of this key.

    Raises:
        UnreachableError: the results cannot be reached now.
    """
    name = result_name(key)
    return results.has(name) and _holds(lambda: kept(results, name, fit_result_from))


def has_diagnosis(results: Store, key: str) -> bool:
    """Return whether the store has an undamaged diagnosis of this key, with its report.

    Raises:
        UnreachableError: the results cannot be reached now.
    """
    name = diagnosis_name(key)
    return results.has(name) and _holds(lambda: (kept(results, name, diagnosis_from), sound(results, report_name(key))))


def _holds(read: Callable[[], object]) -> bool:
    try:
        read()
    except UnreachableError:
        raise
    except (BatchError, ResultError):
        return False
    return True
