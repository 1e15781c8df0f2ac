"""An export in motion shows its progress, and Ctrl-C leaves all of its files or none."""

from __future__ import annotations

import dataclasses
import signal

import numpy as np
import pytest

from fit.export import kinds
from fit.export.kinds import Order, contents, write_contents
from formats.archive import write_take
from formats.results import save_fit_result
from formats.terminal import ProgressLine
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.scenes import hung, sheet, swing, take_of


@pytest.fixture
def folder(tmp_path):
    time = np.arange(0, 0.8, 1 / 30)
    take = take_of(sheet(), time, swing(time, amplitude=0.1, hz=1.5, start=0.0), hung(sheet(), time))
    write_take(tmp_path / "take.mcap", take)
    save_fit_result(tmp_path / "fit.json", a_fit())
    return tmp_path


def exported(folder, kind="pc2"):
    return hangtime_here("export", "fit.json", "--to", kind, "--take", "take.mcap", "--spacing", 0.15, folder=folder)


def test_an_export_in_motion_shows_its_simulation_and_its_end(folder):
    said = exported(folder).stderr.splitlines()
    assert said[0] == "export to pc2: 0 %, simulating"
    assert any(line.startswith("export to pc2: 11 %, simulating") for line in said)
    assert said[-1] == "export to pc2: 100 %, done"


def test_an_export_without_motion_shows_no_progress(folder):
    done = hangtime_here("export", "fit.json", "--to", "csv", folder=folder)
    assert (done.returncode, done.stderr) == (0, "")


def test_ctrl_c_in_the_simulation_of_an_export_leaves_nothing(folder, monkeypatch):
    own, before = ProgressLine.show, sorted(folder.iterdir())

    def interrupted(line, share, text):
        own(line, share, text)
        if share > 0.2:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ProgressLine, "show", interrupted)
    done = exported(folder)
    assert done.returncode == 130
    assert done.stderr.splitlines()[-1] == "Interrupted; nothing is kept."
    assert sorted(folder.iterdir()) == before


def test_ctrl_c_between_the_files_of_an_export_waits_for_the_last(tmp_path, monkeypatch):
    own = kinds.write_bytes

    def interrupted(*words, **options):
        own(*words, **options)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(kinds, "write_bytes", interrupted)
    made = {tmp_path / "a.pc2": b"a", tmp_path / "a.obj": b"b"}
    with pytest.raises(KeyboardInterrupt):
        write_contents(made)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == made


def test_the_contents_of_an_export_are_the_files_that_it_writes(tmp_path):
    order = Order(result=a_fit())
    made = contents(order, "newton", kinds.checked_names(order, "newton", tmp_path / "a.json"))
    assert not list(tmp_path.iterdir())
    assert kinds.export(Order(result=a_fit()), "newton", tmp_path / "a.json") == list(made)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == made


def test_the_places_of_an_export_are_checked_once(tmp_path, monkeypatch):
    """For `abc` each check starts Blender's Python."""
    asked = []
    kind = dataclasses.replace(kinds.EXPORT_KINDS["newton"], check=lambda: asked.append("library"))
    monkeypatch.setitem(kinds.EXPORT_KINDS, "newton", kind)
    save_fit_result(tmp_path / "fit.json", a_fit())
    assert hangtime_here("export", "fit.json", "--to", "newton", folder=tmp_path).returncode == 0
    assert asked == ["library"]
    kinds.export(Order(result=a_fit()), "newton", tmp_path / "b.json")
    assert asked == ["library", "library"]
