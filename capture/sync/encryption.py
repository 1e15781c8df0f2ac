"""Encryption before upload with age: the device holds public keys only, and cannot decrypt its uploads.

Format: age-encryption.org/v1, by the library pyrage (rage's Python binding). `age -d -i KEY FILE` opens an object.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import IO, Any

from capture.errors import SyncError


def recipients_of(texts: Sequence[str]) -> list[Any]:
    """Return the age recipients of these texts (`age1...`, or an SSH public key).

    Raises:
        SyncError: the library is missing, or a text is not a recipient.
    """
    if not texts:
        return []
    try:
        import pyrage
    except ModuleNotFoundError as error:
        raise SyncError(
            "encryption needs the library pyrage",
            where="[sync] encrypt_to",
            advice="in Hangtime's checkout: pip install -e '.[capture]'",
        ) from error
    found = []
    for text in texts:
        if text.startswith("AGE-SECRET-KEY-"):
            raise SyncError(
                "encrypt_to holds a secret key", where="[sync]",
                advice="take it off this device and give its recipient (`age-keygen -y KEY`), which begins with age1",
            )  # fmt: skip
        kind = pyrage.ssh if text.startswith("ssh-") else pyrage.x25519
        try:
            found.append(kind.Recipient.from_str(text))
        except pyrage.RecipientError as error:
            raise SyncError(
                f"{text!r} is no age recipient",
                where="[sync] encrypt_to",
                advice="give age1... as `age-keygen` prints it",
            ) from error
    return found


def encrypt(plain: IO[bytes], to: IO[bytes], recipients: Sequence[Any]) -> None:
    """Encrypt a file into another for every recipient, in constant memory."""
    import pyrage

    pyrage.encrypt_io(plain, to, list(recipients))
