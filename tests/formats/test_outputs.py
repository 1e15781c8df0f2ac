"""Folders that a command makes for its files: gone again where the work fails before there is one."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest

from formats.errors import OutputError
from formats.outputs import check_stem, output_folder, write_description
from formats.rig import Rig


def interrupted(folder, *made):
    """Begin work that is to fill a folder, make some files, and end it."""

    def work():
        with output_folder(folder):
            for file in made:
                file.touch()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work()


def test_a_folder_that_was_made_for_nothing_goes_and_one_that_was_there_or_holds_something_stays(tmp_path):
    (tmp_path / "old").mkdir()
    for folder in (tmp_path / "new/deep", tmp_path / "old"):
        interrupted(folder)
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    interrupted(tmp_path / "new/deep", tmp_path / "new/kept")
    assert (tmp_path / "new/kept").exists()
    assert not (tmp_path / "new/deep").exists()


def test_a_folder_that_cannot_be_made_leaves_nothing(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError):
        interrupted(tmp_path / "file/new")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_stem_of_names_is_not_empty_and_has_no_slash():
    for name in ("", "a/b", "/"):
        with pytest.raises(OutputError) as refused:
            check_stem(name)
        assert str(refused.value) == f"--name: the name {name!r} is none that a file can have; give one without a slash"
    for name in ("swing", ".", "a b"):
        check_stem(name)


def test_commands_that_write_one_description_at_once_all_go_on(tmp_path):
    """Imports side by side into one folder; another description there is still refused."""
    rig, together, commands = Rig(format="hangtime-rig/1", name="a", gravity=(0.0, 0.0, -1.0)), Barrier(6), range(6)

    def write(folder):
        together.wait()
        write_description(tmp_path / folder / "rig.toml", rig, overwrite=False)

    with ThreadPoolExecutor(len(commands)) as threads:
        for folder in "abcdef":
            list(threads.map(write, folder * len(commands)))
    with pytest.raises(OutputError, match="is already there"):
        write_description(tmp_path / "a/rig.toml", Rig(format="hangtime-rig/1", name="b", gravity=(0.0, 0.0, -1.0)),
                          overwrite=False)  # fmt: skip
