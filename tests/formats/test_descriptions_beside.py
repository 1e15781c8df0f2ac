"""The rig and garment beside an imported take change with it: both or neither, by one import at a time."""

from __future__ import annotations

import errno
import fcntl
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import msgspec
import pytest

from formats.archive import read_take, write_take
from formats.descriptions import dump_description, load_garment, load_rig
from formats.descriptions_beside import described_beside, settle
from formats.errors import OutputError
from formats.fault_words import unsettled
from formats.rig import Rig
from tests.fit.here import hangtime_here
from tests.formats.test_archive import RIG, a_take
from tests.formats.test_command_line import swung_cloth
from tests.formats.test_marker_oddities import GARMENT

A_RIG = Rig(format="hangtime-rig/1", name="a", gravity=(0.0, 0.0, -1.0))
OTHER = msgspec.structs.replace(A_RIG, name="b")


def held_in(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


def beside(take, descriptions, *, overwrite=False, tell_aside=None):
    def tell_left(name, error):
        raise error

    return described_beside(take, descriptions, overwrite=overwrite, tell_aside=tell_aside, tell_left=tell_left)


def put_beside(take, description, *, overwrite=False, name="rig.toml"):
    with beside(take, {name: description}, overwrite=overwrite):
        pass


@pytest.mark.parametrize(("description", "name"), [(GARMENT, "garment.toml"), (RIG, "rig.toml")])
@pytest.mark.parametrize("overwrite", [False, True])
def test_a_description_that_says_the_same_keeps_its_comments(tmp_path, description, name, overwrite):
    for _ in range(2):
        put_beside(tmp_path / "a.mcap", description, overwrite=overwrite, name=name)
        mine = f"# mine\n{dump_description(description)}"
        assert held_in(tmp_path).keys() == {name}
        (tmp_path / name).write_text(mine)
    put_beside(tmp_path / "a.mcap", description, overwrite=overwrite, name=name)
    assert held_in(tmp_path) == {name: mine}


CALIBRATED = """format = "hangtime-rig/1"
name = "bench"
gravity = [0.0, 1.0, 0.0]
[calibration]
created = "2026-01-01T00:00:00+00:00"
"""


@pytest.mark.parametrize("text", [CALIBRATED, CALIBRATED.replace("name", "nmae"), f'{CALIBRATED}broken = "'])
def test_an_import_that_may_overwrite_keeps_the_rig_of_a_sensor_and_says_so(tmp_path, text):
    swung_cloth(tmp_path / "a.npz")
    (tmp_path / "rig.toml").write_text(text)
    for words in ((), ("--overwrite",)):
        done = hangtime_here("import", "a.npz", "--out", ".", *words, folder=tmp_path)
        assert (tmp_path / "rig.toml").read_text() == text
        assert done.returncode == (0 if words else 2), done.stderr
    told = "Warning: rig.toml: describes a sensor's rig, and stays as it is; choose another folder with --out for "
    assert f"{told}the take's own rig\n" in done.stdout
    assert read_take(tmp_path / "a.mcap").rig.calibration is None
    assert (tmp_path / "garment.toml").exists()


def test_an_import_that_may_overwrite_keeps_what_a_person_may_have_written(tmp_path):
    """A garment and a rig with comments; in turn, so that no kept file is replaced."""
    swung_cloth(tmp_path / "a.npz")
    by_hand = [f"# weighed wet\n{dump_description(GARMENT)}", "no garment at all"]
    rig = f"# measured with a level\n{dump_description(OTHER)}"
    for number, garment in enumerate(by_hand, 1):
        (tmp_path / "garment.toml").write_text(garment)
        (tmp_path / "rig.toml").write_text(rig)
        done = hangtime_here("import", "a.npz", "--out", ".", "--overwrite", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        for name in ("garment", "rig"):
            assert f"{name}.toml: was in the way, and is put aside as {name}.kept-{number}.toml" in done.stdout
    assert [(tmp_path / f"garment.kept-{number}.toml").read_text() for number in (1, 2)] == by_hand
    assert (tmp_path / "rig.kept-2.toml").read_text() == rig
    assert load_garment(tmp_path / "garment.toml") == read_take(tmp_path / "a.mcap").garment


def test_an_import_that_may_overwrite_replaces_the_rig_of_another_import(tmp_path):
    swung_cloth(tmp_path / "a.npz")
    (tmp_path / "rig.toml").write_text(dump_description(OTHER))
    done = hangtime_here("import", "a.npz", "--out", ".", "--overwrite", folder=tmp_path)
    assert "rig" not in done.stdout
    assert load_rig(tmp_path / "rig.toml") == read_take(tmp_path / "a.mcap").rig


def test_a_garment_that_means_the_same_in_other_words_is_the_same_and_one_that_was_accepted_is_read(tmp_path):
    """Two versions of the format say the same; of 0.5 kg no swatch would be, unless --anyway accepts it."""
    heavy = msgspec.structs.replace(GARMENT, mass_kg=0.5)
    latest = msgspec.structs.replace(heavy, format="hangtime-garment/2")
    put_beside(tmp_path / "a.mcap", heavy, name="garment.toml")
    put_beside(tmp_path / "b.mcap", latest, name="garment.toml")
    assert held_in(tmp_path) == {"garment.toml": dump_description(heavy)}
    seen = msgspec.structs.replace(latest, points_are="silhouette")
    with pytest.raises(OutputError, match=r"garment\.toml: is already there and describes another garment than that"):
        put_beside(tmp_path / "c.mcap", seen, name="garment.toml")


def test_imports_that_put_one_description_there_at_once_all_go_on(tmp_path):
    """Side by side into one folder; another description there is still refused."""
    together, imports = Barrier(6), range(6)

    def write(number):
        take = tmp_path / f"{number}.mcap"
        together.wait()
        write_take(take, a_take(20), overwrite=False, beside=beside(take, {"rig.toml": A_RIG}))

    with ThreadPoolExecutor(len(imports)) as threads:
        list(threads.map(write, imports))
    assert sorted(path.name for path in tmp_path.iterdir()) == [*(f"{number}.mcap" for number in imports), "rig.toml"]
    with pytest.raises(OutputError, match="is already there and describes another rig"):
        put_beside(tmp_path / "7.mcap", OTHER)


def test_work_that_fails_before_the_take_has_its_name_changes_nothing(tmp_path):
    (tmp_path / "rig.toml").write_text(dump_description(OTHER))
    (tmp_path / "a.mcap.partial").write_text("the take")
    before = held_in(tmp_path)

    def fail():
        with beside(tmp_path / "a.mcap", {"rig.toml": A_RIG, "garment.toml": GARMENT}, overwrite=True):
            assert len(held_in(tmp_path)) == 4, "both wait"
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert held_in(tmp_path) == before


def test_work_that_is_interrupted_after_the_take_has_its_name_leaves_what_is_its_own(tmp_path):
    """Its own is what the archive says. A description of no take, or of another one, is never removed."""
    take = a_take(20)
    (tmp_path / "rig.toml").write_text(dump_description(OTHER))
    others = {"a.garment.toml.partial": "# mine", "gone.rig.toml.partial": dump_description(OTHER)}
    for name, text in others.items():
        (tmp_path / name).write_text(text)

    def interrupt():
        with beside(tmp_path / "a.mcap", {"rig.toml": take.rig}, overwrite=True):
            write_take(tmp_path / "a.mcap", take)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupt()
    assert (tmp_path / "rig.toml").read_text() == dump_description(take.rig)
    assert settle(tmp_path) == []
    assert read_take(tmp_path / "a.mcap").report.left == {}
    assert sorted(path.name for path in tmp_path.iterdir()) == [*sorted({"a.mcap", *others}), "rig.toml"]


def left_by_a_killed_import(folder, take):
    write_take(folder / "a.mcap", take)
    (folder / "rig.toml").write_text(dump_description(OTHER))
    (folder / "a.rig.toml.partial").write_text(dump_description(take.rig))


def told_of(take):
    return unsettled(read_take(take).report)


def test_a_description_that_says_the_same_as_the_one_that_was_left_is_not_advised_and_the_other_is_removed(tmp_path):
    take = a_take(20)
    left_by_a_killed_import(tmp_path, take)
    mine = f"# mine\n{dump_description(take.rig)}"
    (tmp_path / "rig.toml").write_text(mine)
    assert told_of(tmp_path / "a.mcap") == []
    assert settle(tmp_path) == []
    (tmp_path / "a.mcap").unlink()
    assert held_in(tmp_path) == {"rig.toml": mine}


def test_a_description_that_was_left_and_cannot_be_read_is_reported(tmp_path, monkeypatch):
    left_by_a_killed_import(tmp_path, a_take(20))
    opened = Path.open

    def refuse(path, *how, **more):
        if path.name == "a.rig.toml.partial":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return opened(path, *how, **more)

    monkeypatch.setattr(Path, "open", refuse)
    words = "a.rig.toml.partial, which an import left beside it, cannot be read; get the permission to read it"
    assert told_of(tmp_path / "a.mcap") == [words]


def test_a_description_that_cannot_be_replaced_leaves_the_take_its_name_and_is_reported(tmp_path, monkeypatch):
    """As where it belongs to another user, in a folder whose files only their owners may replace."""
    swung_cloth(tmp_path / "a.npz")
    (tmp_path / "takes").mkdir()
    (tmp_path / "takes/garment.toml").write_text(dump_description(GARMENT))
    replace = Path.replace

    def refuse(path, target):
        if target.name == "garment.toml":
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), str(path))
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", refuse)
    done = hangtime_here("import", "a.npz", "--overwrite", folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, "")
    assert done.stdout.startswith(
        "takes/a.mcap: 40 frames, 4.3 s\nWarning: takes/garment.toml: cannot be replaced (Operation not permitted), "
        "and a.mcap is there; remove it, or have its owner do so, then rename a.garment.toml.partial to garment.toml\n"
    )
    assert (tmp_path / "takes/garment.toml").read_text() == dump_description(GARMENT)
    by_hand = tmp_path / "by-hand"
    by_hand.mkdir()
    (by_hand / "garment.toml").write_text(f"# weighed wet\n{dump_description(GARMENT)}")
    done = hangtime_here("import", "a.npz", "--out", "by-hand", "--overwrite", folder=tmp_path)
    assert "put aside" not in done.stdout  # since nothing replaced it
    assert not list(by_hand.glob("*.kept-*"))
    monkeypatch.undo()
    assert settle(tmp_path / "takes") == []
    (tmp_path / "takes/garment.toml").unlink()
    assert settle(tmp_path / "takes") == [tmp_path / "takes/garment.toml"]


def another(path):
    path.write_text(f"# mine\n{dump_description(OTHER)}")


def a_link(path):
    path.symlink_to("gone")


@pytest.mark.parametrize("make", [another, a_link])
def test_a_users_files_beside_a_take_are_not_replaced_by_files_of_a_killed_import(tmp_path, make):
    """Whichever was changed last: a copy of the folder, or of the rights of its files, dates both anew."""
    take = a_take(20)
    left_by_a_killed_import(tmp_path, take)
    (tmp_path / "rig.toml").unlink()
    make(tmp_path / "rig.toml")
    (tmp_path / "a.rig.toml.partial").chmod(0o600)  # is the last to be changed
    before = os.lstat(tmp_path / "rig.toml")
    assert settle(tmp_path) == []
    after = os.lstat(tmp_path / "rig.toml")  # but for the time of access, which readers move
    for part in ("st_ino", "st_mode", "st_size", "st_mtime_ns", "st_ctime_ns"):
        assert getattr(after, part) == getattr(before, part), part
    assert told_of(tmp_path / "a.mcap") == [
        "its import ended before it replaced rig.toml beside the take; rename a.rig.toml.partial to rig.toml, or "
        "remove a.rig.toml.partial"
    ]
    (tmp_path / "rig.toml").unlink()
    assert settle(tmp_path) == [tmp_path / "rig.toml"]
    assert load_rig(tmp_path / "rig.toml") == take.rig
    assert told_of(tmp_path / "a.mcap") == []


def test_a_description_that_comes_there_while_an_import_works_is_replaced_only_where_that_was_asked(tmp_path):
    take, told = a_take(20), []
    for overwrite in (False, True):
        given = described_beside(
            tmp_path / "a.mcap", {"rig.toml": take.rig}, overwrite=overwrite,
            tell_left=lambda name, error: told.append(str(error)),
        )  # fmt: skip
        with given:
            write_take(tmp_path / "a.mcap", take, overwrite=overwrite)
            another(tmp_path / "rig.toml")
        mine = dump_description(take.rig if overwrite else OTHER)
        assert (tmp_path / "rig.toml").read_text().removeprefix("# mine\n") == mine
    assert [words.partition("; ")[0].partition(": ")[2] for words in told] == [
        "cannot be replaced (File exists), and a.mcap is there"
    ]


def test_a_take_that_a_killed_import_did_not_replace_reports_no_description(tmp_path):
    """The old take stays, beside what was prepared for the new one."""
    take = a_take(20)
    left_by_a_killed_import(tmp_path, take)
    (tmp_path / "a.rig.toml.partial").write_text(dump_description(msgspec.structs.replace(take.rig, name="new")))
    assert read_take(tmp_path / "a.mcap").report.left == {}
    assert settle(tmp_path) == []
    assert (tmp_path / "rig.toml").read_text() == dump_description(OTHER)


def test_a_folder_that_another_program_keeps_locked_is_named_after_a_while(tmp_path, monkeypatch):
    monkeypatch.setattr("formats.descriptions_beside.PATIENCE", 0.1)
    handle = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        with pytest.raises(OutputError, match=r"has been locked by another program for 0\.1 s; wait until"):
            settle(tmp_path)
    finally:
        os.close(handle)
    assert settle(tmp_path) == []
    with pytest.raises(OutputError, match="gone: cannot be read"):
        settle(tmp_path / "gone")


def a_file(path):
    path.write_text("# mine")


def an_empty_file(path):
    path.touch()


def a_name_of_another(path):
    path.with_name("mine.toml").write_text("# mine")
    path.hardlink_to(path.with_name("mine.toml"))


@pytest.mark.parametrize("make", [a_file, an_empty_file, a_link, a_name_of_another, os.mkfifo, os.mkdir])
def test_whatever_has_the_first_name_of_a_description_is_put_aside_and_reported(tmp_path, make):
    """The program neither removes nor writes the other file, and does not wait for a pipe."""
    take, told = a_take(20), []
    make(tmp_path / "a.rig.toml.partial")
    before = os.lstat(tmp_path / "a.rig.toml.partial")
    with beside(tmp_path / "a.mcap", {"rig.toml": take.rig}, tell_aside=lambda *two: told.append(two)):
        write_take(tmp_path / "a.mcap", take)
    aside = tmp_path / "a.rig.left-1.toml.partial"
    assert told == [(tmp_path / "a.rig.toml.partial", aside)]
    after = os.lstat(aside)
    assert (after.st_ino, after.st_mode, after.st_size) == (before.st_ino, before.st_mode, before.st_size)
    assert (tmp_path / "rig.toml").read_text() == dump_description(take.rig)


def test_files_that_a_killed_import_of_the_same_description_left_are_used_up(tmp_path):
    take = a_take(20)
    (tmp_path / "a.rig.toml.partial").write_text(dump_description(take.rig))
    put_beside(tmp_path / "a.mcap", take.rig)
    assert held_in(tmp_path) == {"rig.toml": dump_description(take.rig)}
