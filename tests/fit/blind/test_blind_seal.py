"""The seal opens with its key, and fails with an error after any change."""

from __future__ import annotations

import subprocess
import sys

import pytest

from fit.blind.seal import load_key, seal, unseal
from fit.errors import FitError

KEY = bytes(range(32))
TEXT = b'{"case": "hem"}' * 20


def test_a_seal_opens_with_its_key_and_hides_the_text():
    sealed = seal(TEXT, KEY)
    assert unseal(sealed, KEY, where="labels") == TEXT
    assert b"hem" not in sealed
    assert seal(TEXT, KEY) != sealed  # a fresh nonce each time


def test_a_wrong_key_does_not_open_it():
    with pytest.raises(FitError, match="the seal is broken"):
        unseal(seal(TEXT, KEY), bytes(32), where="labels")


@pytest.mark.parametrize("place", [16, 27, 28, 100, -17, -1])  # nonce, text and tag, each at both ends
def test_any_changed_byte_breaks_it(place):
    sealed = bytearray(seal(TEXT, KEY))
    sealed[place] ^= 1
    with pytest.raises(FitError, match="the seal is broken"):
        unseal(bytes(sealed), KEY, where="labels")


def test_a_file_that_is_no_seal_is_refused():
    with pytest.raises(FitError, match="is not a seal"):
        unseal(b"hello", KEY, where="labels")
    with pytest.raises(FitError, match="is not a seal"):
        unseal(seal(TEXT, KEY)[:40], KEY, where="labels")


def test_a_key_is_made_once_and_only_its_owner_reads_it(tmp_path):
    path = tmp_path / "sealed" / "key"
    key = load_key(path, make=True)
    assert len(key) == 32
    assert load_key(path, make=True) == key
    assert path.stat().st_mode & 0o077 == 0
    path.write_text("abc")
    with pytest.raises(FitError, match="holds no key"):
        load_key(path)
    path.write_text("abcd")
    with pytest.raises(FitError, match="2 bytes, not 32"):
        load_key(path)


@pytest.mark.slow
def test_of_a_key_that_no_disk_holds_nothing_is_left(tmp_path):
    """In a process whose files hold not a byte: `blind make` once left an empty key, and then refused it."""
    make = ["-B", "-m", "formats.command", "blind", "make", str(tmp_path / "set"), "--nulls", "1"]
    full = ["sh", "-c", 'ulimit -f 0; exec "$@"', "sh", sys.executable, *make]
    done = subprocess.run(full, capture_output=True, text=True)
    assert done.returncode == 2
    assert "set/sealed/key: cannot be written (File too large); raise the limit" in done.stderr
    assert "Traceback" not in done.stderr
    assert list((tmp_path / "set/sealed").iterdir()) == []
