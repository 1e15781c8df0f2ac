"""Folders that a command makes for its files: gone again where the work fails before there is one."""

from __future__ import annotations

import os

import pytest

from formats.archive import write_take
from formats.errors import OutputError
from formats.outputs import (
    check_stem,
    make_output_folder,
    make_parent,
    output_folder,
    refuse_an_input,
    refuse_to_replace,
    write_text,
)
from tests.formats.test_archive import a_take


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
        assert str(refused.value) == f"--name: no file can have the name {name!r}; give one without a slash"
    for name in ("swing", ".", "a b"):
        check_stem(name)


def refused(work, *given, **named):
    with pytest.raises(OutputError) as error:
        work(*given, **named)
    return str(error.value)


THERE = "is already there; give another name, or --overwrite to replace it"


def test_a_file_that_is_there_stays_unless_it_holds_just_what_is_to_be_written(tmp_path):
    path = tmp_path / "a.txt"
    refuse_to_replace(path)
    path.write_text("\u00e4b")
    for text in (None, "\u00e4c", "\u00e4", "\u00e4bc"):
        assert refused(refuse_to_replace, path, text) == f"{path}: {THERE}"
    refuse_to_replace(path, "\u00e4b")
    (tmp_path / "folder").mkdir()
    assert refused(refuse_to_replace, tmp_path / "folder", "") == f"{tmp_path}/folder: is a folder; give another name"


def test_a_take_that_was_never_finished_stays_where_it_holds_something(tmp_path):
    partial = tmp_path / "a.mcap.partial"
    partial.touch()
    refuse_to_replace(tmp_path / "a.mcap")
    partial.write_bytes(b"x")
    assert refused(refuse_to_replace, tmp_path / "a.mcap") == (
        f"{partial}: is what an interrupted recording or import left under this name; "
        "look at it with `hangtime takes show`; give another name, or --overwrite to put it aside and begin anew"
    )


def test_a_folder_or_a_pipe_of_an_unfinished_name_is_reported_as_such_and_stays(tmp_path):
    (tmp_path / "a.mcap.partial").mkdir()
    os.mkfifo(tmp_path / "b.mcap.partial")
    for name, kind in (("a", "folder"), ("b", "pipe or device")):
        words = f"is a {kind}, and the take is written under this name until it is whole"
        told = f"{tmp_path}/{name}.mcap.partial: {words}; rename it, or give another name"
        path = tmp_path / f"{name}.mcap"
        assert refused(refuse_to_replace, path) == told
        assert refused(write_take, path, a_take(), overwrite=True) == told
        assert (path.with_name(f"{name}.mcap.partial").exists(), path.exists()) == (True, False)


def test_no_other_file_is_written_under_an_unfinished_name_so_that_one_is_left_alone(tmp_path):
    (tmp_path / "a.csv.partial").write_text("mine")
    refuse_to_replace(tmp_path / "a.csv")
    write_text(tmp_path / "a.csv", "text", overwrite=False)
    assert (tmp_path / "a.csv.partial").read_text() == "mine"


def test_a_file_that_is_read_is_not_written_over_by_any_of_its_names(tmp_path):
    (tmp_path / "a").touch()
    (tmp_path / "link").symlink_to("a")
    refuse_an_input(tmp_path / "new", [tmp_path / "a"])
    refuse_an_input(tmp_path / "a", [tmp_path / "gone", tmp_path])
    words = "would replace the take that is read; give another name"
    assert (
        refused(refuse_an_input, tmp_path / "link", [tmp_path / "gone", tmp_path / "a"]) == f"{tmp_path}/link: {words}"
    )


def test_a_file_that_cannot_be_written_is_refused_with_its_cause(tmp_path):
    (tmp_path / "file").write_text("mine")
    step = "give another path: a part of this one is a file"
    below = tmp_path / "file/new"
    assert refused(make_output_folder, below) == f"{below}: cannot be made or written to (Not a directory); {step}"
    assert refused(make_parent, below / "a") == f"{below}: cannot be made (Not a directory); {step}"
    assert refused(write_text, below, "text") == f"{below}: cannot be written (Not a directory); {step}"
    assert refused(write_text, tmp_path / "file", "text", overwrite=False) == f"{tmp_path}/file: {THERE}"
    assert (tmp_path / "file").read_text() == "mine"
    write_text(tmp_path / "file", "\u00e4")
    assert (tmp_path / "file").read_bytes() == b"\xc3\xa4"
