"""What stands in the way of a take that is imported, exported or recovered: its true cause, and a step that works."""

from __future__ import annotations

import fcntl
import json
from dataclasses import replace

import pytest

from formats.archive import verify_take, write_take
from formats.descriptions import dump_description
from formats.importers.marker_tracks import write_marker_csv
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take
from tests.formats.test_marker_oddities import GARMENT, hanging
from tests.formats.unprivileged import hangtime_unprivileged

OTHER_FOLDER = "choose another folder with --out"
IMPORT = ("import", "m.csv", "--garment", "g.toml")
RECOVER = ("takes", "recover", "m.mcap")
LOCKED = "may not be read and written by you, and may be a recording that is still running"
LINK = "is a link to another file, which would be overwritten"
NO_FILE = "and the take is written under this name until it is whole"
WRITING = "another recording or import is writing this"


@pytest.fixture
def desk(tmp_path):
    """A marker file, a garment and a take; folder `o` holds a take of each command's name that is to be written."""
    (tmp_path / "g.toml").write_text(dump_description(GARMENT))
    write_marker_csv(tmp_path / "m.csv", hanging())
    write_take(tmp_path / "m.mcap", a_take(20))
    (tmp_path / "o").mkdir()
    return tmp_path


def held_in(folder):
    return {path.name: path.is_file() and path.read_bytes() for path in folder.rglob("*")}


def as_a_folder(partial):
    partial.mkdir()


def as_a_link(partial):
    (partial.parent / "mine").write_text("mine")
    partial.symlink_to("mine")


@pytest.mark.parametrize(
    ("words", "name", "is_there", "option"),
    [
        (IMPORT, "m.mcap", True, ()), (IMPORT, "m.mcap", False, ("--overwrite",)),
        (RECOVER, "m.recovered.mcap", False, ()),
    ],
    ids=["import", "overwrite", "recover"],
)  # fmt: skip
@pytest.mark.parametrize(
    ("make", "what", "step"),
    [
        (as_a_folder, f"is a folder, {NO_FILE}", f"rename it, or {OTHER_FOLDER}"),
        (as_a_link, LINK, "remove the link"),
        (None, WRITING, f"{OTHER_FOLDER}, or wait until it ends"),
    ],
)  # fmt: skip
def test_an_unfinished_name_that_overwrite_cannot_take_is_reported_at_once(
    desk, words, name, make, what, step, is_there, option
):
    """Whether or not a take is there, and --overwrite is given: it would not help."""
    partial = desk / f"o/{name}.partial"
    if is_there:
        write_take(desk / "o" / name, a_take(20))
    if make is not None:
        make(partial)
        assert_refused(desk, words, option, f"o/{name}.partial: {what}; {step}")
        partial.rename(desk / "o/renamed") if partial.is_dir() else partial.unlink()
    else:
        with partial.open("wb") as running:
            fcntl.flock(running, fcntl.LOCK_EX)
            assert_refused(desk, words, option, f"o/{name}.partial: {what}; {step}")
        partial.unlink()
    assert hangtime_here(*words, "--out", "o", "--overwrite", folder=desk).returncode == 0
    assert hangtime_here(*words, "--out", "another", folder=desk).returncode == 0
    assert verify_take(desk / "o" / name).is_sound


def assert_refused(desk, words, option, sentence):
    before = held_in(desk)
    done = hangtime_here(*words, "--out", "o", *option, folder=desk)
    assert (done.returncode, done.stderr) == (2, f"hangtime: {sentence}\n")
    assert held_in(desk) == before


def test_an_unfinished_take_and_a_rig_without_permission_are_reported_as_such(desk):
    """The take also where another one is there; neither says that the rig is another one."""
    for name in ("o/m.mcap.partial", "rigged/rig.toml"):
        (desk / name).parent.mkdir(exist_ok=True)
        (desk / name).write_text("mine")
        (desk / name).chmod(0)
    write_take(desk / "kept.mcap", a_take(20)).rename(desk / "o/m.mcap")
    commands = [(*IMPORT, "--out", out, *option) for out in ("o", "rigged") for option in ((), ("--overwrite",))]
    plainly, replacing, rigged, replaced = hangtime_unprivileged(*commands, folder=desk)
    for done in (plainly, replacing):
        step = f"get the permission to read and write it, or {OTHER_FOLDER}"
        assert (done.returncode, done.stderr) == (2, f"hangtime: o/m.mcap.partial: {LOCKED}; {step}\n")
    what = "is already there and cannot be compared with the rig of this take: cannot be read (Permission denied)"
    step = f"{OTHER_FOLDER}, or --overwrite to replace it"
    assert (rigged.returncode, rigged.stderr) == (2, f"hangtime: rigged/rig.toml: {what}; {step}\n")
    assert replaced.returncode == 0
    (desk / "o/m.mcap.partial").chmod(0o600)
    assert hangtime_here(*commands[1], folder=desk).returncode == 0
    assert (desk / "o/m.left-1.mcap.partial").read_text() == "mine"


def test_a_link_into_a_locked_folder_stops_no_other_recording(desk):
    """Where the garment goes beside a take; `--overwrite` replaces the link."""
    (desk / "locked").mkdir()
    (desk / "o/garment.toml").symlink_to(desk / "locked/garment.toml")
    (desk / "locked").chmod(0)
    try:
        plainly, replaced = hangtime_unprivileged(
            (*IMPORT, "--out", "o"), (*IMPORT, "--out", "o", "--overwrite"), folder=desk
        )
    finally:
        (desk / "locked").chmod(0o700)
    what = "is already there and cannot be compared with the garment of this take: cannot be read (Permission denied)"
    step = f"{OTHER_FOLDER}, or --overwrite to replace it"
    assert (plainly.returncode, plainly.stderr) == (2, f"hangtime: o/garment.toml: {what}; {step}\n")
    assert replaced.returncode == 0
    assert not (desk / "o/garment.toml").is_symlink()
    assert list((desk / "locked").iterdir()) == []


@pytest.mark.parametrize("option", [(), ("--overwrite",)], ids=["", "overwrite"])
def test_a_folder_where_a_file_should_be_is_reported_before_anything_is_made(desk, option):
    for words, name in (
        (("takes", "export", "m.mcap", "--to", "csv"), "m.csv"), (RECOVER, "m.recovered.mcap"), (IMPORT, "m.mcap"),
    ):  # fmt: skip
        (desk / "o" / name).mkdir()
        assert_refused(desk, words, option, f"o/{name}: is a folder; {OTHER_FOLDER}")
        assert hangtime_here(*words, "--out", "another", folder=desk).returncode == 0
    table = ("takes", "export", "m.mcap", "--to", "parquet")
    assert_refused(desk, table, option, "o: is a folder; give another name")
    assert hangtime_here(*table, "--out", "another.parquet", folder=desk).returncode == 0


def test_a_file_that_is_there_is_reported_with_the_same_two_steps_by_every_command(desk):
    for words, name in (
        (("takes", "export", "m.mcap", "--to", "npz"), "m.npz"), (RECOVER, "m.recovered.mcap"), (IMPORT, "m.mcap"),
    ):  # fmt: skip
        (desk / "o" / name).write_text("mine")
        step = f"{OTHER_FOLDER}, or --overwrite to replace it"
        assert_refused(desk, words, (), f"o/{name}: is already there; {step}")
        for out in (("another",), ("o", "--overwrite")):
            assert hangtime_here(*words, "--out", *out, folder=desk).returncode == 0
    words = ("takes", "export", "m.mcap", "--to", "npz", "--out", ".")
    write_take(desk / "n.npz", replace(a_take(20), take_id="n"))
    done = hangtime_here(*words[:2], "n.npz", *words[3:], "--overwrite", folder=desk)
    assert done.stderr == f"hangtime: n.npz: would replace the take that is read; {OTHER_FOLDER}\n"


@pytest.mark.parametrize(
    ("words", "name", "left"),
    [(IMPORT, "m", b"\0"), (IMPORT, "m", "half"), (RECOVER, "m.recovered", "half")],
    ids=["a zero", "half", "recover"],
)
def test_an_unfinished_take_of_a_single_byte_is_put_aside_and_named(desk, words, name, left):
    """The program does what its refusal offers, and keeps all bytes under another name."""
    raw = (desk / "m.mcap").read_bytes()
    partial, left = desk / f"o/{name}.mcap.partial", raw[: len(raw) // 3] if isinstance(left, str) else left
    partial.write_bytes(left)
    what = "is what an interrupted recording or import left under this name; look at it with `hangtime takes show`"
    step = f"{OTHER_FOLDER}, or --overwrite to put it aside and begin anew"
    assert_refused(desk, words, (), f"o/{name}.mcap.partial: {what}; {step}")
    done = hangtime_here(*words, "--out", "o", "--overwrite", folder=desk)
    told = f"o/{name}.mcap.partial: was in the way, and is put aside as {name}.left-1.mcap.partial"
    assert (done.returncode, done.stdout.splitlines()[0]) == (0, told)
    assert (desk / f"o/{name}.left-1.mcap.partial").read_bytes() == left
    partial.write_bytes(left)
    done = hangtime_here(*words, "--out", "o", "--overwrite", "--json", folder=desk)
    aside = {"file": f"o/{name}.mcap.partial", "put_aside": f"o/{name}.left-2.mcap.partial"}
    assert json.loads(done.stdout)["put_aside"] == [aside]
