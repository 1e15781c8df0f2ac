"""An error about a file that cannot be written names the system's cause, and the step that removes this cause."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys

import pytest

from fit.batch.store import Folder
from fit.errors import BatchError, FitError, UnreachableError
from fit.folders import make_folder
from fit.report.page import write_report
from formats.archive import write_take
from formats.errors import HangtimeError, OutputError
from formats.outputs import make_output_folder, make_parent, refuse_to_replace, write_bytes
from formats.system_causes import FULL, TO_READ, step_to_read, step_to_write
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take
from tests.formats.unprivileged import hangtime_unprivileged
from tests.repository import ROOT

LONG = "n" * 240
ON_DISK = """
import sys
from pathlib import Path
from formats.errors import HangtimeError
from formats.outputs import make_output_folder, write_bytes
try:
    make_output_folder(Path(sys.argv[1]))
    write_bytes(Path(sys.argv[1]) / "a", bytes(1 << 20))
except HangtimeError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("number", "step"),
    [
        (errno.ENOSPC, "make room on the disk, or choose another one"),
        (errno.EDQUOT, "make room in your quota, or choose another disk"),
        (errno.EFBIG, "raise the limit on the size of files (`ulimit -f`), or choose another disk"),
        (errno.EROFS, "choose another folder: the disk of this one is read-only"),
        (errno.EACCES, "choose another folder, or get the permission to write to this one"),
        (errno.ENAMETOOLONG, "choose a shorter name: the system allows no longer one"),
        (errno.EISDIR, "give another name: a folder has this one"),
        (errno.ENOTDIR, "give another path: a part of this one is a file"),
        (errno.EXDEV, "choose another place"),
    ],
)
def test_every_cause_has_its_own_step_and_a_disk_that_is_full_is_tried_again(monkeypatch, tmp_path, number, step):
    """The disk refuses at the opening of the file, as it does in each of these cases."""
    assert step_to_write(OSError(number, "")) == step

    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(OutputError) as refused:
        write_bytes(tmp_path / "a", b"")
    assert str(refused.value) == f"{tmp_path}/a: cannot be written ({os.strerror(number)}); {step}"
    with pytest.raises(BatchError) as kept:
        Folder(tmp_path).write("a", b"")
    assert kept.value.advice.startswith(step)
    assert isinstance(kept.value, UnreachableError) == (number in FULL)


@pytest.mark.parametrize(
    ("path", "step"),
    [
        (LONG + "/" + LONG * 2, "choose a shorter name"),
        ("file/below", "give another path: a part of this one is a file"),
        ("file", "give another name: a file, a device, a pipe or a broken link has this one"),
        ("link", "give another name: a file, a device, a pipe or a broken link has this one"),
        ("pipe", "give another name: a file, a device, a pipe or a broken link has this one"),
        ("loop", "give another path: a link of this one leads to itself"),
        ("loop/below", "give another path: a link of this one leads to itself"),
    ],
)
def test_every_writer_of_a_folder_asks_for_the_same_step(tmp_path, path, step):
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    makers = (make_output_folder, make_folder, lambda folder: make_parent(folder / "a"))
    for make in makers:
        with pytest.raises(HangtimeError) as refused:
            make(tmp_path / path)
        assert refused.value.advice.startswith(step)
    with pytest.raises(FitError) as refused:
        write_report(tmp_path / "gone" / "r.html", fit=None, diagnosis=None)
    assert refused.value.advice == "make its folder first, or give another path"


def test_an_export_under_a_long_name_and_into_a_locked_folder_says_the_true_cause(tmp_path):
    write_take(tmp_path / "a.mcap", a_take(20))
    (tmp_path / f"{LONG}.mcap").hardlink_to(tmp_path / "a.mcap")
    (tmp_path / "locked").mkdir(mode=0o555)
    long, locked = hangtime_unprivileged(
        ("takes", "export", f"{LONG}.mcap", "--to", "npz", "--out", "."),
        ("takes", "export", "a.mcap", "--to", "npz", "--out", "locked"),
        folder=tmp_path,
    )
    assert "cannot be written (File name too long); choose a shorter name" in long.stderr
    assert "locked: cannot be made or written to (Permission denied); choose another folder, or get" in locked.stderr
    assert (long.returncode, locked.returncode) == (2, 2)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("size=64k", "(No space left on device); make room on the disk"),
        ("ro", "(Read-only file system); choose another folder: the disk of this one is read-only"),
    ],
)
def test_a_real_disk_that_is_full_or_read_only_says_so(tmp_path, options, sentence):
    """In a namespace of its own, so that nothing stays mounted."""
    if os.geteuid() or shutil.which("unshare") is None:
        pytest.skip("only root mounts a disk")
    line = 'mount -t tmpfs -o "$1" none "$2" && shift && exec "$2" -c "$3" "$1"'
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", line, "sh", options, str(tmp_path), sys.executable, ON_DISK],
        capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    if "mount" in done.stderr:
        pytest.skip(f"no disk can be mounted here: {done.stderr.strip()}")
    assert sentence in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_a_reader_has_a_step_for_what_a_reader_meets():
    assert {step_to_read(OSError(number, "")) for number in TO_READ} == set(TO_READ.values())
    assert step_to_read(OSError(errno.ENOENT, "")) == "check the path"


@pytest.mark.parametrize(("name", "step"), [
    ("a" * 300, "shorten the name: it has 300 bytes, and the system allows 255"),
    ("\u00e4" * 150, "shorten the name: it has 300 bytes, and the system allows 255"),
    ("a" * 256 + "/b", "shorten the name: it has 256 bytes, and the system allows 255"),
    ("aa/" * 1500, "shorten the path: the system does not allow its length"),
])  # fmt: skip
@pytest.mark.parametrize("command", ["fabric", "report", "export"])
def test_a_result_of_too_long_a_name_is_refused_with_both_lengths(tmp_path, command, name, step):
    done = hangtime_here(command, name, *(["--to", "csv"] if command == "export" else []), folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"cannot be read (File name too long); {step}" in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("verify", "f"), ("show", "f"), ("recover", "f"), ("export", "f", "--to", "npz", "--out", "o"),
    ],
    ids=lambda words: words[0],
)  # fmt: skip
def test_a_take_that_cannot_be_read_gets_the_step_of_its_cause(tmp_path, words):
    (tmp_path / "f").mkdir()
    command, _, *rest = words
    for name, step in (
        ("f", "(Is a directory); give a file: this is a folder"),
        (LONG * 2, f"(File name too long); shorten the name: it has {len(LONG * 2)} bytes, and the system allows 255"),
    ):
        done = hangtime_here("takes", command, name, *rest, folder=tmp_path)
        if command in ("recover", "export") and name == LONG * 2:  # its file would have a name that is longer still
            step = "(File name too long); choose a shorter name"
        assert (done.returncode, step in done.stdout + done.stderr) == (2, True)


def test_a_recording_of_others_that_cannot_be_read_gets_the_step_of_its_cause(tmp_path):
    (tmp_path / "f.npz").symlink_to("f.npz")
    done = hangtime_here("import", "f.npz", f"{LONG * 2}.npz", folder=tmp_path)
    assert done.returncode == 2
    first, second = done.stdout.splitlines()
    assert "f.npz: cannot be read (Too many levels of symbolic links); check the path: a link of it" in first
    assert "(File name too long); choose a shorter name" in second  # of the take, which is longer still


@pytest.mark.parametrize(("length", "over"), [(234, 0), (235, 1), (242, 8)])
def test_an_import_under_a_long_name_is_refused_before_the_file_is_read(tmp_path, length, over):
    """NAME.garment.toml.partial has 21 bytes more than NAME, of which a name has 255 at most."""
    name = "\u00e4" + "n" * (length - 2)
    (tmp_path / f"{name}.npz").write_bytes(b"no recording")
    done = hangtime_here("import", f"{name}.npz", "--out", "o", folder=tmp_path)
    assert done.returncode == 2
    told = (
        f"cannot be written (File name too long); choose a shorter name, by {over} byte{'s' * (over > 1)} or more: 16 "
    )
    assert (told in done.stderr) == (over > 0)
    assert ("no recording" in done.stderr or "is no" in done.stderr) == (over == 0)


@pytest.mark.parametrize(("name", "added", "longest"), [("t.mcap", 8, 247), ("t.svg", 21, 234)])
def test_a_name_that_is_too_long_while_its_file_is_written_is_refused_before(tmp_path, name, added, longest):
    refuse_to_replace(tmp_path / name.rjust(longest, "n"))
    with pytest.raises(OutputError, match=f"by 1 byte or more: {added} bytes are added while it is written"):
        refuse_to_replace(tmp_path / name.rjust(longest + 1, "n"))


def test_a_folder_or_a_link_with_the_name_of_a_file_to_be_written_is_reported(tmp_path):
    write_take(tmp_path / "a.mcap", a_take(20))
    (tmp_path / "folder.png").mkdir()
    for name in ("link.png", "a.recovered.mcap"):
        (tmp_path / name).symlink_to("nowhere")
    link = "is a link that leads to nothing; give another name, or --overwrite to replace it"
    shown = [
        hangtime_here("takes", "show", "a.mcap", "--plot", f"{name}.png", folder=tmp_path)
        for name in ("folder", "link")
    ]
    recovered = hangtime_here("takes", "recover", "a.mcap", folder=tmp_path)
    assert "folder.png: is a folder; give another name\n" in shown[0].stderr
    assert f"link.png: {link}" in shown[1].stderr
    link = link.replace("give another name", "choose another folder with --out")
    assert f"a.recovered.mcap: {link}" in recovered.stdout + recovered.stderr
    assert [one.returncode for one in (*shown, recovered)] == [2, 2, 2]
    with pytest.raises(OutputError, match="is a link that leads to nothing"):
        write_take(tmp_path / "a.recovered.mcap", a_take(20), overwrite=False)
    assert (tmp_path / "link.png").is_symlink()
    assert (tmp_path / "a.recovered.mcap").is_symlink()
