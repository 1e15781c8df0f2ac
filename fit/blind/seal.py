"""The seal around withheld labels: whoever opens it does so on purpose, and nobody can change what was sealed.

    file = magic, nonce (16 bytes), text XOR stream, HMAC-SHA256(mac key, everything before)
    stream = SHA256(text key, nonce, 0), SHA256(text key, nonce, 1), ...

with both keys derived by SHA256 from 32 random bytes that lie in a file of their own. This protects against accidental
looks and unnoticed changes; whoever has the folder has the key.
Source: counter mode, NIST SP 800-38A, section 6.5; encrypt-then-MAC, M. Bellare & C. Namprempre (ASIACRYPT 2000);
RFC 2104 (HMAC).
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
from pathlib import Path

from fit.errors import FitError

MAGIC = b"hangtime-seal/1\n"
NONCE, MAC, KEY = 16, 32, 32  # bytes


def seal(text: bytes, key: bytes) -> bytes:
    """Return the sealed text."""
    nonce = secrets.token_bytes(NONCE)
    body = MAGIC + nonce + _xor(text, _derived(key, b"text"), nonce)
    return body + hmac.digest(_derived(key, b"mac"), body, "sha256")


def unseal(sealed: bytes, key: bytes, *, where: object = None) -> bytes:
    """Return the text.

    Raises:
        FitError: not a seal, the wrong key, or sealed bytes that were changed.
    """
    if not sealed.startswith(MAGIC) or len(sealed) < len(MAGIC) + NONCE + MAC:
        raise FitError("is not a seal of this version", where=where, advice="give a folder that `blind make` wrote")
    body, mac = sealed[:-MAC], sealed[-MAC:]
    if not hmac.compare_digest(hmac.digest(_derived(key, b"mac"), body, "sha256"), mac):
        raise FitError(
            "the seal is broken: the labels or the key were changed", where=where,
            advice="nothing can be scored against them; make a new set",
        )  # fmt: skip
    nonce = body[len(MAGIC) : len(MAGIC) + NONCE]
    return _xor(body[len(MAGIC) + NONCE :], _derived(key, b"text"), nonce)


def _derived(key: bytes, purpose: bytes) -> bytes:
    return hashlib.sha256(key + purpose).digest()


def _xor(text: bytes, key: bytes, nonce: bytes) -> bytes:
    blocks = -(-len(text) // 32)
    stream = b"".join(hashlib.sha256(key + nonce + k.to_bytes(8, "big")).digest() for k in range(blocks))
    return bytes(a ^ b for a, b in zip(text, stream, strict=False))


def load_key(path: Path, *, make: bool = False) -> bytes:
    """Read the key, or make one of the system's random bytes.

    Raises:
        FitError: there is no key, or it is not one.
    """
    if make and not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        opened = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(opened, "w") as file:
                file.write(secrets.token_hex(KEY) + "\n")
        except OSError as error:
            path.unlink()  # half a key would be taken for one
            error.filename = str(path)
            raise
    try:
        key = bytes.fromhex(path.read_text().strip())
    except (OSError, ValueError) as error:
        raise FitError("holds no key", where=path, advice="without it the labels stay closed") from error
    if len(key) != KEY:
        raise FitError(f"the key has {len(key)} bytes, not {KEY}", where=path, advice="restore the key file")
    return key


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hex."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
