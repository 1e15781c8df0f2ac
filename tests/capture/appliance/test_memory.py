"""Memory of the start is released: only unmodified pages of files are dropped, and the program continues."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from capture.appliance import memory
from capture.appliance.memory import StartingMemory, unwritten_mappings
from tests.capture.appliance.virtual_appliance import ROOT

MAPS = b"""\
7f00-7f10 r-xp 00001000 fe:00 77 /usr/lib/code.so
Rss:                  64 kB
Anonymous:             0 kB
VmFlags: rd ex mr mw me
7f10-7f20 r--p 00002000 fe:00 77 /usr/lib/relocated.so
Anonymous:             4 kB
7f20-7f30 rw-p 00003000 fe:00 77 /usr/lib/data.so
Anonymous:             0 kB
7f30-7f40 r--s 00000000 fe:00 78 /usr/lib/shared.cache
Anonymous:             0 kB
7f40-7f50 r--p 00000000 00:00 0
Anonymous:             0 kB
7f50-7f60 r-xp 00000000 00:00 0                          [vdso]
Anonymous:             0 kB
7f60-7f70 ---p 00000000 fe:00 77 /usr/lib/gap.so
Anonymous:             0 kB
7f70-7f80 r--p 00000000 fe:00 79 /usr/lib/with a space.so (deleted)
Anonymous:             0 kB
"""
WORK = """
import os, cv2, numpy as np
from capture.appliance.memory import StartingMemory, share_one_heap
cv2.setNumThreads(1), share_one_heap()
def work():
    seen = np.random.default_rng(1).integers(0, 255, (480, 640), np.uint8)
    blurred = cv2.GaussianBlur(seen, (5, 5), 0)
    return cv2.imencode('.png', blurred)[1].tobytes(), np.linalg.svd(blurred[:50, :50].astype(float))[1].sum()
resident = lambda: int(open('/proc/self/statm').read().split()[1]) * 4096
before, was = work(), resident()
memory = StartingMemory()
print(len(os.listdir('/proc/self/task')), was - resident())
memory.let_go(10.0, is_started=False), memory.let_go(10.4, is_started=True)
assert not memory.is_over
memory.let_go(10.5, is_started=True), memory.let_go(11.0, is_started=True)
assert memory.is_over
assert work() == before
"""


def test_only_a_mapping_of_a_file_that_may_not_be_written_and_holds_nothing_of_its_own_is_dropped():
    assert unwritten_mappings(MAPS) == {(0x7F00, 0x7F10), (0x7F70, 0x7F80)}


def test_it_gives_back_10_megabytes_and_the_same_work_has_the_same_outcome():
    done = subprocess.run(
        [sys.executable, "-c", WORK], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    threads, given_back = map(int, done.stdout.split())
    if threads > 1:
        pytest.skip("an emulator runs threads of its own in this process")
    assert given_back > 10e6  # at once, for no other thread runs


def test_a_mapping_that_the_first_look_did_not_find_is_left_alone(monkeypatch, tmp_path):
    """A library that is being loaded between two readings, or a kernel that does not report it."""
    dropped = []
    monkeypatch.setattr(memory.ctypes, "CDLL", lambda _: Library(dropped))
    monkeypatch.setattr(memory, "SMAPS", tmp_path / "smaps")
    starting = StartingMemory()
    starting.let_go(0.0, is_started=False)  # there is no such file yet
    (tmp_path / "smaps").write_bytes(MAPS)
    starting.let_go(1.0, is_started=True)
    starting.let_go(1.1, is_started=True)
    assert dropped == []
    starting.let_go(2.0, is_started=True)
    assert {begin for begin, _, _ in dropped} == {0x7F00, 0x7F70}
    assert starting.is_over


class Library:
    """A C library that records the dropped mappings."""

    def __init__(self, dropped):
        self.malloc_trim = lambda _: None

        def madvise(begin, size, how):
            dropped.append((begin, size, how))

        self.madvise = madvise
