"""Run commands as somebody whom the permissions of files hold for: root's do not."""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterator

import pytest

from tests.fit.here import Done, hangtime_here

# Of Linux, `man 2 capset` and `man 7 capabilities`: the version of 64 capabilities, and the numbers of two of them.
VERSION, DAC_OVERRIDE, DAC_READ_SEARCH = 0x20080522, 1, 2
EFFECTIVE = 0  # place of the set that counts, before permitted and inheritable ones


@contextlib.contextmanager
def without_permissions() -> Iterator[None]:
    """Within the block, the permissions of files hold for this thread, also where root runs it."""
    if os.geteuid():
        yield
        return
    call, head, sets = ctypes.CDLL(None, use_errno=True), (ctypes.c_uint32 * 2)(VERSION), (ctypes.c_uint32 * 6)()
    if call.capget(head, sets):
        pytest.skip(f"the system names no capabilities of root ({os.strerror(ctypes.get_errno())})")
    before = sets[EFFECTIVE]
    sets[EFFECTIVE] = before & ~(1 << DAC_OVERRIDE | 1 << DAC_READ_SEARCH)
    assert call.capset(head, sets) == 0
    try:
        yield
    finally:
        sets[EFFECTIVE] = before
        assert call.capset(head, sets) == 0


def hangtime_unprivileged(*commands, folder) -> list[Done]:
    """Run commands, each given as its words, one after the other; returns how each ended."""
    with without_permissions():
        return [hangtime_here(*words, folder=folder) for words in commands]
