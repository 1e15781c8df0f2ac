"""`hangtime fit` and `diagnose` refuse invalid requests before any message on takes."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import pytest

from fit.api.takes import say_takes, sorted_out
from fit.errors import FitError
from formats.archive import write_take
from formats.errors import TakeError
from tests.fit.here import hangtime_here
from tests.fit.scenes import sheet
from tests.fit.test_command_line import a_swung_take


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--method", "kinect-skirt"], "no-such-python: Blender's Python module bpy cannot be started; in Hangtime's"),
        ([], "Blender has no si parameters; use --method kinect-skirt with it"),
        (["--method", "kinect-skirt", "--effect", "hem"], "--effect: Blender's cloth cannot be given effects; leave"),
    ],
)
def test_an_engine_that_cannot_be_had_is_refused_before_takes_are_read(tmp_path, monkeypatch, words, sentence):
    """The file is no take, which its reader would say."""
    (tmp_path / "empty.mcap").touch()
    monkeypatch.setenv("HANGTIME_BLENDER_PYTHON", str(tmp_path / "no-such-python"))
    done = hangtime_here("fit", "empty.mcap", "--engine", "blender", *words, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert sentence in done.stderr
    assert "Fitting" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["empty.mcap"]


@pytest.mark.parametrize("command", ["fit", "diagnose"])
def test_the_takes_are_named_once_nothing_refuses_them(tmp_path, command):
    """The take is given twice, its results have no place, or another command left other work there."""
    write_take(tmp_path / "a.mcap", a_swung_take(seconds=2.05))
    (tmp_path / "file").touch()
    (tmp_path / "kept/diagnosis.partial").mkdir(parents=True)
    for name in ("kept/fit.partial.json", "kept/diagnosis.partial/key.json"):
        (tmp_path / name).write_text("{")
    for words, sentence in (
        (["a.mcap", "a.mcap"], "is given twice"),
        (["a.mcap", "--out", "file"], "file: cannot be made or written to"),
        (["a.mcap", "--out", "kept"], "cannot be read"),
    ):
        done = hangtime_here(command, *words, folder=tmp_path)
        assert (done.returncode, done.stdout, "Fitting" in done.stderr) == (2, "", False)
        assert sentence in done.stderr


@pytest.mark.parametrize(
    ("spacing", "words"),
    [
        (None, "is held out.\n"),
        (0.02, "is held out.\n"),
        (0.01, "is held out. The mesh has about 1800 nodes; a simulation takes 76 times as long as on 100.\n"),
    ],
)
def test_a_fine_mesh_says_before_the_work_what_it_costs(spacing, words, capsys):
    """0.4 m x 0.45 m; 18 times the nodes, and 18 to the power of 1.5 times the time."""
    take = a_swung_take(seconds=2.05)
    say_takes([replace(take, garment=sheet())], [], spacing)
    assert capsys.readouterr().err.endswith(words)


@pytest.mark.parametrize("words", [("fit", "a.c3d", "gone.mcap"), ("diagnose", "a.c3d", "--held-out", "gone.mcap")])
def test_a_take_that_is_not_there_is_named_before_another_is_read_or_taichi_is_loaded(tmp_path, words):
    """a.c3d is no take, and is refused only when it is read."""
    (tmp_path / "a.c3d").write_bytes(b"no take")
    called = [sys.executable, "-X", "importtime", "-m", "hangtime", *words]
    done = subprocess.run(called, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "| fit.api.takes" in " ".join(done.stderr.split())
    assert "taichi" not in done.stderr
    assert done.stderr.endswith("hangtime: gone.mcap: cannot be read (No such file or directory); check the path\n")


def test_a_call_from_python_names_the_missing_take_before_it_reads_another(tmp_path):
    (tmp_path / "a.c3d").write_bytes(b"no take")
    with pytest.raises(TakeError, match=r"gone\.mcap: cannot be read \(No such file"):
        sorted_out([str(tmp_path / "a.c3d")], tmp_path / "gone.mcap")
    with pytest.raises(TakeError, match=r"gone\.mcap: cannot be read \(No such file"):
        sorted_out(tmp_path / name for name in ("a.c3d", "gone.mcap"))


@pytest.mark.parametrize("name", ["", "a\0.mcap"])
def test_a_name_that_no_file_has_is_named_as_it_was_given(name):
    with pytest.raises(FitError, match="is the name of no file; give a take"):
        sorted_out([name])
