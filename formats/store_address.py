"""Addresses of stores, opened in one place: a folder (a path or file:///...) or a bucket (s3://, gs://, az://).

A bucket is opened with the library obstore. It is imported only where a bucket is opened: a folder needs no library.
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

BUCKETS = ("s3", "s3a", "gs", "az", "abfs", "abfss")
BY_ACCOUNT = ("abfs", "abfss")  # their addresses are CONTAINER@ACCOUNT
ENDPOINTS = ("AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT")
SERVERS_REASON = re.compile(r"<Code>([^<]+)</Code>\s*(?:<Message>([^<]*)</Message>)?")  # of S3's error documents
REQUEST = re.compile(r"Error performing [A-Z]+ ([a-z]+://[^\s/?]+)")  # of obstore's errors
CAUSE = re.compile(r"(?:message: \"|failed to lookup address information: )([^\"]+)\"")
KEYS_BEGIN = ("AWS_", "AZURE_")  # names of what becomes headers of requests; Google's keys are JSON of several lines
LONGEST_REASON = 200  # characters of an error that are passed on


def folder_of(url: str) -> Path | None:
    """Return the folder that an address leads to, or None if it leads to a bucket.

    Raises:
        AddressError: no address, or one of another kind.
    """
    if not url.strip():
        raise AddressError("no folder or bucket was given", advice="give a path or an address; is a variable empty?")
    parts = urlsplit(url)
    if "://" not in url:
        if parts.scheme in BUCKETS:
            raise AddressError(
                f"{url!r} lacks a // behind {parts.scheme}:", advice=f"write {parts.scheme}://BUCKET/NAME"
            )
        return Path(url)
    if parts.scheme == "file":
        return Path(unquote(parts.path))
    if parts.scheme in BUCKETS:
        return None
    raise AddressError(
        f"{without_secrets(url)!r} is neither a folder nor a bucket",
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
    """Open a bucket below a prefix; returns obstore's store. Nothing is sent before its first use.

    - `extra`: Hangtime's extra that brings the library, for the message where it is missing
    - `config`: the store's settings and keys by obstore's names; the environment (AWS_..., GOOGLE_..., AZURE_...)
      gives the others
    - `client`: obstore's settings of connections
    - `retries`: how often the library itself tries a failed request again; None leaves it to the library

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
        return from_url(url, **options)
    except (obstore.exceptions.BaseError, OSError, ValueError, TypeError) as error:
        raise AddressError(
            f"is no bucket: {first_line(error)}",
            where=without_secrets(url),
            advice="check the address, the settings and the names of the keys",
        ) from error


def _refuse_what_is_misread(url: str, config: Mapping[str, str]) -> None:
    """Refuse what the library would leave out of an address without a word, change, or end at.

    Raises:
        AddressError: the address has a part that no bucket's address has, a server's address is none, or a key or
            another setting holds a line break.
    """
    parts = urlsplit(url)

    def refuse(what: str, advice: str) -> NoReturn:
        raise AddressError(what, where=without_secrets(url), advice=advice)

    for sign in "#?":
        if sign in url:
            refuse(f"has a {sign} in it, where an address ends", f"choose a name without {sign}")
    if not url.isprintable():
        refuse("has a line break or another control character in it", "write the address again")
    if found := re.search("%[0-9A-Fa-f]{2}", url):
        refuse(f"has {found[0]} in it, which would be another sign in the bucket", f"choose a name without {found[0]}")
    if {".", ".."} & set(parts.path.split("/")):
        refuse("has . or .. as a part of its path, which a bucket does not have", "write the whole name")
    if parts.scheme not in BY_ACCOUNT and re.search("[@:]", parts.netloc):
        refuse("has a port, a user or a password before the bucket's name", f"write {parts.scheme}://BUCKET/NAME")
    stated = {name: os.environ.get(name, "") for name in ENDPOINTS}
    stated |= {name: value for name, value in config.items() if "endpoint" in name.lower()}
    for name, value in stated.items():
        if value and not value.startswith(("http://", "https://")):
            refuse(
                f"{name} lacks http:// or https:// (it is {without_secrets(value)})", "write the server's whole address"
            )
        if value and not _is_servers_address(value):
            refuse(f"{name} is no server's address (it is {without_secrets(value)!r})", "write http(s)://NAME:PORT")
    settings = {name: value for name, value in os.environ.items() if name.startswith(KEYS_BEGIN)} | dict(config)
    for name, value in settings.items():
        if re.search(r"[\x00-\x1f\x7f]", value):
            refuse(f"{name} holds a line break or another control character", "set it again, without that character")


def _is_servers_address(text: str) -> bool:
    """Return whether a text is http(s)://NAME, with a port and a path or without."""
    try:
        parts = urlsplit(text)
        return bool(parts.hostname) and parts.port != 0 and text.isascii() and text.isprintable() and " " not in text
    except ValueError:  # a port that is none, a bracket that is not closed
        return False


def advice_on(error: Exception) -> str:
    """Return the advice on an error of a bucket, by the server's own reason where it gives one."""
    if "RequestTimeTooSkewed" in str(error):
        return "set this computer's clock (timedatectl set-ntp true)"
    return "check the address, the network and the access keys"


def is_out_of_reach(error: Exception) -> bool:
    """Return whether no server answered: one that answers and refuses says so with a status."""
    import obstore

    return isinstance(error, obstore.exceptions.GenericError) and "status code" not in str(error)


def first_line(error: Exception) -> str:
    """Return the server's own reason for an error, or the error's first line, without secrets of addresses."""
    if reason := SERVERS_REASON.search(str(error)):
        told = f"{reason[1]}: {reason[2]}" if reason[2] else reason[1]
        return without_secrets(f"the server says {told}")[:LONGEST_REASON]
    text = (str(error).splitlines() or [type(error).__name__])[0].strip()
    if "HTTP error" in text and (request := REQUEST.search(text)):
        cause = CAUSE.search(str(error))
        text = f"{request[1]} does not answer" + (f": {cause[1]}" if cause else "")
    return without_secrets(text)[:LONGEST_REASON]


def without_secrets(text: str) -> str:
    """Return a text without the user, password and query of the addresses in it: they may be keys and signatures."""
    text = re.sub(r"(\b[a-z0-9+]+://)[^\s/@?#]*@", r"\1", text)
    return re.sub(r"(\b[a-z0-9+]+://[^\s?#]*)[?#][^\s:,;)]*", r"\1", text)
