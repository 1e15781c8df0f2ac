"""A simulator in another Python: how it is found, how it is started, and how it is ended."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from fit.errors import FitError
from fit.foreign import process as foreign
from fit.foreign.process import Foreign, ForeignProcess


def thing(folder, script, module="json"):
    (folder / "thing.py").write_text(script)
    return Foreign("Thing", module, "thing", "HANGTIME_THING_PYTHON", folder / "thing.py")


def test_a_module_is_installed_where_the_named_python_finds_it(monkeypatch, tmp_path):
    assert thing(tmp_path, "").is_installed()
    assert not thing(tmp_path, "", module="no_such_module_here").is_installed()
    monkeypatch.setenv("HANGTIME_THING_PYTHON", str(tmp_path / "nowhere"))
    assert not thing(tmp_path, "").is_installed()


def test_the_python_is_this_one_unless_the_variable_names_another_by_path_or_by_name(monkeypatch, tmp_path):
    monkeypatch.delenv("HANGTIME_THING_PYTHON", raising=False)
    assert thing(tmp_path, "").python == sys.executable
    monkeypatch.setenv("HANGTIME_THING_PYTHON", "python3")
    assert thing(tmp_path, "").python == "python3"  # found on the PATH
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HANGTIME_THING_PYTHON", "bin/python")
    assert thing(tmp_path, "").python == str(tmp_path / "bin/python")


def test_lines_before_the_ready_line_are_skipped_and_a_program_without_one_is_absent(tmp_path):
    process = ForeignProcess(thing(tmp_path, "print('hello')\nprint('ready 5.2', flush=True)\ninput()\n"))
    assert process.version == "5.2"
    process.close()
    with pytest.raises(FitError, match="Thing's Python module json cannot be started"):
        ForeignProcess(thing(tmp_path, "print('hello')\n"))


def test_a_program_that_ends_without_a_word_is_named_itself(tmp_path):
    process = ForeignProcess(thing(tmp_path, "print('ready 1', flush=True)\n"))
    with pytest.raises(FitError, match=r"^Thing: Thing ended in the middle of a simulation; use a coarser mesh"):
        process.answer(x=np.zeros(1))


def test_a_program_that_does_not_end_is_killed_and_its_files_are_removed(monkeypatch, tmp_path):
    monkeypatch.setattr(foreign, "CLOSING_TIME", 0.1)
    script = "import os, time\nprint('ready', os.getcwd(), flush=True)\ntime.sleep(600)\n"
    process = ForeignProcess(thing(tmp_path, script))
    folder = Path(process.version)
    assert folder.name.startswith("hangtime-json-")
    process.close()
    assert process._process.returncode == -9
    assert not folder.exists()
    process.close()  # a second call does nothing
