"""Sealed labels: nobody reads them by accident, and nobody changes them unseen.

    cipher = plain xor SHA-256(key || 0) SHA-256(key || 1) ...,     seal = HMAC-SHA-256(key, cipher)

The key lies in a file of its own, so that labels can be kept apart from it; the hash of the sealed file is published
with the cases. This guards against peeking and slips, not against somebody who wants to cheat.
Source: H. Krawczyk, M. Bellare, R. Canetti, "HMAC", RFC 2104; counter mode, NIST SP 800-38A, section 6.5.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from pathlib import Path

from fit.errors import FitError

KEY_BYTES = 32


def new_key() -> bytes:
    """Return a fresh key."""
    return secrets.token_bytes(KEY_BYTES)


def seal(plain: bytes, key: bytes) -> bytes:
    """Return the sealed bytes: HMAC, then cipher text."""
    cipher = bytes(a ^ b for a, b in zip(plain, _stream(key, len(plain)), strict=True))
    return hmac.digest(key, cipher, "sha256") + cipher


def unseal(sealed: bytes, key: bytes, where: Path) -> bytes:
    """Return the plain bytes.

    Raises:
        FitError: the key is another one, or the sealed file was changed.
    """
    mark, cipher = sealed[:32], sealed[32:]
    if len(key) != KEY_BYTES or not hmac.compare_digest(mark, hmac.digest(key, cipher, "sha256")):
        raise FitError(
            "the labels do not match their key", where=where, advice="use the key and labels of the same `blind make`"
        )
    return bytes(a ^ b for a, b in zip(cipher, _stream(key, len(cipher)), strict=True))


def hash_of(path: Path) -> str:
    """Return a file's SHA-256."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _stream(key: bytes, length: int) -> bytes:
    blocks = -(-length // 32)
    return b"".join(hashlib.sha256(key + k.to_bytes(8, "big")).digest() for k in range(blocks))[:length]
