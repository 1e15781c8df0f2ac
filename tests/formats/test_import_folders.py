"""A folder of takes into which an import writes: what is there, and what a killed import leaves."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from formats.archive import read_take, verify_take, write_take
from formats.descriptions import dump_description, load_rig
from formats.importers.marker_tracks import write_marker_csv
from tests.fit.here import hangtime_here
from tests.formats.test_archive import RIG, a_take
from tests.formats.test_marker_oddities import GARMENT, hanging
from tests.repository import ROOT

DESCRIPTIONS, NEW_SOURCE = ("rig.toml", "garment.toml"), "m.csv"
IMPORT = ("import", "m.csv", "--garment", "g.toml", "--out")
FORMER = dump_description(RIG)
AGAIN = "choose another folder with --out, or --overwrite to replace it"
KILLS = 7  # a link, a new name or a removal each
# Imports into each folder that is given, in a child that is killed as it asks for its k-th such name, k of the folder.
KILLED = """
import os, signal, sys
from tests.fit.here import hangtime_here
words, kills = sys.argv[2:], int(sys.argv[1])
hangtime_here(*words, folder="whole")  # all is imported now
for folder in ("new", "old"):
    for kill_at in range(kills + 1):
        child = os.fork()
        if child == 0:
            asked = 0
            def look(event, given):
                global asked
                if event in ("os.rename", "os.link", "os.remove") and "/o/" in os.path.abspath(str(given[0])):
                    asked += 1
                    if asked > kill_at:
                        os.kill(os.getpid(), signal.SIGKILL)
            os.chdir(f"{folder}-{kill_at}")
            sys.addaudithook(look)
            hangtime_here(*words, *["--overwrite"] * (folder == "old"), folder=".")
            os._exit(0)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.fixture
def desk(tmp_path):
    """A marker file, a garment, and in `o` the rig of another take."""
    laid_out(tmp_path)
    (tmp_path / "o/rig.toml").write_text(FORMER)
    return tmp_path


def laid_out(folder):
    (folder / "o").mkdir(parents=True)
    (folder / "g.toml").write_text(dump_description(GARMENT))
    write_marker_csv(folder / "m.csv", hanging())


def held_in(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_rig_of_another_take_is_told_with_steps_that_work(desk):
    before = held_in(desk / "o")
    done = hangtime_here(*IMPORT, "o", folder=desk)
    what = "is already there and describes another rig than that of this take"
    assert (done.returncode, done.stderr) == (2, f"hangtime: o/rig.toml: {what}; {AGAIN}\n")
    assert held_in(desk / "o") == before
    assert hangtime_here(*IMPORT, "other", folder=desk).returncode == 0
    assert hangtime_here(*IMPORT, "o", "--overwrite", folder=desk).returncode == 0
    assert load_rig(desk / "o/rig.toml") == load_rig(desk / "other/rig.toml") == read_take(desk / "o/m.mcap").rig


def test_a_garment_of_another_take_and_a_folder_or_link_in_its_place_are_told(desk):
    (desk / "o/rig.toml").unlink()
    path = desk / "o/garment.toml"
    other = f"is already there and describes another garment than that of this take; {AGAIN}"
    for make, says in (
        (lambda: path.write_text("mine"), other),
        (lambda: path.symlink_to("nowhere"), f"is a link that leads to nothing; {AGAIN}"),
        (path.mkdir, "is a folder; choose another folder with --out"),
    ):  # fmt: skip
        make()
        done = hangtime_here(*IMPORT, "o", folder=desk)
        assert (done.returncode, done.stderr) == (2, f"hangtime: o/garment.toml: {says}\n")
        assert [one.name for one in (desk / "o").iterdir()] == ["garment.toml"]
        path.rmdir() if path.is_dir() else path.unlink()


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """Folders `new-k` and, where a former import is replaced, `old-k`: each left by an import that was killed."""
    folder = tmp_path_factory.mktemp("killed")
    for name in ("whole", *(f"{kind}-{k}" for kind in ("new", "old") for k in range(KILLS + 1))):
        laid_out(folder / name)
        if name.startswith("old"):
            write_take(folder / name / "o/m.mcap", a_take(20))
            (folder / name / "o/rig.toml").write_text(FORMER)
            (folder / name / "o/garment.toml").write_text(dump_description(a_take().garment))
    before = held_in(folder / "old-0/o")
    ran = subprocess.run(
        [sys.executable, "-c", KILLED, str(KILLS), *IMPORT, "o"], cwd=folder, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True,
    )  # fmt: skip
    assert [int(line) for line in ran.stdout.split()] == 2 * [*[-signal.SIGKILL] * KILLS, 0]
    return folder, before


def assert_usable(folder, whole, former):
    """Each file is the former or the new one; what is new beside no new take is told, and the next import mends it."""
    held = held_in(folder / "o")
    is_new = {name: held.get(name) == whole[name] for name in DESCRIPTIONS}
    has_new_take = "m.mcap" in held and read_take(folder / "o/m.mcap").source == NEW_SOURCE
    for name in DESCRIPTIONS:
        assert is_new[name] or held.get(name) == former.get(name)
        assert has_new_take or name not in former or former[name] in held.values(), "nothing is lost"
    assert "m.mcap" not in held or verify_take(folder / "o/m.mcap").is_sound
    if has_new_take:
        assert all(is_new.values())
        return
    assert held.get("m.mcap") == former.get("m.mcap")
    assert verify_take(folder / "o/m.mcap.partial").is_sound, "the whole take, under its unfinished name"
    again = hangtime_here(*IMPORT, "o", folder=folder)
    assert (again.returncode, "is what an interrupted recording or import" in again.stderr) == (2, True)
    assert hangtime_here(*IMPORT, "o", "--overwrite", folder=folder).returncode == 0
    assert verify_take(folder / "o/m.left-1.mcap.partial").is_sound
    mended = held_in(folder / "o")
    assert all(mended[name] == whole[name] for name in DESCRIPTIONS)
    assert read_take(folder / "o/m.mcap").source == NEW_SOURCE


def test_a_killed_import_leaves_a_folder_that_is_as_before_or_says_so(killed):
    folder, _ = killed
    for k in range(KILLS + 1):
        assert_usable(folder / f"new-{k}", held_in(folder / "whole/o"), {})


def test_a_killed_import_that_replaces_another_one_loses_nothing_of_it(killed):
    folder, former = killed
    for k in range(KILLS + 1):
        assert_usable(folder / f"old-{k}", held_in(folder / "whole/o"), former)
