"""The settings of sync: the table `[sync]` of the appliance's configuration file, and the folder of takes."""

from __future__ import annotations

import hashlib
import math
import re
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from capture.appliance.config_tables import Config, SpoolPart, read_tables, wrong_in_tables
from capture.appliance.receipts import DEFAULT_URL
from capture.appliance.retention import Retention
from capture.errors import SyncError
from formats.errors import AddressError
from formats.meant_units import meant
from formats.store_address import folder_of
from formats.toml_files import place_in
from formats.wrong_fields import wrong_field

DEFAULT_FILE = Path("/etc/hangtime/appliance.toml")
DEFAULT_SPOOL = Path("/var/lib/hangtime/takes")
PROOF_DAYS = 7.0  # days; our choice: once a week
CONFIG_ADVICE = "give the appliance's configuration; docs/reference/appliance.md explains every table and key"
SETTINGS_ADVICE = "mend it in [sync]; docs/reference/sync.md explains every setting"


@dataclass(frozen=True)
class Range:
    """The numbers that a key accepts: None or 0 where they are `also`, or any from `least` to `most`.

    msgspec's own ranges, which the other tables have, know no single value beside a range. The settings of retention
    are checked where a file states them, because the daemon builds others.

    - `unit`: in words; `others`: names of other units, and how many of the key's unit each is
    """

    least: float
    most: float
    unit: str
    others: tuple[tuple[str, float], ...]
    also: tuple[float | None, ...] = ()

    def check(self, name: str, value: float | None) -> None:
        """Refuse a number outside the range.

        Raises:
            ValueError: names the key, its range, and the unit that was probably meant.
        """
        if value in self.also:
            return
        if value is None or not self.least <= value <= self.most:
            also = "".join(f" or {one:g}" for one in self.also if one is not None)
            also += ", or leave it out" if None in self.also else ""
            question = meant(value, self.least, self.most, self.others) if value else ""
            given = f"{name} is {value:.16g}" if value is not None else f"{name} is missing"
            raise ValueError(f"{given}; give {self.least:.16g} to {self.most:.16g} {self.unit}{also}{question}")


SECONDS, MILLISECONDS = ("seconds", 1 / 86_400), ("milliseconds", 1e-3)
MB = 1_000_000  # bytes, by the SI prefix
BYTES = (("kB", 1e3), ("MB", 1e6), ("GB", 1e9))
RANGES = {
    "bytes_per_second": Range(1e3, 1e10, "bytes a second", BYTES, (None,)),
    "timeout_s": Range(1.0, 86_400.0, "seconds", (MILLISECONDS,)),
    "proof_days": Range(0.01, 366.0, "days", (SECONDS,)),
}
RANGES_OF_RETENTION = {
    "quota_bytes": Range(1e7, 1e15, "bytes", BYTES, (0,)),
    "least_free_bytes": Range(1e6, 1e15, "bytes", BYTES, (0,)),
    "days": Range(0.0, 36_600.0, "days", (SECONDS,), (math.inf,)),
}  # a take of minutes has megabytes, no store of takes has a petabyte, and a day in seconds is above a century in days


class SyncSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The table `[sync]`.

    - `url`: the server's folder or bucket
    - `device`: the name of this device on the server; its host name and a part of its machine id where left out
    - `endpoint`, `region`: of an S3-compatible server
    - `ca`: certificate of the authority that signed the server's certificate, PEM; the system's also stay valid
    - `allow_http`: whether a server without TLS is accepted
    - `credentials`: file of keys (TOML, mode 0600); systemd's credentials take precedence
    - `encrypt_to`: age recipients (`age1...`) for which takes are encrypted before upload
    - `bytes_per_second`: limit of the upload rate, averaged over a take or 5 MiB; None: no limit
    - `timeout_s`: time limit of one request; at 17 kB/s a part of 5 MiB takes 300 s
    - `proof_days`: days between two proofs, which fetch, hash and open a take
    - `retention`: how long takes stay on the device
    """

    url: str = DEFAULT_URL
    device: str = ""
    endpoint: str | None = None
    region: str | None = None
    ca: Path | None = None
    allow_http: bool = False
    credentials: Path | None = None
    encrypt_to: tuple[str, ...] = ()
    bytes_per_second: float | None = None
    timeout_s: float = 300.0  # s; our choice: as the docstring states
    proof_days: float = PROOF_DAYS
    retention: Retention = Retention()

    def __post_init__(self) -> None:
        if self.device and not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]{0,62}", self.device):
            raise ValueError(f"device is {self.device!r}; give letters, digits, '.', '_' and '-', 63 at most")
        for name, limits in RANGES.items():
            limits.check(name, getattr(self, name))


@dataclass(frozen=True)
class SyncSetup:
    """The whole configuration of sync: its settings, the folder of takes and the folder for relative paths."""

    settings: SyncSettings
    spool: Path
    base: Path = Path()

    @property
    def device(self) -> str:
        """Return the name of this device on the server."""
        return self.settings.device or own_name()


def load_settings(file: Path, spool: Path | None = None) -> SyncSetup:
    """Read `[sync]` and the spool's folder from the appliance's configuration file.

    spool: folder of takes that replaces the file's

    Raises:
        SyncError: the file or the table is invalid.
    """
    plain = read_tables(file, SyncError)
    _refuse_another_file(plain, file)
    settings = settings_of(plain.get("sync", {}), where=file, plain=plain)
    folder = plain.get("spool", {}).get("folder", str(DEFAULT_SPOOL))
    return SyncSetup(settings, spool or file.parent / str(folder), file.parent)


def _refuse_another_file(plain: dict[str, Any], file: Path) -> None:
    """Check that a file is a configuration of the appliance, without unknown keys.

    The daemon needs more tables than sync, so missing tables are no error here.

    Raises:
        SyncError: the file is of another kind or has an unknown key; the message names the key and its line.
    """
    parts = {field.name: field.type for field in msgspec.structs.fields(Config) if field.name != "sync"}
    try:
        if unknown := [name for name in plain if name not in parts and name != "sync"]:
            stated = plain.get("format")
            kind = f"; the file states format {stated}" if isinstance(stated, str) else ""
            raise SyncError(
                f"is no configuration of an appliance: unknown field `{unknown[0]}`{kind}",
                where=place_in(file, plain, f"unknown field `{unknown[0]}`"), advice=CONFIG_ADVICE,
            )  # fmt: skip
        for name, table in plain.items():
            if name in parts and not isinstance(table, dict):
                raise SyncError(f"{name} must be a table", where=place_in(file, plain, name), advice=CONFIG_ADVICE)
        if "spool" in plain:
            msgspec.convert({"spool": plain["spool"]}, _Spool, dec_hook=_path)
        for name, kind in parts.items():
            known = {field.name for field in msgspec.structs.fields(kind)}
            if wrong := [key for key in plain.get(name, {}) if key not in known]:
                words = f"unknown field `{wrong[0]}` in {name}"
                raise SyncError(words, where=place_in(file, plain, words), advice=CONFIG_ADVICE)
    except msgspec.ValidationError as error:
        words = wrong_in_tables(error, plain)
        raise SyncError(words, where=place_in(file, plain, words), advice=CONFIG_ADVICE) from error


class _Spool(msgspec.Struct, frozen=True, kw_only=True):
    """The daemon's table that sync also reads."""

    spool: SpoolPart


def settings_of(table: Any, *, where: object, plain: dict[str, Any] | None = None) -> SyncSettings:
    """Return the settings of a table; plain: the text of the file, in which an invalid key's line is found.

    Raises:
        SyncError: the table is invalid.
    """
    try:
        settings = msgspec.convert(table, SyncSettings, dec_hook=_path)
        for name, limits in RANGES_OF_RETENTION.items():
            limits.check(f"retention.{name}", getattr(settings.retention, name))
        folder_of(settings.url)
    except msgspec.ValidationError as error:
        words = wrong_field(error, (SyncSettings, Retention), table)
        words = re.sub(r"^retention: (?=\w+ is )", "retention.", words)  # an error of Retention's own check
        place = where if plain is None else place_in(where, plain, words, table="sync")
        raise SyncError(f"[sync] is invalid: {words}", where=place, advice=SETTINGS_ADVICE) from error
    except ValueError as error:
        place = where if plain is None else place_in(where, plain, str(error), table="sync")
        raise SyncError(f"[sync] is invalid: {error}", where=place, advice=SETTINGS_ADVICE) from error
    except AddressError as error:
        raise SyncError(f"url: {error.what}", where=where, advice=error.advice) from error
    return settings


def own_name() -> str:
    """Return a unique name for this device: host name and eight digits derived from the machine id."""
    host = re.sub(r"[^A-Za-z0-9._-]", "-", socket.gethostname())[:50].lstrip("._-") or "device"
    try:
        machine = Path("/etc/machine-id").read_text().strip()
    except OSError:
        return host
    # The id itself is confidential (machine-id(5)).
    return f"{host}-{hashlib.sha256(f'hangtime {machine}'.encode()).hexdigest()[:8]}"


def _path(kind: type, value: Any) -> Any:
    if kind is Path and isinstance(value, str) and value:
        return Path(value)
    raise ValueError("a path must be a text that is not empty")
