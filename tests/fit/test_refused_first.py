"""`hangtime fit` and `diagnose` refuse invalid requests before any message on takes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fit.api.takes import say_takes
from formats.archive import write_take
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
    """The take is not even there."""
    monkeypatch.setenv("HANGTIME_BLENDER_PYTHON", str(tmp_path / "no-such-python"))
    done = hangtime_here("fit", "absent.mcap", "--engine", "blender", *words, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert sentence in done.stderr
    assert "Fitting" not in done.stderr
    assert not list(tmp_path.iterdir())


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
        (["a.mcap", "--out", "file"], "file: cannot be used as a folder for results"),
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
