"""Open the address of a store: a folder (a path or file:///...) or a bucket (s3://, gs://, az://).

The library obstore opens buckets. It is imported only for a bucket, since a folder needs no library.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote, urlsplit

from formats.errors import AddressError

S3, GOOGLE, AZURE = ("s3", "s3a"), ("gs",), ("az", "abfs", "abfss")
BUCKETS = S3 + GOOGLE + AZURE
BY_ACCOUNT = ("abfs", "abfss")  # their addresses are CONTAINER@ACCOUNT
ENDPOINTS = {
    S3: ("AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT"), GOOGLE: ("GOOGLE_BASE_URL",),
    AZURE: ("AZURE_STORAGE_ENDPOINT", "AZURE_ENDPOINT"),
}  # fmt: skip
SERVERS_REASON = re.compile(r"<Code>([^<]+)</Code>\s*(?:<Message>([^<]*)</Message>)?")  # of S3's error documents
KEPT_REASON = re.compile(r"DeleteObjects request failed for key .*: (.*) \(code: (\w+)\)")  # of obstore's errors
BUSY_CODES = ("InternalError", "ServiceUnavailable", "SlowDown")  # S3's reasons that pass, Amazon S3 "Error responses"
FAILED_REQUEST = re.compile(r"Error performing [A-Z]+ ([a-z]+://[^\s/?]+)")  # of obstore's errors
CAUSE = re.compile(r"(?:message: \"|failed to lookup address information: )([^\"]+)\"")
OF_STORE = re.compile(r"^Generic (\w+) error: ")  # begins obstore's errors
BUCKETS_NAME = "[A-Za-z0-9$][A-Za-z0-9$._-]*"  # includes S3's older names, Google's with _, and Azure's $web
UNREAD = re.compile(r'[Ff]ailed to parse "(.*?)" as (\w+)')
VALUES_WANTED = {"boolean": ("true or false", "true or false"), "Duration": ("a length of time", "one such as 30s")}
NO_SERVICE_ACCOUNT = re.compile(r"open service account file from (.*?)(?: \(os error \d+\))?(?:\n|$)")
CLOUDS_OWN = re.compile(r"http://(169\.254\.|metadata\b|\[fd00:ec2::)")  # servers that give keys to cloud machines
# HTTP statuses of a server that is busy, full or broken for a while (RFC 9110, RFC 6585); 501 lasts.
FOR_A_WHILE = re.compile(r"status code: (?:408|429|5(?!01)\d\d)\b")
BAD_SCHEME = "BadScheme"  # reqwest's error for a server without TLS that no setting allows
NO_TLS_ANSWER = "InvalidMessage("  # rustls's error for an answer that is none of TLS
CERTIFICATE = re.compile(r"InvalidCertificate\(\s*(?:Other\(\s*OtherError\(\s*)?(\w+)")  # rustls's, with its reason
SETTINGS_BEGIN = ("AWS_", "AZURE_", "GOOGLE_")
KEYS_OF = {
    "S3": "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY", "GCS": "GOOGLE_SERVICE_ACCOUNT",
    "MicrosoftAzure": "AZURE_STORAGE_ACCOUNT_KEY",
}  # fmt: skip
ALLOWING = {"S3": "AWS_ALLOW_HTTP", "MicrosoftAzure": "AZURE_ALLOW_HTTP"}  # Google's needs none
KEYS_BEGIN = {S3: "AWS_", AZURE: "AZURE_"}  # settings sent as headers; Google's keys are JSON of several lines
# characters of a server's reason that an error quotes. Our choice: two lines of a terminal or less than three. A
# longer page of a proxy would hide our own words.
LONGEST_REASON = 200


def folder_of(url: str) -> Path | None:
    """Return the folder that an address names, None for a bucket.

    Raises:
        AddressError: the address is empty or of another kind.
    """
    if not url.strip():
        raise AddressError(
            "no folder or bucket was given", where=None, advice="give a path or an address; is a variable empty?"
        )
    parts = urlsplit(url)
    if "://" not in url:
        if parts.scheme in BUCKETS:
            raise AddressError(
                f"{url!r} lacks a // behind {parts.scheme}:", where=None, advice=f"write {parts.scheme}://BUCKET/NAME"
            )
        return Path(url)
    if parts.scheme == "file":
        host, _, path = url.partition("://")[2].partition("/")
        if host not in ("", "localhost"):
            raise AddressError(
                f"file:// leads to no other computer, and {host} stands where one is named", where=without_secrets(url),
                advice="write file:///... with three slashes, and mount the folder of another computer",
            )  # fmt: skip
        return Path("/", unquote(path))
    if parts.scheme in BUCKETS:
        return None
    raise AddressError(
        f"{without_secrets(url)!r} is neither a folder nor a bucket",
        where=None,
        advice="give a path, file:///..., s3://..., gs://... or az://...",
    )


def open_bucket(
    url: str,
    *,
    extra: str,
    config: Mapping[str, str] | None = None,
    client: Mapping[str, Any] | None = None,
    retries: int | None = None,
) -> Any:
    """Open a bucket below a prefix and return obstore's store; nothing is sent before its first use.

    - `extra`: Hangtime's extra that installs the library, for the error where it is missing
    - `config`: the store's settings and keys by obstore's names; the environment (AWS_..., GOOGLE_..., AZURE_...)
      supplies the others
    - `client`: obstore's connection settings
    - `retries`: number of retries within the library; None for the library's default

    Raises:
        AddressError: the library is missing, or the address or a setting is refused.
    """
    _refuse_what_is_misread(url, config or {})
    try:
        import obstore
        from obstore.store import from_url
    except ModuleNotFoundError as error:
        raise AddressError(
            "buckets need the library obstore", where=without_secrets(url),
            advice=f"in Hangtime's checkout: pip install -e '.[{extra}]'",
        ) from error  # fmt: skip
    options: dict[str, Any] = {}
    if config:
        options["config"] = dict(config)
    if client:
        options["client_options"] = dict(client)
    if retries is not None:
        options["retry_config"] = {"max_retries": retries, "retry_timeout": timedelta(minutes=3)}
    try:
        return from_url(url.replace("#", "%23"), **options)  # else its address would end there
    except (obstore.exceptions.BaseError, OSError, ValueError, TypeError) as error:
        what, advice = _setting_refused(str(error), config or {}) or (
            f"is no bucket: {first_line(error)}", "check the address, the settings and the names of the keys",
        )  # fmt: skip
        raise AddressError(what, where=without_secrets(url), advice=advice) from error


def _setting_refused(text: str, config: Mapping[str, str]) -> tuple[str, str] | None:
    """Return the faulty setting and the next step for an error at opening; None for another error.

    config: as in `open_bucket`
    """
    if found := UNREAD.search(text):
        settings = {name: value for name, value in os.environ.items() if name.startswith(SETTINGS_BEGIN)} | dict(config)
        names = [name for name, value in settings.items() if value == found[1]]
        name = " or ".join(names) or "a setting"
        wanted, example = VALUES_WANTED.get(found[2], ("one of its values", "one of them"))
        return f"{name} is {found[1]!r}, and has to be {wanted}", f"set it to {example}, or leave it out"
    if "Account must be specified" in text:
        return (
            "an address in Azure needs the name of a storage account, and none is set",
            "set AZURE_STORAGE_ACCOUNT_NAME, and AZURE_STORAGE_ACCOUNT_KEY for its key",
        )
    if "Invalid Access Key" in text:
        return "the key of the storage account is not in base64", "copy AZURE_STORAGE_ACCOUNT_KEY again, all of it"
    if found := NO_SERVICE_ACCOUNT.search(text):
        return (
            f"the file of Google's service account cannot be opened: {found[1]}",
            "set GOOGLE_SERVICE_ACCOUNT to its path",
        )
    if "decode service account" in text:
        return ("the service account for Google is invalid", "give its JSON file in GOOGLE_SERVICE_ACCOUNT")
    return None


def _refuse_what_is_misread(url: str, config: Mapping[str, str]) -> None:
    """Refuse an address of which the library would silently drop or change a part.

    Raises:
        AddressError: the address has a part that no bucket's address has, a server's address is malformed, or a key or
            another setting holds a line break.
    """
    parts = urlsplit(url.replace("#", "%23"))
    place = "CONTAINER@ACCOUNT.dfs.core.windows.net" if parts.scheme in BY_ACCOUNT else "BUCKET"

    def refuse(what: str, advice: str) -> NoReturn:
        raise AddressError(what, where=without_secrets(url), advice=advice)

    if "?" in url:  # what follows may be a signature, which is no part of a name and is not shown
        raise AddressError(
            "has a ? in it, where an address ends", where=f"{without_secrets(url)}?...",
            advice="choose a name without ?, and set keys in the environment",
        )  # fmt: skip
    if not url.isprintable():
        refuse("has a line break or another control character in it", "write the address again")
    if found := re.search("%[0-9A-Fa-f]{2}", url):
        refuse(
            f"has {found[0]} in it, which would be another character in the bucket", f"choose a name without {found[0]}"
        )
    if {".", ".."} & set(parts.path.split("/")):
        refuse("has . or .. as a part of its path, which a bucket does not have", "write the whole name")
    if parts.scheme not in BY_ACCOUNT and re.search("[@:]", parts.netloc):
        refuse("has a port, a user or a password before the bucket's name", f"write {parts.scheme}://BUCKET/NAME")
    bucket, _, account = parts.netloc.partition("@")
    if not bucket:
        refuse("names no bucket", f"write {parts.scheme}://{place}/NAME")
    if not re.fullmatch(BUCKETS_NAME, bucket):
        refuse(f"{unquote(bucket)!r} is no bucket's name", "write the name with letters, digits, dots and hyphens")
    if account and "." not in account:
        refuse(f"{account!r} is no server of a storage account", f"write {parts.scheme}://{place}/NAME")
    kind = next(one for one in ENDPOINTS if parts.scheme in one)
    stated = {name: os.environ.get(name, "") for name in ENDPOINTS[kind]}
    stated |= {name: value for name, value in config.items() if re.search("endpoint|base_url", name.lower())}
    begin = KEYS_BEGIN.get(kind)
    settings = {name: value for name, value in os.environ.items() if begin and name.startswith(begin)} | dict(config)
    for name, value in {**stated, **settings}.items():
        if re.search(r"[\x00-\x1f\x7f]", value):
            refuse(f"{name} holds a line break or another control character", "set it again, without that character")
        if value != value.strip():
            shown = f" (it is {without_secrets(value)!r})" * (name in stated)  # any other may be a key
            refuse(f"{name} begins or ends with a space{shown}", "set it again, without that space")
    for name, value in stated.items():
        if value and not value.startswith(("http://", "https://")):
            refuse(
                f"{name} lacks http:// or https:// (it is {without_secrets(value)})", "write the server's whole address"
            )
        if value and not _is_servers_address(value):
            refuse(f"{name} is no server's address (it is {without_secrets(value)!r})", "write http(s)://NAME:PORT")


def _is_servers_address(text: str) -> bool:
    """Return whether a text is http(s)://NAME, with or without port and path."""
    try:
        parts = urlsplit(text)
        return bool(parts.hostname) and parts.port != 0 and text.isascii() and text.isprintable() and " " not in text
    except ValueError:  # a port that is none, a bracket that is not closed
        return False


def advice_on(error: Exception) -> str:
    """Return the next step for a bucket's error, by the server's own reason where the server gives one."""
    text = str(error)
    store = found[1] if (found := OF_STORE.search(text)) else "S3"
    if "RequestTimeTooSkewed" in text:
        return "set this computer's clock (timedatectl set-ntp true)"
    if is_without_tls(error):
        return f"set {ALLOWING.get(store, ALLOWING['S3'])}=true if the server has no TLS, else write https://"
    if answers_without_tls(error):
        step = f"and set {ALLOWING[store]}=true" if store in ALLOWING else ""
        return f"write http:// for https:// in the server's address {step}".strip() + ", or give its port with TLS"
    if reason := certificates_fault(error):
        return _step_to_trust(reason)
    if is_without_keys(error):
        return f"set {KEYS_OF.get(store, KEYS_OF['S3'])}"
    return "check the address, the network and the access keys"


def is_without_tls(error: Exception) -> bool:
    """Return whether the request was not sent because the server's address has no TLS, and no setting allows that."""
    return BAD_SCHEME in str(error)


def answers_without_tls(error: Exception) -> bool:
    """Return whether a server at an https address answered, and not in TLS."""
    return NO_TLS_ANSWER in str(error)


def certificates_fault(error: Exception) -> str:
    """Return the library's reason to distrust a server's certificate, such as UnknownIssuer; "" for another error."""
    return found[1].removesuffix("Context") if (found := CERTIFICATE.search(str(error))) else ""


def _step_to_trust(reason: str) -> str:
    if reason in ("Expired", "NotValidYet"):
        return "set this computer's clock (timedatectl set-ntp true), or renew the server's certificate"
    if reason == "NotValidForName":
        return "write the name in the address that the certificate is made out for"
    return "add the authority of its certificate to those that this computer trusts, or correct the address"


def is_without_keys(error: Exception) -> bool:
    """Return whether the request was not sent because no access keys are set."""
    return CLOUDS_OWN.search(str(error)) is not None


def is_out_of_reach(error: Exception) -> bool:
    """Return whether no server answered, or one that cannot for a while, so that a later attempt may succeed.

    A server that refuses a request answers with another status. Missing keys, settings that prevent a request, a server
    without TLS and a distrusted certificate do not change by themselves.
    """
    import obstore

    if is_without_tls(error) or is_without_keys(error) or not isinstance(error, obstore.exceptions.GenericError):
        return False
    if answers_without_tls(error) or certificates_fault(error):
        return False
    if kept := KEPT_REASON.search(str(error)):
        return kept[2] in BUSY_CODES
    return "status code" not in str(error) or FOR_A_WHILE.search(str(error)) is not None


def first_line(error: Exception) -> str:
    """Return the server's reason for an error, or the error's first line, with secrets in addresses removed."""
    if reason := SERVERS_REASON.search(str(error)):
        detail = f"{reason[1]}: {reason[2]}" if reason[2] else reason[1]
        return without_secrets(f"the server says {detail}")[:LONGEST_REASON]
    if kept := KEPT_REASON.search(str(error)):
        return without_secrets(f"the server says {kept[2]}: {kept[1]}")[:LONGEST_REASON]
    if is_without_keys(error):
        return "no keys are set, and this computer has none as a machine of the cloud"
    text = OF_STORE.sub("", (str(error).splitlines() or [type(error).__name__])[0].strip())
    if "HTTP error" in text and (request := FAILED_REQUEST.search(text)):
        cause = CAUSE.search(str(error))
        text = f"{request[1]} does not answer" + (f": {cause[1]}" if cause else "")
        if answers_without_tls(error):
            text = f"{request[1]} answers, and not in TLS"
        if distrust := certificates_fault(error):
            text = f"{request[1]} has a certificate that is not trusted: {distrust}"
        if is_without_tls(error):
            text = f"{request[1]} is an address without TLS, to which nothing is sent unasked"
    return without_secrets(text)[:LONGEST_REASON]


def without_secrets(text: str) -> str:
    """Return a text with user, password and query removed from its addresses, since they may be keys and signatures.

    The part behind a # stays: in a bucket it belongs to the name, and elsewhere it is never sent to a server.
    """
    text = re.sub(r"(\b[a-z0-9+]+://)[^\s/@?#]*@", r"\1", text)
    return re.sub(r"(\b[a-z0-9+]+://[^\s?]*)[?][^\s:,;)]*", r"\1", text)
