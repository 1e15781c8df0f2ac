"""Files of libraries that cannot, or do not, write the whole file."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import pytest

from formats.errors import OutputError
from formats.exporters.by_library import bytes_by_library
from tests.formats.full_disk import no_file_beyond


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    """A folder for temporary files in which nothing may be left."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    yield tmp_path
    assert not any(tmp_path.iterdir())


def silent(path):
    """Make an empty file and say nothing."""
    path.touch()


def loud(path):
    with path.open("wb", buffering=0) as file:
        file.write(bytes(1000))
    raise RuntimeError("Error in 'SomeClass::Flush' at line 204 in file /opt/some.h")


@pytest.mark.parametrize("write", [silent, loud])
def test_the_systems_cause_is_reported_whatever_the_library_says(write, temporary):
    with no_file_beyond(300), pytest.raises(OutputError, match=rf"^{temporary}: .*\(File too large\); raise the limit"):
        bytes_by_library(write, "a.bin")


def test_a_fault_of_the_library_itself_stays_its_own():
    with pytest.raises(RuntimeError, match="SomeClass"):
        bytes_by_library(loud, "a.bin")
    with pytest.raises(OutputError, match=re.escape("a.bin: the library left it unfinished; choose another --to")):
        bytes_by_library(silent, "a.bin")
    assert bytes_by_library(lambda path: path.write_bytes(bytes(10)), "a.bin") == bytes(10)


def test_no_folder_for_temporary_files_is_one_sentence(monkeypatch, temporary):
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_candidate_tempdir_list", lambda: [str(temporary / Path("absent"))])
    with pytest.raises(OutputError, match=r"^TMPDIR: no folder for temporary files takes one; name a folder with room"):
        bytes_by_library(silent, "a.bin")
