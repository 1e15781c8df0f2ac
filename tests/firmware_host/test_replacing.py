"""A second run of a command replaces no recording without --overwrite; options reach the simulation."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from firmware_host.synthetic import recording
from firmware_host.synthetic.scene import RIG
from firmware_host.synthetic.swatch import make_swatch_take
from formats.command import app, gather_commands
from formats.descriptions import dump_description
from formats.errors import OutputError
from formats.outputs import refuse_to_replace

gather_commands()


@pytest.mark.parametrize(
    ("words", "there"),
    [
        (["sensor", "synthesise", "d", "--name", "swing"], "swing.oni"),
        (["sensor", "synthesise", "d", "--name", "swing"], "swing.truth.npz"),
        (["sensor", "synthesise", "d", "--name", "swing"], "rig.toml"),
        (["sensor", "synthesise-swatch", "d", "--fabric", "silk"], "silk-swing.csv"),
        (["markers", "print", "--out", "d/markers.svg"], "markers.svg"),
    ],
)
def test_a_file_that_is_there_is_named_and_stays(tmp_path, monkeypatch, words, there):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / there).write_text("mine")
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, OutputError)
    assert there in str(done.exception)
    assert "--overwrite" in str(done.exception)
    assert [path.read_text() for path in (tmp_path / "d").iterdir()] == ["mine"]


def test_overwrite_replaces_a_page_of_markers(tmp_path):
    page = tmp_path / "markers.svg"
    page.write_text("mine")
    assert CliRunner().invoke(app, ["markers", "print", "--out", str(page), "--overwrite"]).exit_code == 0
    assert page.read_text().startswith("<svg")


def test_two_recordings_share_a_folder_and_its_rig(tmp_path):
    """Both are of the same rig, whose description is the same to the letter."""
    rig = tmp_path / "rig.toml"
    rig.write_text(dump_description(RIG))
    refuse_to_replace(rig, dump_description(RIG))
    with pytest.raises(OutputError, match="is already there"):
        refuse_to_replace(rig, "another")


def test_what_makes_recordings_refuses_before_it_works(tmp_path):
    (tmp_path / "swing.oni").touch()
    with pytest.raises(OutputError, match="is already there"):
        recording.make_recording(tmp_path, "swing")
    (tmp_path / "silk-swing.csv").touch()
    with pytest.raises(OutputError, match="is already there"):
        make_swatch_take(tmp_path, fabric="silk")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["synthesise", "d", "--effect=hem", "--amplitude=nan"],
            "--amplitude: nan is no size of an effect; give a finite",
        ),
        (
            ["synthesise", "d", "--garment=t-shirt", "--fabric=felt"],
            "--fabric: the T-shirt has a fabric of its own; leave out the fabric, or swing the skirt or the swatch",
        ),
        (["synthesise-swatch", "d", "--air-drag=inf"], "--air-drag: inf is no drag coefficient; give 0 to 100"),
    ],
)
def test_the_size_of_a_planted_effect_reaches_what_makes_the_recording(tmp_path, monkeypatch, words, sentence):
    """Tested with a number that is refused, since a whole recording takes half a minute."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["sensor", *words])
    assert sentence in str(done.exception)
    assert not list(tmp_path.rglob("*.*"))


@pytest.mark.parametrize(
    ("words", "last", "first"),
    [
        (["sensor", "synthesise", "d", "--name", "swing"], "garment.toml", "swing.oni"),
        (["sensor", "synthesise-swatch", "d", "--fabric", "silk"], "silk-swing.csv", "silk.toml"),
        (["sensor", "synthesise-silhouette", "d"], "silhouette.truth.npz", "silhouette.npz"),
    ],
)
def test_a_folder_with_a_recordings_name_is_refused_before_the_work_also_with_overwrite(
    tmp_path, monkeypatch, capfd, words, last, first
):
    """The first file is written before the last, so it would be there after the work."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "d" / last).mkdir(parents=True)
    done = CliRunner().invoke(app, [*words, "--overwrite"])
    assert str(done.exception) == f"d/{last}: is a folder; give another name"
    assert "%" not in capfd.readouterr().err
    assert not (tmp_path / "d" / first).exists()
