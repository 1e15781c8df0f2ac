"""`hangtime fit` refuses an engine before it says anything about takes."""

from __future__ import annotations

import pytest

from tests.fit.here import hangtime_here


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
