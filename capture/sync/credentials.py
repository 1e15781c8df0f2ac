"""Keys of the server: read from systemd's credentials or a file of mode 0600, and hidden everywhere else.

The store's library receives the keys in memory, not through the environment, which child processes inherit, nor the
command line, which every user can read. The process leaves no core dump, and `Credentials.hide` filters all its output.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import stat
from dataclasses import dataclass, field
from pathlib import Path

from capture.errors import SyncError
from formats.toml_files import LARGEST_TOML, parse_toml
from formats.whole_files import read_bounded

PREFIX = "store_"  # systemd's file names for `LoadCredential=store:FOLDER`
SHORTEST_SECRET = 6  # characters; a region or a user's name is no secret, and shorter words occur in texts
PR_SET_DUMPABLE = 4  # linux/prctl.h


@dataclass(frozen=True)
class Credentials:
    """Keys by obstore's names (`access_key_id`, `secret_access_key`, ...); their values are never printed."""

    values: dict[str, str] = field(default_factory=dict, repr=False)

    def hide(self, text: str) -> str:
        """Return a text with all keys removed."""
        for value in sorted(self.values.values(), key=len, reverse=True):
            if len(value) >= SHORTEST_SECRET:
                text = text.replace(value, "***")
        return text


def find_credentials(file: Path | None) -> Credentials:
    """Return the keys: those of systemd (`$CREDENTIALS_DIRECTORY/store_NAME`, one key a file), else those of a file.

    Raises:
        SyncError: the file cannot be read, other users may read it, or it is invalid.
    """
    if folder := os.environ.get("CREDENTIALS_DIRECTORY"):
        found = {}
        for path in sorted(Path(folder).glob(f"{PREFIX}*")):
            try:
                found[path.name[len(PREFIX) :]] = read_bounded(path).decode("utf-8").strip()
            except (OSError, UnicodeDecodeError) as error:
                raise SyncError(
                    "a credential cannot be read", where=path, advice="check the unit's LoadCredential"
                ) from (error)
        if found:
            return Credentials(found)
    return Credentials() if file is None else _of_file(file)


def _of_file(file: Path) -> Credentials:
    try:
        with file.open("rb") as opened:  # perhaps a pipe, through which a keeper of secrets hands the keys
            about = os.fstat(opened.fileno())
            raw = opened.read(LARGEST_TOML + 1)
    except OSError as error:
        raise SyncError(
            f"the credentials cannot be read ({error.strerror})", where=file, advice="check path and owner"
        ) from error
    if stat.S_IMODE(about.st_mode) & 0o077:
        raise SyncError("others may read these credentials", where=file, advice=f"chmod 600 {file}")
    if len(raw) > LARGEST_TOML:
        raise SyncError("is too large for a file of keys", where=file, advice="check the path")
    try:
        found = parse_toml(raw, file, SyncError)
    except SyncError:
        # The parser's message may quote the line, and with it a key.
        raise SyncError(
            "the credentials are not valid TOML", where=file, advice='write one key a line: secret_access_key = "..."'
        ) from None
    if not all(isinstance(value, str) for value in found.values()):
        raise SyncError(
            "a credential is not a text", where=file, advice='write one key a line: secret_access_key = "..."'
        )
    return Credentials(found)


def leave_no_core_dump() -> None:
    """Disable core dumps of this process, and debugging by the same user."""
    with contextlib.suppress(OSError, ValueError):  # a sandbox that forbids the call has set the limit itself
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(PR_SET_DUMPABLE, 0, 0, 0, 0)
