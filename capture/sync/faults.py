"""Faults that stop uploads: the server's own reason in one sentence, and the next action."""

from __future__ import annotations

import errno
import re
from dataclasses import dataclass
from functools import partial
from typing import Literal

from capture.errors import SyncError
from formats.store_address import answers_without_tls, first_line, is_without_keys, is_without_tls, without_secrets

FULL_CODES = {
    "InsufficientStorage",
    "QuotaExceeded",
    "XMinioStorageFull",
    "ServiceQuotaExceeded",
    "EntityTooLargeForQuota",
}
KEY_CODES = {
    "InvalidAccessKeyId", "SignatureDoesNotMatch", "ExpiredToken", "InvalidToken", "AuthenticationFailed",
    "AuthorizationHeaderMalformed", "AuthorizationFailure", "UnknownAccessKeyId",
}  # fmt: skip
CLOCK_CODES = {"RequestTimeTooSkewed", "RequestExpired"}
# characters of the server's message. Our choice: one and a half lines of a terminal. A longer page of a proxy would
# hide our own words.
LONGEST_WORDS = 120

Kind = Literal["passing", "person", "take"]


class ServerError(SyncError):
    """A fault that stops an upload or a download.

    kind: "passing" may be over at the next attempt; "person" lasts until somebody follows the advice; "take"
        concerns this take only
    """

    def __init__(self, what: str, *, where: object, advice: str, kind: Kind) -> None:
        super().__init__(what, where=where, advice=advice)
        self.kind = kind


class ReadRefusedError(ServerError):
    """The server refused to list or return an object: these credentials may at most write."""


@dataclass(frozen=True)
class Answer:
    """A server's answer: status, code and message, if any."""

    status: int
    code: str
    message: str

    @property
    def words(self) -> str:
        """Return the server's answer, shortened."""
        said = ": ".join(part for part in (self.code, self.message) if part)
        return f"{self.status} {said}".strip()[:LONGEST_WORDS]


def fault_of(error: Exception, where: str, *, writing: bool = True) -> ServerError:
    """Return the fault for an error of the store's library or of a server folder.

    where: the bucket with its server, or the requested file
    """
    if isinstance(error, ServerError):
        return error
    text = str(error)
    if is_without_keys(error) or is_without_tls(error):
        return _unsent(error, where)
    if answer := _answer(text):
        return _refusal(answer, where, writing=writing)
    if isinstance(error, OSError) and error.errno is not None:
        return _folder_fault(error, where)
    return _no_answer(error, text, where)


def _unsent(error: Exception, where: str) -> ServerError:
    """Return the fault of a request that this device's own settings prevented."""
    advice = "put the keys into the credentials of sync"
    if is_without_tls(error):
        advice = "set allow_http = true in [sync] if the server has no TLS, else write https:// in endpoint"
    return ServerError(first_line(error), where=where, advice=advice, kind="person")


def _answer(text: str) -> Answer | None:
    found = re.search(r"status code: (\d{3})([^\n]*)", text)
    if found is None:
        return None
    code = re.search(r"<Code>([^<]*)</Code>|\"(?:code|reason)\": ?\"([A-Za-z]\w*)\"", text)
    message = re.search(r"<Message>([^<]*)</Message>|\"message\": ?\"([^\"]*)\"", text)
    plain = found[2].split(": ")[0].strip()
    return Answer(
        status=int(found[1]),
        code=next(filter(None, code.groups()), "") if code else plain,
        message=_first_sentence(next(filter(None, message.groups()), "") if message else ""),
    )


def _first_sentence(message: str) -> str:
    """Return a message's first sentence; Azure appends request numbers, and the library escapes line ends."""
    return without_secrets(re.split(r"\n|\\n|\.(?: |$)", message)[0]).rstrip(".")


def _refusal(answer: Answer, where: str, *, writing: bool) -> ServerError:
    status, code, fault = answer.status, answer.code, partial(ServerError, where=where)
    if code in CLOCK_CODES:
        return fault(
            f"the server refuses the clock of this device ({answer.words})", kind="person",
            advice="set the clock: connect the device to a time server, then look at `timedatectl`",
        )  # fmt: skip
    if (
        status == 507
        or code in FULL_CODES
        or re.search(r"no space left|disk full|quota", answer.message, re.IGNORECASE)
    ):
        return fault(
            f"the server is full ({answer.words})", kind="person",
            advice="make room on the server; takes stay on this device until then",
        )  # fmt: skip
    if status == 401 or code in KEY_CODES:
        return fault(
            f"the server does not accept the keys of this device ({answer.words})", kind="person",
            advice="put the right keys into the credentials of sync",
        )  # fmt: skip
    if status == 403:
        kind, allowed = (ServerError, "write") if writing else (ReadRefusedError, "read")
        return kind(
            f"the server refuses this device ({answer.words})", where=where, kind="person",
            advice=f"allow the keys of this device to {allowed} below the address in [sync], or give other keys",
        )  # fmt: skip
    if status == 404:
        return fault(
            f"the server knows no such place ({answer.words})", kind="person",
            advice="make the bucket, or mend url and endpoint in [sync]",
        )  # fmt: skip
    if status == 413 or code == "EntityTooLarge":
        return fault(
            f"the server takes no file of this size ({answer.words})", kind="take", advice="raise the server's limit"
        )
    if status in (408, 425, 429, 503) or code == "SlowDown":
        return fault(
            f"the server asks to wait ({answer.words})", kind="passing", advice="nothing; the sync service tries again"
        )
    if status >= 500:
        return fault(
            f"the server fails ({answer.words})", kind="passing",
            advice="the sync service tries again; if it lasts, look into the server's log",
        )  # fmt: skip
    if status in (301, 307, 308):
        return fault(
            f"the server sends this device elsewhere ({answer.words})", kind="person",
            advice="mend endpoint and region in [sync]",
        )  # fmt: skip
    return fault(
        f"the server refuses the request ({answer.words})",
        kind="person",
        advice="mend url, endpoint and region in [sync]",
    )


def _no_answer(error: Exception, text: str, where: str) -> ServerError:
    fault, again = partial(ServerError, where=where), "try again; the sync service does so by itself"
    if "dns error" in text:
        return fault(
            "the server's name cannot be found", kind="passing",
            advice=f"check the network of this device, and the name in [sync]; {again}",
        )  # fmt: skip
    if found := re.search(r"certificate[^\n]*?: ?\(?\"?(\w+)|(UnknownIssuer|CertExpired|NotValidForName)", text):
        if any(word in text for word in ("Expired", "NotValidYet")):
            advice = "set the clock of this device (`timedatectl`), or renew the server's certificate"
        elif "NotValidForName" in text:
            advice = "use the name in [sync] that the certificate is made out for"
        else:
            advice = "give the certificate of the server's own authority as ca in [sync]"
        reason = next(
            (word for word in ("UnknownIssuer", "Expired", "NotValidYet", "NotValidForName") if word in text), ""
        )
        return fault(
            f"this device does not trust the server's certificate ({reason or found[0]})", kind="person", advice=advice
        )
    if answers_without_tls(error):
        advice = "write http:// in endpoint and allow_http = true in [sync], or give the server's port with TLS"
        return fault("the server answers, and not in TLS", kind="person", advice=advice)
    if "ConnectionRefused" in text or "onnection refused" in text:
        return fault(
            "nothing answers at the server's address",
            kind="passing",
            advice=f"start the server, or mend the address; {again}",
        )
    if re.search(r"TimedOut|kind: Timeout|timed out", text):
        return fault(
            "the server does not answer in time", kind="passing",
            advice=f"check the line; a slow one needs a longer timeout_s; {again}",
        )  # fmt: skip
    if re.search(r"NetworkUnreachable|HostUnreachable|unreachable", text):
        return fault("there is no network", kind="passing", advice=f"check cable or Wi-Fi; {again}")
    return fault(
        f"the connection to the server broke ({_innermost(text) or first_line(error)})", kind="passing", advice=again
    )


def _innermost(text: str) -> str:
    """Return the innermost reason in the library's nested error."""
    for word in ("ConnectionReset", "BrokenPipe", "IncompleteMessage", "UnexpectedEof", "ConnectionAborted"):
        if word in text:
            return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", word).lower()
    return ""


def _folder_fault(error: OSError, where: str) -> ServerError:
    where, reason = error.filename or where, (error.strerror or "fails").lower()
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return ServerError(
            f"the server's disk is full ({reason})", where=where, kind="person",
            advice="make room there; takes stay on this device until then",
        )  # fmt: skip
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        return ServerError(
            f"the server's folder cannot be written ({reason})", where=where, kind="person",
            advice="check its owner, and whether it is mounted for writing",
        )  # fmt: skip
    if error.errno in (errno.ENOENT, errno.ENOTDIR):
        return ServerError(
            f"the server's folder is not there ({reason})", where=where, kind="person",
            advice="mount or make it, or mend url in [sync]",
        )  # fmt: skip
    return ServerError(
        f"the server's folder fails ({reason})", where=where, kind="passing",
        advice="the sync service tries again; if it lasts, check that disk",
    )  # fmt: skip
