"""Storage of results with checksums; a damaged or unreadable result counts as absent and is computed again.

The file `fits/KEY.json.sha256` belongs to `fits/KEY.json`, in the format of `sha256sum --check`. The checksum is
written first, so that every result has its own. It also holds the result's name. So a result without a checksum is
damaged or a copy of another one, and counts as absent. A result of a newer format is neither, and is never replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from fit.batch.jobs import Outcome, diagnosis_name, digest_of, report_name, result_name
from fit.batch.store import Store
from fit.errors import BatchError, UnreachableError
from fit.identification.read_again import diagnosed_from, fit_from
from formats.errors import NewerFormatError, ResultError

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
    """Return the content of a file with a correct checksum.

    Raises:
        BatchError: the file cannot be read, or its checksum is wrong or absent. UnreachableError: the results cannot be
        reached now.
    """
    content = results.read(name)
    _check(results, name, content)
    return content


def _check(results: Store, name: str, content: bytes) -> None:
    what = "has no checksum beside it"
    if results.has(name + CHECKSUM_SUFFIX):
        stated = results.read(name + CHECKSUM_SUFFIX).split()
        if stated == [digest_of(content).encode(), name.rsplit("/", 1)[-1].encode()]:  # a copy has another name
            return
        what = "is damaged: its checksum does not fit"
    raise BatchError(what, where=f"{results.url}/{name}", advice="run the batch again, which makes it again")


def kept(results: Store, name: str, load: Callable[[bytes, object], Kept]) -> Kept:
    """Return an undamaged result, decoded by `load`.

    Raises:
        BatchError, ResultError: it cannot be read, or is damaged. NewerFormatError: it is of a newer format, whose
        checksum this version does not judge.
        UnreachableError: the results cannot be reached now.
    """
    content = results.read(name)
    try:
        _check(results, name, content)
    except UnreachableError:
        raise
    except BatchError as damage:
        try:
            load(content, f"{results.url}/{name}")
        except NewerFormatError:
            raise
        except ResultError:
            pass
        raise damage
    return load(content, f"{results.url}/{name}")


def left_alone(error: NewerFormatError) -> str:
    """Return why a result of a newer format was not made again, and the next step."""
    return (
        f"its result {error.what}, and stays as it is: {error.where}; run the batch of the version that wrote it, "
        "or move the file away"
    )


def known_outcome(
    results: Store, key: str, has: Callable[[Store, str], bool], state: str, failure: str | None, names: Sequence[str]
) -> Outcome | None:
    """Return what the results hold of a job; None if it is to be done.

    - `has`: whether they hold its result; `state`: of the job where they do
    - `failure`: the recorded reason of an earlier failure, None without one
    - `names`: of the files in which the job would keep its result; a folder of such a name is refused

    Raises:
        UnreachableError: the results cannot be reached now.
    """
    try:
        if has(results, key):
            return Outcome(key=key, state=state)
    except NewerFormatError as error:
        return Outcome(key=key, state="newer", sentence=left_alone(error))
    for name in (place + ending for place in names for ending in ("", CHECKSUM_SUFFIX)):
        if (path := results.path(name)) is not None and path.is_dir():
            sentence = f"{path}: a folder is in the place of its result; move it away, then run the batch again"
            return Outcome(key=key, state="refused", sentence=sentence)
    return None if failure is None else Outcome(key=key, state="failed", sentence=failure)


def has_fit(results: Store, key: str) -> bool:
    """Return whether the store has an undamaged fit of this key.

    Raises:
        NewerFormatError: the store has a fit of a newer format.
        UnreachableError: the results cannot be reached now.
    """
    name = result_name(key)
    return results.has(name) and _holds(lambda: kept(results, name, fit_from))


def has_diagnosis(results: Store, key: str) -> bool:
    """Return whether the store has an undamaged diagnosis of this key, with its report.

    Raises:
        NewerFormatError: the store has a diagnosis of a newer format.
        UnreachableError: the results cannot be reached now.
    """
    name = diagnosis_name(key)
    return results.has(name) and _holds(lambda: (kept(results, name, diagnosed_from), sound(results, report_name(key))))


def _holds(read: Callable[[], object]) -> bool:
    try:
        read()
    except (UnreachableError, NewerFormatError):
        raise
    except (BatchError, ResultError):
        return False
    return True
