"""A file that cannot be read gets its sentence, and the others of the command are done all the same."""

from __future__ import annotations

import pytest

from formats.archive import write_take
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take
from tests.formats.test_command_line import swung_cloth
from tests.formats.unprivileged import hangtime_unprivileged

LOCKED = "locked.mcap: cannot be read (Permission denied); "
BAD = ("locked.mcap", "folder.mcap", "dangling.mcap")


@pytest.fixture
def desk(tmp_path):
    """Two takes between a locked one, a folder and a link that leads nowhere; below, a folder that is locked."""
    for name in ("a", "b", "locked"):
        write_take(tmp_path / f"{name}.mcap", a_take(20))
    (tmp_path / "locked.mcap").chmod(0)
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "dangling.mcap").symlink_to("nowhere")
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "vault").mkdir(mode=0)
    return tmp_path


def test_of_five_takes_three_that_cannot_be_read_keep_no_command_from_the_other_two(desk):
    """Before, one locked take ended the command, by a look ahead of Typer's own, before any take was read."""
    takes = ("a.mcap", *BAD, "b.mcap")
    verified, recovered, exported, listed, below, alone, batch = hangtime_unprivileged(
        ("takes", "verify", *takes),
        ("takes", "recover", *takes, "--out", "sound"),
        ("takes", "export", *takes, "--to", "npz", "--out", "npz"),
        ("takes", "list", "."),
        ("takes", "list", "in"),
        ("takes", "list", "in/vault"),
        ("batch", "in/vault", "--out", "fits"),
        folder=desk,
    )
    for done in (verified, recovered, exported, listed):
        assert (done.returncode, done.stderr) == (2, "")
        assert done.stdout.count("cannot be read") == (4 if done is listed else 3)
        assert LOCKED in done.stdout
    assert verified.stdout.count("sound ") == 2
    assert sorted(path.name for path in (desk / "sound").iterdir()) == ["a.recovered.mcap", "b.recovered.mcap"]
    assert sorted(path.name for path in (desk / "npz").iterdir()) == ["a.npz", "b.npz"]
    assert "in/vault: cannot be read (Permission denied)" in below.stdout
    assert below.returncode == 2
    for done in (alone, batch):
        assert "in/vault: cannot be read (Permission denied); get the permission to read it" in done.stderr
        assert done.returncode == 2


def test_a_recording_that_cannot_be_read_keeps_no_import_from_the_others(tmp_path):
    for name in ("a.npz", "c.npz"):
        swung_cloth(tmp_path / name)
    (tmp_path / "b.npz").write_bytes(b"no archive")
    done = hangtime_here("import", "a.npz", "b.npz", "gone.npz", "c.npz", folder=tmp_path)
    assert done.returncode == 2
    assert sorted(path.name for path in (tmp_path / "takes").glob("*.mcap")) == ["a.mcap", "c.mcap"]
    lost = [line for line in done.stdout.splitlines() if line.startswith("lost: ")]
    assert [line.split(":")[1] for line in lost] == [" b.npz", " gone.npz"]


def test_a_folder_that_is_not_there_is_no_folder_without_takes(tmp_path):
    (tmp_path / "file").touch()
    for name in ("gone", "file"):
        done = hangtime_here("batch", name, "--out", "fits", folder=tmp_path)
        assert f"{name}: is no folder that is there; check the address" in done.stderr
        assert done.returncode == 2
