"""A folder of takes into which an import writes: what is there, and what a killed import leaves."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys

import pytest

from formats.archive import read_take, write_take
from formats.descriptions import dump_description, load_rig
from formats.fault_words import doubts_of
from formats.importers.marker_tracks import write_marker_csv
from tests.fit.here import hangtime_here
from tests.formats.test_archive import RIG, a_take
from tests.formats.test_marker_oddities import GARMENT, hanging
from tests.repository import ROOT

DESCRIPTIONS, NEW_SOURCE = ("rig.toml", "garment.toml"), "m.csv"
IMPORT = ("import", "m.csv", "--garment", "g.toml", "--out")
FORMER = dump_description(RIG)
UNLIKE = "is already there and cannot be compared with the garment of this take"
AGAIN = "choose another folder with --out, or --overwrite to replace it"
# Imports into each folder that is given, in a child that is killed as it asks for its k-th new name, removal or file to
# write; the last child ends. Prints how each ended.
KILLED = """
import os, signal, sys
from tests.fit.here import hangtime_here
words = sys.argv[1:]
hangtime_here(*words, folder="whole")  # all is imported now
def writes(event, given):
    return event in ("os.rename", "os.link", "os.remove") or event == "open" and given[2] & (os.O_WRONLY | os.O_RDWR)
for folder in ("new", "old"):
    k, end = -1, None
    while end != 0:
        k += 1
        child = os.fork()
        if child == 0:
            asked = 0
            def look(event, given):
                global asked
                if writes(event, given) and "/o/" in os.path.abspath(str(given[0])):
                    asked += 1
                    if asked > k:
                        os.kill(os.getpid(), signal.SIGKILL)
            os.chdir(f"{folder}-{k}")
            sys.addaudithook(look)
            hangtime_here(*words, *["--overwrite"] * (folder == "old"), folder=".")
            os._exit(0)
        end = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        print(folder, k, end)
"""
MOST_KILLS = 12


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
    os.utime(folder / "m.csv", (1.75e9, 1.75e9))  # a take holds it


def held_in(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_rig_of_another_take_is_reported_with_steps_that_work(desk):
    before = held_in(desk / "o")
    done = hangtime_here(*IMPORT, "o", folder=desk)
    what = "is already there and describes another rig than that of this take"
    assert (done.returncode, done.stderr) == (2, f"hangtime: o/rig.toml: {what}; {AGAIN}\n")
    assert held_in(desk / "o") == before
    assert hangtime_here(*IMPORT, "other", folder=desk).returncode == 0
    assert hangtime_here(*IMPORT, "o", "--overwrite", folder=desk).returncode == 0
    assert load_rig(desk / "o/rig.toml") == load_rig(desk / "other/rig.toml") == read_take(desk / "o/m.mcap").rig


def test_a_garment_of_another_take_and_a_folder_or_link_at_its_path_are_reported(desk):
    (desk / "o/rig.toml").unlink()
    path = desk / "o/garment.toml"
    other = f"is already there and describes another garment than that of this take; {AGAIN}"
    for make, says in (
        (lambda: path.write_text(dump_description(a_take().garment)), other),
        (lambda: path.write_text("mine"), f"{UNLIKE}: is not valid TOML: Expected '=' after a key in a key/value pair "
         f"(at line 1, the last); {AGAIN}"),
        (lambda: path.write_bytes(b"\0" * 9), f"{UNLIKE}: is a binary file, and no TOML; {AGAIN}"),
        (lambda: path.symlink_to("nowhere"), f"is a link that leads to nothing; {AGAIN}"),
        (path.mkdir, "is a folder; choose another folder with --out"),
    ):  # fmt: skip
        make()
        done = hangtime_here(*IMPORT, "o", folder=desk)
        assert (done.returncode, done.stderr) == (2, f"hangtime: o/garment.toml: {says}\n")
        assert [one.name for one in (desk / "o").iterdir()] == ["garment.toml"]
        path.rmdir() if path.is_dir() else path.unlink()


@pytest.mark.parametrize("name", ["m.mcap", *DESCRIPTIONS])
@pytest.mark.parametrize("more", [(), ("--overwrite",)])
def test_a_pipe_is_not_replaced_and_is_reported_before_the_recording_is_read(desk, name, more):
    (desk / "o/rig.toml").unlink()
    (desk / "m.csv").write_text("no recording")
    os.mkfifo(desk / "o" / name)
    done = hangtime_here(*IMPORT, "o", *more, folder=desk)
    what = "cannot be written (a device, a pipe or a socket is no place for a file)"
    assert done.stderr == f"hangtime: o/{name}: {what}; choose another folder with --out\n"
    assert [one.name for one in (desk / "o").iterdir()] == [name]
    assert (desk / "o" / name).is_fifo()


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """Folders `new-k` and, where a former import is replaced, `old-k`: each left by an import that was killed."""
    folder = tmp_path_factory.mktemp("killed")
    for name in ("whole", *(f"{kind}-{k}" for kind in ("new", "old") for k in range(MOST_KILLS))):
        laid_out(folder / name)
        if name.startswith("old"):
            write_take(folder / name / "o/m.mcap", a_take(20))
            (folder / name / "o/rig.toml").write_text(FORMER)
            (folder / name / "o/garment.toml").write_text(dump_description(a_take().garment))
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    if env.get("MUTANT_UNDER_TEST") == "stats":  # mutmut counts what a test reaches in the test's own process alone
        env["MUTANT_UNDER_TEST"] = ""
    ran = subprocess.run(
        [sys.executable, "-c", KILLED, *IMPORT, "o"], cwd=folder, capture_output=True, text=True, env=env, check=True
    )
    ends = [line.split() for line in ran.stdout.splitlines()]
    assert {end for _, _, end in ends} == {"0", f"{-signal.SIGKILL}"}
    return folder, {kind: [folder / f"{one}-{k}" for one, k, _ in ends if one == kind] for kind in ("new", "old")}


def told_of(folder):
    """What the next commands that meet the folder say of it, and a fit of its take."""
    names = [path.name for path in (folder / "o").iterdir() if path.name in ("m.mcap", "m.mcap.partial")]
    said = [hangtime_here("takes", "list", "o", folder=folder).stdout]
    said += [hangtime_here("takes", "verify", f"o/{name}", folder=folder).stdout for name in names]
    return [*said, *(["; ".join(doubts_of(read_take(folder / "o/m.mcap")))] if "m.mcap" in names else [])]


def assert_mended(folder, whole, *, left=()):
    assert {name: raw for name, raw in held_in(folder / "o").items() if name not in left} == whole


def assert_usable(folder, whole, former):
    """Assert that nothing changes before the take has its name, and that the remaining steps are reported.

    The next import does these steps where nothing is replaced, and an import with `--overwrite` does all of them.
    """
    held, step = held_in(folder / "o"), "rename m.{0}.partial to {0}"
    if "m.mcap" in held and read_take(folder / "o/m.mcap").source == NEW_SOURCE:
        waiting = [name for name in DESCRIPTIONS if held.get(name) != whole[name]]
        assert held.keys() <= {*whole, *(f"m.{name}.partial" for name in DESCRIPTIONS)}
        for name in waiting:
            assert (held.get(name), held[f"m.{name}.partial"]) == (former.get(name), whole[name])
        assert all(step.format(name) in said for name in waiting for said in told_of(folder))
        shutil.copytree(folder, folder / "copy")
        for name in waiting:
            (folder / f"copy/o/m.{name}.partial").rename(folder / "copy/o" / name)
        hangtime_here(*IMPORT, "o", folder=folder / "copy")
        assert_mended(folder / "copy", whole)
        again = hangtime_here(*IMPORT, "o", folder=folder)
        settled = [name for name in waiting if name not in former]
        assert again.stdout.count("now describes a take whose import was interrupted") == len(settled)
        if settled != waiting:
            now = held_in(folder / "o")
            assert all(now[name] == former[name] for name in set(waiting) - set(settled))
            assert hangtime_here(*IMPORT, "o", "--overwrite", folder=folder).returncode == 0
        assert_mended(folder, whole)
        return len(waiting)
    assert {name: held.get(name) for name in former} == former, "nothing is lost"
    assert held.keys() <= {*former, "m.mcap.partial", *(f"m.{name}.partial" for name in DESCRIPTIONS)}
    again = hangtime_here(*IMPORT, "o", folder=folder)
    if held.get("m.mcap.partial"):
        assert (again.returncode, "is what an interrupted recording or import" in again.stderr) == (2, True)
        assert "m.mcap.partial: " in told_of(folder)[0]
        is_whole = len(held["m.mcap.partial"]) == len(whole["m.mcap"])
        assert ("the file is whole and never got its name; `hangtime takes recover`" in told_of(folder)[0]) == is_whole
    done = hangtime_here(*IMPORT, "o", "--overwrite", folder=folder)
    assert done.returncode == 0
    is_aside = bool(held.get("m.mcap.partial"))
    assert done.stdout.startswith("o/m.mcap.partial: was in the way, and is put aside as m.left-1") == is_aside
    assert_mended(folder, whole, left=["m.left-1.mcap.partial"] * is_aside)
    assert not is_aside or held_in(folder / "o")["m.left-1.mcap.partial"] == held["m.mcap.partial"]
    return -1


@pytest.mark.parametrize("kind", ["new", "old"])
def test_a_killed_import_loses_nothing_and_the_next_command_says_what_it_left(killed, kind):
    """It may be killed before the take has its name, then with two, one and no description left to be renamed."""
    folder, killed_in = killed
    former = held_in(folder / f"{kind}-{MOST_KILLS - 1}/o")
    whole = held_in(folder / "whole/o")
    left = [assert_usable(one, whole, former) for one in killed_in[kind]]
    assert len(left) < MOST_KILLS, "one folder is as it was before"
    assert sorted(set(left)) == [-1, 0, 1, 2]
