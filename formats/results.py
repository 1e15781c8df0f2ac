"""Read and write fit results and diagnoses as JSON files, validated against published schemas."""

from __future__ import annotations

from codecs import BOM_UTF8
from pathlib import Path
from typing import TypeVar, get_args, get_type_hints

import msgspec

from formats.diagnosis_records import Diagnosis
from formats.errors import NewerFormatError, ResultError
from formats.fit_records import FitResult
from formats.plain_text import encoding_of, sized
from formats.result_checks import as_plain, check_result
from formats.result_digests import check_digest, with_digest
from formats.system_causes import step_to_read
from formats.whole_files import check_ends, write_whole
from formats.wrong_fields import wrong_field

LARGEST_RESULT = 1 << 27  # bytes: a fit has 138 a frame, so 970,000 frames, which are 9 hours at 30 a second
FREE_PARTS, BYTES_A_PART = 1 << 19, 12  # values that any file may have, and bytes for each further one; a fit has 25

Result = TypeVar("Result", FitResult, Diagnosis)
KINDS_OF_RESULTS: dict[type[FitResult | Diagnosis], str] = {FitResult: "fit result", Diagnosis: "diagnosis"}


def save_fit_result(path: Path, result: FitResult) -> None:
    """Write a fit result; the file appears whole or not at all, and its folder is made if absent.

    Raises:
        ResultError: a number in it is not finite.
        OSError: it cannot be written.
    """
    _save(path, result)


def load_fit_result(path: Path) -> FitResult:
    """Read a fit result.

    Raises:
        ResultError: the file is missing or does not match the schema.
    """
    return _load(path, FitResult)


def fit_result_from(raw: bytes, where: object) -> FitResult:
    """Return the fit result in the bytes of its file.

    Raises:
        ResultError: they do not match the schema. NewerFormatError: a newer version wrote them.
    """
    return _decoded(raw, FitResult, where)


def diagnosis_from(raw: bytes, where: object) -> Diagnosis:
    """Return the diagnosis in the bytes of its file.

    Raises:
        ResultError: they do not match the schema. NewerFormatError: a newer version wrote them.
    """
    return _decoded(raw, Diagnosis, where)


def save_diagnosis(path: Path, diagnosis: Diagnosis) -> None:
    """Write a diagnosis; the errors are those of `save_fit_result`."""
    _save(path, diagnosis)


def load_diagnosis(path: Path) -> Diagnosis:
    """Read a diagnosis.

    Raises:
        ResultError: the file is missing or does not match the schema.
    """
    return _load(path, Diagnosis)


def load_result(path: Path) -> FitResult | Diagnosis:
    """Read a fit or a diagnosis, whichever the file states; a fit where it states neither.

    Raises:
        ResultError: the file is missing or does not match the schema.
    """
    raw = _bytes_of(path)
    is_diagnosis = _format_in(raw).partition("/")[0] == _format_of(Diagnosis).partition("/")[0]
    return diagnosis_from(raw, path) if is_diagnosis else fit_result_from(raw, path)


def _save(path: Path, record: FitResult | Diagnosis) -> None:
    raw = result_bytes(record, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, raw)


def result_bytes(record: FitResult | Diagnosis, path: Path) -> bytes:
    """Return the content of a result's file; path: the file's name in an error.

    Raises:
        ResultError: a number in it is not finite.
    """
    check_result(record, path)
    raw = msgspec.json.format(with_digest(msgspec.json.encode(record, enc_hook=as_plain)), indent=2)
    msgspec.json.decode(raw, type=type(record))
    return raw + b"\n"


def _load(path: Path, kind: type[Result]) -> Result:
    return _decoded(_bytes_of(path), kind, path)


def _bytes_of(path: Path) -> bytes:
    try:
        check_ends(path)
        _check_size(path.stat().st_size, path)
        return path.read_bytes()
    except OSError as error:
        raise ResultError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error


def _decoded(raw: bytes, kind: type[Result], where: object) -> Result:
    _check_size(len(raw), where)
    _refuse_no_text(raw, where)
    if (parts := raw.count(b",")) > FREE_PARTS + len(raw) // BYTES_A_PART:
        what = f"has {sized(len(raw))} of {parts} short values, which no result has"
        raise ResultError(what, where=where, advice="check the path")
    try:
        record = msgspec.json.decode(raw.removeprefix(BOM_UTF8), type=kind)
    except (msgspec.MsgspecError, RecursionError) as error:
        _refuse_other_version(raw, kind, where)
        words = "the file is nested too deep" if isinstance(error, RecursionError) else wrong_field(error, (kind,))
        raise ResultError(f"is not a {KINDS_OF_RESULTS[kind]}: {words}", where=where, advice="make it again") from error
    stated, record = record.digest, msgspec.structs.replace(record, digest=msgspec.UNSET)
    if isinstance(stated, str):  # first: numbers that were rounded contradict each other too
        again = "fit again" if isinstance(record, FitResult) else "diagnose again"
        check_digest(raw, stated, where, again)
    check_result(record, where)
    return record


def _check_size(size: int, where: object) -> None:
    if size > LARGEST_RESULT:
        raise ResultError(f"has {sized(size)}, which no result has", where=where, advice="check the path")


def _refuse_no_text(raw: bytes, where: object) -> None:
    """Refuse an empty file, a file of zeros, binary data or UTF-16 text, and name which of them it is."""
    if not raw.strip(b"\0\r\n\t "):
        what = "holds nothing but zeros, as a power cut leaves a file" if b"\0" in raw else "is empty"
        raise ResultError(what, where=where, advice="copy it again, or make it again")
    if (encoding := encoding_of(raw[:4])) not in ("utf-8", "utf-8-sig"):
        raise ResultError(
            f"is text in {encoding[:6].upper()}, and a result is UTF-8", where=where,
            advice="save it as UTF-8, or copy it from where it was made",
        )  # fmt: skip
    if b"\0" in raw and not raw.lstrip(b"\xef\xbb\xbf\r\n\t ").startswith(b"{"):
        raise ResultError(
            "is a binary file, and no result", where=where, advice="give the folder or the .json of a fit or diagnosis"
        )
    if b"\0" in raw:
        raise ResultError(
            "holds zero bytes within its text: the file is damaged",
            where=where,
            advice="copy it again, or make it again",
        )


def _refuse_other_version(raw: bytes, kind: type[Result], where: object) -> None:
    """Refuse a file that states another version of the expected format."""
    known, named = _format_of(kind), _format_in(raw)
    kind_named, _, version = named.partition("/")
    kind_known, _, newest = known.partition("/")
    if named != known and kind_named == kind_known:
        is_newer = version.isdecimal() and version.isascii() and int(version[:9]) > int(newest)
        raise (NewerFormatError if is_newer else ResultError)(
            f"has the format {named}, and this version of Hangtime reads {known}", where=where,
            advice="read it with the version that wrote it, or make it again",
        )  # fmt: skip


def _format_of(kind: type[FitResult | Diagnosis]) -> str:
    (known,) = get_args(get_type_hints(kind)["format"])
    return str(known)


class _Named(msgspec.Struct):
    format: str


def _format_in(raw: bytes) -> str:
    """Return the format that a file states, '' where it states none."""
    try:
        return msgspec.json.decode(raw.removeprefix(BOM_UTF8), type=_Named).format
    except (msgspec.MsgspecError, RecursionError):
        return ""
