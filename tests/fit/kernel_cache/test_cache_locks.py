"""Taichi's lock in its folder of compiled kernels: whose it may be, when it stays and when it is removed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fit.kernel_cache.index import INDEX, TAICHI_LOCK
from fit.kernel_cache.mending import mend_cache
from fit.kernel_cache.writers import CACHE, WRITERS, claim_writing, open_writers

ROOT = Path(__file__).resolve().parents[3]
STARTED = """
import sys
import time
from fit import runtime
runtime.start(1)
print("started", flush=True)
sys.stdin.read(1)
"""
# What is registered first runs last: this process then hangs at its end, where Taichi writes.
ENDING = (
    """
import atexit
import time
atexit.register(lambda: (print("ends", flush=True), time.sleep(600)))
"""
    + STARTED
)


def run(script, folder):
    """Start a script with this folder of kernels, and return once it has printed its first line."""
    process = subprocess.Popen(
        [sys.executable, "-c", script, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT), CACHE: str(folder)},
    )  # fmt: skip
    assert process.stdout.readline() == "started\n"
    return process


@pytest.fixture
def alone(tmp_path, monkeypatch):
    """A folder of kernels of its own, which no other program has chosen, and the lock in it."""
    monkeypatch.setenv(CACHE, str(tmp_path))
    (tmp_path / TAICHI_LOCK).touch()
    return tmp_path, tmp_path / TAICHI_LOCK


@pytest.fixture(scope="module")
def another(tmp_path_factory):
    """The folder of kernels that another living program with Taichi has chosen."""
    folder = tmp_path_factory.mktemp("shared")
    script = "import taichi, sys; print('started', flush=True); sys.stdin.read(1)"
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | {CACHE: str(folder), "TI_SKIP_VERSION_CHECK": "ON", "ENABLE_TAICHI_HEADER_PRINT": "0"},
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "started\n"
        yield folder
        process.stdin.close()


@pytest.fixture
def shared(another, monkeypatch):
    monkeypatch.setenv(CACHE, str(another))
    for file in another.iterdir():
        file.unlink()
    (another / TAICHI_LOCK).touch()
    return another, another / TAICHI_LOCK


def test_a_lock_that_no_living_process_can_hold_goes_at_once_and_without_a_word(alone, capsys):
    """A stale lock made every process of the next minute compile every kernel again."""
    folder, lock = alone
    mend_cache(folder)
    assert not lock.exists()
    assert capsys.readouterr().err == ""


def test_a_lock_goes_at_once_beside_a_living_process_of_this_program_that_does_not_write(alone):
    """In a batch the other workers live on where one was killed."""
    folder, lock = alone
    lock.unlink()
    with run(STARTED, folder) as process:
        lock.touch()
        mend_cache(folder)
        assert not lock.exists()
        process.stdin.close()
    assert process.returncode == 0


def test_a_process_that_ends_claims_to_write_until_it_is_killed(alone):
    folder, lock = alone
    lock.unlink()
    with run(ENDING, folder) as process:
        process.stdin.close()
        assert process.stdout.readline() == "ends\n"
        lock.touch()
        mend_cache(folder)
        assert lock.exists()
        process.send_signal(signal.SIGKILL)
        process.wait()
        mend_cache(folder)
        assert not lock.exists()


def test_a_claim_waits_for_who_removes_a_lock_and_never_for_longer_than_taichi(alone):
    import fcntl

    folder, _ = alone
    removing, writing = open_writers(folder), open_writers(folder)
    fcntl.flock(removing, fcntl.LOCK_EX)
    start = time.monotonic()
    claim_writing(writing)
    assert 0.1 < time.monotonic() - start < 1.0  # 0.2 s, and the time of a busy computer
    os.close(removing)
    claim_writing(writing)
    with pytest.raises(BlockingIOError):
        fcntl.flock(open_writers(folder), fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(writing)


@pytest.mark.parametrize("kind", ["pipe", "folder", "link that leads to itself"])
def test_anything_under_the_name_of_the_writers_file_stops_nothing(alone, kind):
    folder, lock = alone
    writers = folder / WRITERS
    if kind == "pipe":
        os.mkfifo(writers)
    elif kind == "folder":
        writers.mkdir()
    else:
        writers.symlink_to(writers.name)
    mend_cache(folder)
    claim_writing(open_writers(folder))
    assert lock.exists() is (kind != "pipe")  # a pipe can be locked too


def test_the_lock_of_another_user_stays(alone, monkeypatch):
    folder, lock = alone
    monkeypatch.setattr(os, "getuid", lambda: lock.stat().st_uid + 1)
    mend_cache(folder)
    assert lock.exists()


def test_a_lock_dated_in_the_future_is_stale_too(shared):
    """A computer without a battery for its clock may start in 1970, and a lock of 2033 lies 63 years ahead."""
    folder, lock = shared
    for ahead, is_stale in ((30, False), (90, True), (2e9, True)):
        lock.touch()
        os.utime(lock, (time.time() + ahead,) * 2)
        mend_cache(folder)
        assert lock.exists() is not is_stale, ahead


@pytest.mark.parametrize(("age", "is_told"), [(1, False), (4, False), (8, True), (55, True), (65, False)])
def test_a_lock_that_stays_is_told_with_the_file_to_remove_until_it_is_removed(shared, capsys, age, is_told):
    """Taichi needs it for milliseconds. Each process compiles every kernel anew until it is gone, after 60 s."""
    folder, lock = shared
    os.utime(lock, (time.time() - age,) * 2)
    mend_cache(folder)
    said = capsys.readouterr().err
    assert lock.exists() is (age < 60)
    assert (f"If no other Hangtime runs, remove {lock}.\n" in said) is is_told
    assert (f"has locked them for {age} s" in said) is is_told
    assert is_told or not said


@pytest.mark.parametrize("spelled", ["{folder}/", "{folder}/../{name}", "link"])
def test_a_folder_that_another_program_spells_otherwise_is_the_same(shared, monkeypatch, tmp_path, spelled):
    folder, lock = shared
    (tmp_path / "link").symlink_to(folder)
    own = str(tmp_path / spelled.format(folder=folder, name=folder.name))
    monkeypatch.setenv(CACHE, own + "/" if spelled.endswith("/") else own)
    mend_cache(Path(own))
    assert lock.exists()
    monkeypatch.setenv(CACHE, str(tmp_path))
    (tmp_path / TAICHI_LOCK).touch()
    mend_cache(tmp_path)
    assert not (tmp_path / TAICHI_LOCK).exists(), "the other program has chosen another folder"


def test_a_lock_that_another_process_may_hold_is_left_alone(shared):
    folder, _ = shared
    (folder / INDEX).write_bytes(b"being written")
    mend_cache(folder)
    assert {TAICHI_LOCK, INDEX} <= {file.name for file in folder.iterdir()}
    assert (folder / INDEX).read_bytes() == b"being written"
