"""A file appears whole or not at all."""

from __future__ import annotations

import os
import stat

import pytest

from formats.whole_files import make_folders, write_whole


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
    """What is put on the disk from now on, by its place, in order."""
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


def test_a_file_takes_no_devices_or_pipes_place(tmp_path):
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    for path in (pipe, link):
        with pytest.raises(OSError, match="no place for a file"):
            write_whole(path, b"one")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert link.is_symlink()
    assert sorted(os.listdir(tmp_path)) == ["link", "pipe"]
