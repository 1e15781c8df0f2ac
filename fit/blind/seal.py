"""Encryption of withheld labels, which prevents accidental reading and detects changes.

    file = magic, nonce (12 bytes), ChaCha20-Poly1305(key, nonce, text; magic as associated data)

The key is 32 random bytes in a separate file. The seal protects against accidental reading and unnoticed changes;
whoever has the folder has the key. Source: RFC 8439 (ChaCha20 and Poly1305 for IETF protocols), as implemented by
`cryptography`.
"""

from __future__ import annotations

import hashlib
import os
import secrets
from pathlib import Path

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

from fit.errors import FitError
from formats.plain_text import sized
from formats.take_reader import LARGEST_FILE
from formats.whole_files import read_bounded

SEAL_MAGIC = b"hangtime-seal/2\n"
NONCE_BYTES, TAG_BYTES, KEY_BYTES = 12, 16, 32  # bytes; RFC 8439, section 2.8


def seal(text: bytes, key: bytes) -> bytes:
    """Encrypt a text with ChaCha20-Poly1305 and a new nonce."""
    nonce = secrets.token_bytes(NONCE_BYTES)
    return SEAL_MAGIC + nonce + ChaCha20Poly1305(key).encrypt(nonce, text, SEAL_MAGIC)


def unseal(sealed: bytes, key: bytes, *, where: object) -> bytes:
    """Decrypt a sealed text.

    Raises:
        FitError: not a seal, the wrong key, or changed sealed bytes.
    """
    if not sealed.startswith(SEAL_MAGIC) or len(sealed) < len(SEAL_MAGIC) + NONCE_BYTES + TAG_BYTES:
        raise FitError("is not a seal of this version", where=where, advice="give a folder that `blind make` wrote")
    nonce, body = sealed[len(SEAL_MAGIC) : len(SEAL_MAGIC) + NONCE_BYTES], sealed[len(SEAL_MAGIC) + NONCE_BYTES :]
    try:
        return ChaCha20Poly1305(key).decrypt(nonce, body, SEAL_MAGIC)
    except InvalidTag as error:
        raise FitError(
            "the seal is broken: the labels or the key were changed", where=where,
            advice="nothing can be scored against them; make a new set",
        ) from error  # fmt: skip


def load_key(path: Path, *, make: bool = False) -> bytes:
    """Read the key, or create one from the system's random bytes.

    Raises:
        FitError: the key is missing or invalid.
    """
    if make and not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        opened = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(opened, "w") as file:
                file.write(secrets.token_hex(KEY_BYTES) + "\n")
        except OSError as error:
            path.unlink()  # a partial key must not appear
            error.filename = str(path)
            raise
    try:
        key = bytes.fromhex(read_bounded(path).decode().strip())
    except (OSError, ValueError) as error:
        raise FitError(
            "holds no key", where=path, advice="put the key file back: without it the labels stay closed"
        ) from error
    if len(key) != KEY_BYTES:
        raise FitError(
            f"the key has {len(key)} bytes, not {KEY_BYTES}", where=path, advice="put the whole key file back"
        )
    return key


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hex.

    Raises:
        FitError: it is larger than any take, or a pipe or a device.
        OSError: it cannot be read.
    """
    if not path.is_file():
        raise FitError("is no file", where=path, advice="check the path")
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise FitError(f"has {sized(size)}, which no take or answer has", where=path, advice="check the path")
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
