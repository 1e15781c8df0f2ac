"""Taichi's folder of compiled kernels: where it is, what is damaged in it, and what is set aside."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from fit.kernel_cache import place
from fit.kernel_cache.index import INDEX, TAICHI_LOCK, sizes_of_kernels
from fit.kernel_cache.mending import mend_cache
from fit.kernel_cache.notes import NOTED, noted_hashes

ROOT = Path(__file__).resolve().parents[3]


SQUARES = """
import typer
from fit import cli, runtime
cli.add_commands(typer.Typer())
import taichi as ti
runtime.start(1)
@ti.kernel
def squares(n: ti.i32) -> ti.i32:
    total = 0
    for k in range(n):
        total += k * k
    return total
print(squares(4))
"""


@pytest.mark.parametrize("home", [None, pytest.param("/dev/null", marks=pytest.mark.slow)])
def test_without_a_home_kernels_run_all_the_same_and_nothing_is_left(tmp_path, home):
    """Taichi's import ends the process with 134 without HOME, and its end with 139 where HOME cannot be written."""
    left_out = ("HOME", "XDG_CACHE_HOME", place.CACHE)
    surroundings = {k: v for k, v in os.environ.items() if k not in left_out} | {"TMPDIR": str(tmp_path)}
    if home is not None:
        surroundings["HOME"] = home
    script = tmp_path / "squares.py"
    script.write_text(SQUARES)
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True,
        env=surroundings | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "14\n", "")
    assert list(tmp_path.iterdir()) == [script]


def test_the_folder_of_kernels_is_made_with_the_folders_above_it(tmp_path, monkeypatch):
    own = tmp_path / "not" / "there" / "yet"
    monkeypatch.setenv(place.CACHE, str(own))
    at_the_end = []
    monkeypatch.setattr(place, "atexit", SimpleNamespace(register=lambda *given: at_the_end.append(given)))
    assert place.mended_cache(None) == {}
    assert own.is_dir()
    assert [given[:3] for given in at_the_end] == [(place._note_own_kernels, None, own)]


def test_a_simulation_counts_as_running_until_it_ends_even_by_an_error(monkeypatch):
    monkeypatch.setattr(place._Work, "running", 0)
    monkeypatch.setattr(place._Work, "is_counted", False)
    with place.at_work(), place.at_work():
        assert (place._Work.running, place._Work.is_counted) == (2, True)
    with pytest.raises(InterruptedError), place.at_work():
        raise InterruptedError
    assert place._Work.running == 0


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A folder with the compiled kernel of SQUARES, the script without the commands, and how to run it there."""
    folder = tmp_path_factory.mktemp("cache")
    script = folder / "squares.py"
    script.write_text("from fit import runtime" + SQUARES.partition("add_commands(typer.Typer())")[2])

    def run():
        return subprocess.run(
            [sys.executable, script], capture_output=True, text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT), place.CACHE: str(folder / "kernels")},
        )  # fmt: skip

    done = run()
    assert (done.returncode, done.stdout) == (0, "14\n"), done.stderr
    return folder / "kernels", run


def test_a_damaged_cache_and_a_lock_left_behind_stop_no_fit(cache):
    """With byte 35 set to 255 a name is 2^40 characters long, and Taichi alone ends for want of memory."""
    folder, run = cache
    index, lock = folder / INDEX, folder / TAICHI_LOCK
    whole = index.read_bytes()
    index.write_bytes(whole[:35] + b"\xff" + whole[36:])
    lock.touch()
    os.utime(lock, (0, 0))
    done = run()
    assert (done.returncode, done.stdout, done.stderr) == (0, "14\n", "")
    assert not lock.exists()
    assert index.with_name("ticache.tcb.damaged").read_bytes()[35] == 255
    assert sizes_of_kernels(index.read_bytes())


def test_an_index_is_sound_only_as_a_whole(cache):
    folder, _ = cache
    whole = (folder / INDEX).read_bytes()
    assert sizes_of_kernels(whole) == {file.stem: file.stat().st_size for file in folder.glob("*.tic")}
    assert [cut for cut in range(len(whole)) if sizes_of_kernels(whole[:cut]) is not None] == []
    assert sizes_of_kernels(whole + b"\0") is None
    zero = whole[:39] + b"\0" + whole[40:104] + b"\0"
    assert sizes_of_kernels(zero + whole[len(zero) :]) is None
    for at in (0, 25, 30, 35, 60, 105, 110):  # lengths and names: of these Taichi survives but 0 and 60
        assert sizes_of_kernels(whole[:at] + b"\xff" + whole[at + 1 :]) is None, at


@pytest.mark.parametrize("change", ["exchanged", "gone"])
def test_kernels_under_wrong_names_are_compiled_again_and_kept(cache, change):
    """Taichi alone computes 1110704128 for 3 x 3 from an exchanged file, or ends with a segmentation fault."""
    folder, run = cache
    index, (kernel,) = folder / INDEX, folder.glob("*.tic")
    whole = kernel.read_bytes()
    if change == "gone":
        kernel.unlink()
    else:
        kernel.write_bytes(b"TIC" + whole)
    done = run()
    assert (done.returncode, done.stdout, done.stderr) == (0, "14\n", "")
    assert kernel.read_bytes() == whole
    assert list(sizes_of_kernels(index.read_bytes())) == [kernel.stem]


TWO_KERNELS = """
from fit import runtime
import taichi as ti
runtime.start(1)
@ti.kernel
def and_five(n: ti.i32) -> ti.i32:
    return n * 1005
@ti.kernel
def and_nine(n: ti.i32, m: ti.i32) -> ti.i32:
    return n * 1009 + m
print(and_five(1), and_nine(1, 0))
"""


def test_kernels_of_one_size_that_are_exchanged_are_compiled_again(tmp_path):
    """Taichi alone prints two wrong numbers. The index gets the exchanged sizes, as of kernels that have one size."""
    script, folder = tmp_path / "two.py", tmp_path / "kernels"
    script.write_text(TWO_KERNELS)
    surroundings = os.environ | {"PYTHONPATH": str(ROOT), place.CACHE: str(folder)}

    def run():
        done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=surroundings)
        return done.returncode, done.stdout, done.stderr

    right, index, damaged = (0, "1005 1009\n", ""), folder / INDEX, folder / f"{INDEX}.damaged"
    assert run() == right
    one, other = folder.glob("*.tic")
    whole = {file: file.read_bytes() for file in (one, other)}
    one.write_bytes(whole[other])
    other.write_bytes(whole[one])
    names = [file.stem.encode() for file in (one, other)]
    held = index.read_bytes().replace(names[0], b"*" * len(names[0])).replace(names[1], names[0])
    index.write_bytes(held.replace(b"*" * len(names[0]), names[1]))
    assert run() == right
    damaged.unlink()
    assert {file: file.read_bytes() for file in whole} == whole
    assert run() == right
    assert not damaged.exists()


SILENT_SERVER = """
import sys
from urllib import request
def urlopen(*asked, **how):
    print("asked a server", file=sys.stderr)
    time.sleep(600)
request.urlopen = urlopen
"""


def test_kernels_are_noted_also_where_a_server_would_not_answer(tmp_path):
    """Taichi by itself asks a server for its newest version, in a thread that outlives a short program."""
    script, folder = tmp_path / "squares.py", tmp_path / "kernels"
    script.write_text(SILENT_SERVER + SQUARES)
    left_out = ("XDG_CACHE_HOME", "TI_SKIP_VERSION_CHECK")  # as at a user's first start
    surroundings = {k: v for k, v in os.environ.items() if k not in left_out}
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True,
        env=surroundings | {"HOME": str(tmp_path), "PYTHONPATH": str(ROOT), place.CACHE: str(folder)},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "14\n", "")
    (kernel,) = folder.glob("*.tic")
    assert list(noted_hashes(folder)) == [kernel.stem]


@pytest.mark.parametrize("kind", ["pipe", "folder", "link that leads to itself"])
def test_what_is_no_file_under_a_kernels_name_is_put_aside(cache, kind):
    """Taichi alone never ends, or writes a traceback."""
    folder, run = cache
    (kernel,) = folder.glob("*.tic")
    kernel.unlink()
    if kind == "pipe":
        os.mkfifo(kernel)
    elif kind == "folder":
        kernel.mkdir()
    else:
        kernel.symlink_to(kernel.name)
    done = run()
    assert (done.returncode, done.stdout, done.stderr) == (0, "14\n", "")
    aside = kernel.with_name(f"{kernel.name}.damaged")
    assert os.path.lexists(aside)
    if kind == "folder":
        aside.rmdir()
    else:
        aside.unlink()


@pytest.mark.parametrize("kind", ["nothing", "no text", "pipe", "folder"])
def test_a_note_on_kernels_that_holds_none_is_written_anew_or_left(cache, kind):
    folder, run = cache
    note = folder / NOTED
    note.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(note)
    elif kind == "folder":
        note.mkdir()
    else:
        note.write_bytes(b"" if kind == "nothing" else b"\xff{")
    done = run()
    assert (done.returncode, done.stdout, done.stderr) == (0, "14\n", "")
    if kind == "folder":
        note.rmdir()
    note.unlink(missing_ok=True)


def test_a_cache_that_takes_no_note_is_used_all_the_same(tmp_path, monkeypatch):
    """The disk is full, or the note belongs to another user of a shared folder."""

    def refuse(folder):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setenv(place.CACHE, str(tmp_path))
    monkeypatch.setattr(place, "note_kernels", refuse)
    monkeypatch.setattr("atexit.register", lambda *_: None)
    assert place.mended_cache(None) == {}
    assert os.environ[place.CACHE] == str(tmp_path)


@pytest.mark.parametrize("kind", ["300 GB", "pipe", "folder"])
def test_an_index_of_any_size_or_kind_is_put_aside_unread(tmp_path, kind):
    index = tmp_path / INDEX
    if kind == "pipe":
        os.mkfifo(index)
    elif kind == "folder":
        index.mkdir()
    else:
        with index.open("wb") as file:
            file.truncate(300 << 30)
    mend_cache(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [INDEX + ".damaged"]
