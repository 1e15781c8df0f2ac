"""Where an import or an export of one file fails, nothing is left or replaced of it, and the others go on."""

from __future__ import annotations

import pytest

from formats.archive import verify_take, write_take
from formats.descriptions import dump_description
from formats.importers.marker_tracks import write_marker_csv
from tests.fit.here import hangtime_here
from tests.formats.full_disk import no_file_beyond
from tests.formats.test_archive import RIG, a_take
from tests.formats.test_marker_oddities import GARMENT, hanging
from tests.formats.unprivileged import hangtime_unprivileged

IMPORT = ("import", "m.csv", "--garment", "g.toml", "--overwrite", "--out")
ITS_NAME = "is a folder; choose another folder with --out"


@pytest.fixture
def desk(tmp_path):
    """Two marker files, a garment, and a folder of takes in which another rig is described."""
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    for name in ("m.csv", "n.csv"):
        write_marker_csv(tmp_path / name, hanging())
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/rig.toml").write_text(dump_description(RIG))
    return tmp_path


def all_below(folder):
    return {str(path.relative_to(folder)): path.is_file() and path.read_bytes() for path in folder.rglob("*")}


def test_an_archive_whose_path_is_a_folder_leaves_the_descriptions_as_they_were(desk):
    for out in ("mine", "new"):
        (desk / out / "m.mcap").mkdir(parents=True)
    before = all_below(desk)
    for out in ("mine", "new"):
        done = hangtime_here(*IMPORT, out, folder=desk)
        assert (done.returncode, done.stderr) == (2, f"hangtime: {out}/m.mcap: {ITS_NAME}\n")
    assert all_below(desk) == before


def test_a_description_whose_path_is_a_folder_leaves_the_other_one_as_it_was(desk):
    (desk / "mine/garment.toml").mkdir()
    before = all_below(desk)
    done = hangtime_here(*IMPORT, "mine", folder=desk)
    assert (done.returncode, done.stderr) == (2, f"hangtime: mine/garment.toml: {ITS_NAME}\n")
    assert all_below(desk) == before


def test_an_archive_that_the_disk_has_no_room_for_leaves_nothing_and_replaces_nothing(desk):
    """The descriptions have fewer bytes than a file may have here, the archive more."""
    before = all_below(desk)
    for out in ("mine", "new"):
        with no_file_beyond(4096):
            done = hangtime_here(*IMPORT, out, folder=desk)
        assert done.returncode == 2
        assert f"{out}/m.mcap: cannot be written (File too large)" in done.stderr
    assert all_below(desk) == before


def test_a_folder_of_takes_without_permission_stays_as_it_is(desk):
    (desk / "mine").chmod(0o555)
    before = all_below(desk)
    (done,) = hangtime_unprivileged((*IMPORT, "mine"), folder=desk)
    assert done.returncode == 2
    assert "mine: cannot be made or written to (Permission denied); choose another folder, or get" in done.stderr
    assert all_below(desk) == before


def test_an_import_goes_on_after_a_take_that_cannot_be_written(desk):
    (desk / "out/m.mcap").mkdir(parents=True)
    done = hangtime_here("import", "m.csv", "n.csv", "--garment", "g.toml", "--out", "out", folder=desk)
    first, *_, last = done.stdout.splitlines()
    assert (done.returncode, done.stderr, first[:11]) == (2, "", "out/n.mcap:")
    assert last == f"not written: out/m.mcap: {ITS_NAME}"
    assert verify_take(desk / "out/n.mcap").is_sound
    assert sorted(path.name for path in (desk / "out").iterdir()) == ["garment.toml", "m.mcap", "n.mcap", "rig.toml"]


def test_an_export_goes_on_after_a_file_that_cannot_be_written(desk):
    for name in "abc":
        write_take(desk / f"{name}.mcap", a_take(20))
    (desk / "out").mkdir()
    (desk / "out/a.csv").write_text("mine")
    (desk / "out/b.csv").mkdir()
    words = ("takes", "export", "a.mcap", "b.mcap", "c.mcap", "--to", "csv", "--out", "out")
    done = hangtime_here(*words, folder=desk)
    first, *rest = done.stdout.splitlines()
    assert (done.returncode, done.stderr, first[:10]) == (2, "", "out/c.csv:")
    assert rest == [
        "not written: out/a.csv: is already there; choose another folder with --out, or --overwrite to replace it",
        f"not written: out/b.csv: {ITS_NAME}",
    ]
    assert (desk / "out/a.csv").read_text() == "mine"
    again = hangtime_here(*words, "--overwrite", folder=desk)
    assert (again.returncode, again.stdout.splitlines()[-1]) == (2, f"not written: out/b.csv: {ITS_NAME}")
