"""A file is written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from formats.archive import write_take
from formats.errors import OutputError
from formats.outputs import write_bytes
from formats.whole_files import is_hidden, make_folders, read_bounded, write_whole
from tests.formats.test_archive import a_take


def test_a_file_is_replaced_whole_and_readable_by_others(tmp_path):
    path = tmp_path / "a.json"
    write_whole(path, b"one")
    write_whole(path, b"two")
    assert path.read_bytes() == b"two"
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    assert os.listdir(tmp_path) == ["a.json"]


def test_a_write_that_fails_leaves_what_was_there_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    write_whole(path, b"one")

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_whole(path, b"two")
    assert path.read_bytes() == b"one"
    assert os.listdir(tmp_path) == ["a.json"]


def synced(monkeypatch):
    """Record the paths that are synced to the disk from now on, in order."""
    seen, sync = [], os.fsync

    def look(descriptor):
        seen.append(os.readlink(f"/proc/self/fd/{descriptor}"))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", look)
    return seen


def test_the_name_of_a_file_is_put_on_the_disk_after_its_content(tmp_path, monkeypatch):
    seen = synced(monkeypatch)
    write_whole(tmp_path / "a.json", b"one")
    assert len(seen) == 2
    assert seen[0].endswith(".partial")
    assert seen[1] == str(tmp_path)


def test_names_of_a_folder_that_nobody_may_read_are_put_on_the_disk_with_everything_else(tmp_path, monkeypatch):
    opened, done = os.open, []

    def refuse(path, flags, *mode, **more):
        if path == tmp_path and not flags & os.O_TMPFILE:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return opened(path, flags, *mode, **more)

    monkeypatch.setattr(os, "open", refuse)
    monkeypatch.setattr(os, "sync", lambda: done.append(os.listdir(tmp_path)))
    write_whole(tmp_path / "a.json", b"one")
    assert done == [["a.json"]]


def test_new_folders_are_put_on_the_disk_from_above(tmp_path, monkeypatch):
    (tmp_path / "a").mkdir()
    seen = synced(monkeypatch)
    make_folders(tmp_path / "a" / "b" / "c")
    assert seen == [str(tmp_path / "a"), str(tmp_path / "a" / "b")]


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_file_is_for_whom_the_users_umask_says(tmp_path, umask, mode):
    before = os.umask(umask)
    try:
        write_whole(tmp_path / "a", b"mine")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == mode


def test_a_file_replaces_no_device_or_pipe(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    for path in (pipe, link):
        with pytest.raises(OSError, match="no place for a file"):
            write_whole(path, b"one")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert link.is_symlink()
    assert sorted(os.listdir(tmp_path)) == ["link", "pipe"]


def test_of_two_that_write_where_nothing_was_one_is_refused(tmp_path, monkeypatch):
    """Both looked before either wrote, so that both had found nothing there."""
    path = tmp_path / "a.csv"
    write_bytes(path, b"one", overwrite=False)
    words = r"a\.csv: is already there; give another name, or --overwrite to replace it"
    with pytest.raises(OutputError, match=words):
        write_bytes(path, b"two", overwrite=False)
    assert (path.read_bytes(), os.listdir(tmp_path)) == (b"one", ["a.csv"])
    write_bytes(path, b"three")
    assert path.read_bytes() == b"three"

    def unknown(here, there):
        raise OSError(errno.EPERM, "Operation not permitted")  # of vfat

    monkeypatch.setattr(os, "link", unknown)
    with pytest.raises(OutputError, match=words):
        write_bytes(path, b"two", overwrite=False)
    write_bytes(tmp_path / "b.csv", b"four", overwrite=False)
    assert (path.read_bytes(), (tmp_path / "b.csv").read_bytes()) == (b"three", b"four")
    assert sorted(os.listdir(tmp_path)) == ["a.csv", "b.csv"]


# Looks whether the output is there only once the other command has begun to look as well.
TOGETHER = """
import pathlib, sys, time
from formats import outputs
from formats.command import main
meeting, look = pathlib.Path(sys.argv.pop(1)), outputs.refuse_to_replace

def together(path, **options):
    look(path, **options)
    (meeting / sys.argv[3].replace("/", "-")).touch()
    while len(list(meeting.iterdir())) < 2:
        time.sleep(0.01)

outputs.refuse_to_replace = together
main()
"""


def test_two_exports_at_once_to_one_file_are_one_whole_file_and_one_refusal(tmp_path):
    """Two takes of one name from two folders; both commands find nothing there."""
    (tmp_path / "meeting").mkdir()
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
        write_take(tmp_path / folder / "a.mcap", replace(a_take(frames=30), take_id=folder))
    words = [sys.executable, "-c", TOGETHER, str(tmp_path / "meeting"), "takes", "export"]
    running = {
        folder: subprocess.Popen([*words, f"{folder}/a.mcap", "--to", "npz", "--out", "out"], cwd=tmp_path,
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for folder in ("one", "other")
    }  # fmt: skip
    said = {folder: one.communicate(timeout=120)[1] for folder, one in running.items()}
    ends = {one.returncode: folder for folder, one in running.items()}
    assert set(ends) == {0, 2}, said
    step = "choose another folder with --out, or --overwrite to replace it"
    assert said[ends[2]] == f"hangtime: out/a.npz: is already there; {step}\n"
    with np.load(tmp_path / "out/a.npz") as archive:
        assert f'"take_id": "{ends[0]}"' in str(archive["about"])


def test_a_file_that_gets_its_name_by_a_hard_link_leaves_no_other_name(tmp_path, monkeypatch):
    """As on a file system that cannot rename unless the name is free."""
    monkeypatch.setattr("formats.whole_files._rename_where_none_is", lambda partial, path: False)
    write_whole(tmp_path / "a.json", b"one", may_replace=False)
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_only_a_path_into_a_folder_without_permission_is_hidden(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("")
    for name in ("a", "none", "a/below a file"):
        assert not is_hidden(tmp_path / name)

    def refused(path, **options):
        raise PermissionError(errno.EACCES, "denied", str(path))

    monkeypatch.setattr(Path, "stat", refused)
    assert is_hidden(tmp_path / "a")


def test_a_file_is_read_up_to_a_bound_and_refused_above_it(tmp_path):
    path = tmp_path / "note"
    path.write_bytes(b"0123456789")
    assert read_bounded(path, 10) == b"0123456789"
    with pytest.raises(OSError, match="the file has 10 bytes, and one of its kind 9 bytes at most"):
        read_bounded(path, 9)


@pytest.mark.parametrize("path", ["/dev/zero", "pipe"])
def test_a_file_without_an_end_is_not_read(tmp_path, path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="the path is a pipe or a device"):
        read_bounded(tmp_path / path)
