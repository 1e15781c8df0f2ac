"""An exported NPZ file becomes the same take again; a changed one is refused in one sentence."""

from __future__ import annotations

import json
import os
import struct
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from formats.archive import read_take, write_take
from formats.errors import TakeError
from formats.exporters.arrays import ARRAYS, write_npz
from formats.importers import npz
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take
from tests.formats.test_export import whole_take
from tests.formats.unprivileged import hangtime_unprivileged

AGAIN = "export the take again with `hangtime takes export --to npz`"


def bare_take():
    """A take of a version without pitch, hidden points, quality or scans."""
    return replace(
        whole_take(), pitch=None, pitch_sd=None, points_hidden=None, quality=None, scans=(), missing=(),
        is_complete=True,
    )  # fmt: skip


def exported(folder, take=None, **changed):
    """Write a.npz, with some arrays changed, left out where None, or no array but a text."""
    write_npz(folder / "a.npz", take or a_take(frames=12))
    if changed:
        with np.load(folder / "a.npz") as arrays:
            kept = {name: value for name, value in ({**arrays} | changed).items() if value is not None}
        texts = {name: kept.pop(name) for name, value in changed.items() if isinstance(value, str)}
        np.savez(folder / "a.npz", **kept)
        with zipfile.ZipFile(folder / "a.npz", "a") as archive:
            for name, text in texts.items():
                archive.writestr(f"{name}.npy", text)


def about(**changed):
    """The text `about` of a take, with some fields changed."""
    with np.load("a.npz") as arrays:
        return np.array(json.dumps(json.loads(str(arrays["about"])) | changed))


@pytest.mark.parametrize("make", [whole_take, bare_take])
def test_a_take_comes_back_exactly_from_its_export(tmp_path, make):
    gone = make()
    gone.points_valid[3:5, 1] = False
    gone.points[3:5, 1] = np.nan
    missing = ((float(gone.time[4]), float(gone.time[5])),) if gone.missing else ()
    write_take(tmp_path / "swing.mcap", replace(gone, missing=missing))
    done = hangtime_here("takes", "export", "swing.mcap", "--to", "npz", "--out", "npz", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    done = hangtime_here("import", "npz/swing.npz", "--out", "back", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    before, after = read_take(tmp_path / "swing.mcap"), read_take(tmp_path / "back/swing.mcap")
    for name in ARRAYS:
        one, other = getattr(before, name), getattr(after, name)
        assert (one is None) == (other is None), name
        if one is not None:
            assert one.dtype == other.dtype, name
            np.testing.assert_array_equal(one, other, err_msg=name)
    for one, other in zip(before.scans, after.scans, strict=True):
        assert one.time == other.time
        np.testing.assert_array_equal(one.grid, other.grid)
        np.testing.assert_array_equal(one.contour, other.contour)
    for name in ("take_id", "created", "rig", "garment", "source", "notes", "is_complete", "missing"):
        assert getattr(before, name) == getattr(after, name), name
    assert np.isnan(after.points[3:5, 1]).all()
    length = before.time[-1] - before.time[0]
    assert done.stdout.startswith(f"back/swing.mcap: 12 frames, {length:.1f} s")


SHAPES = ("grid", np.zeros((2, 2, 3))), ("contour", np.zeros((4, 3)))
EMPTY = {"time": (), "held": (2, 3), "held_sd": (2, 3), "markers": (2, 3), "points": (4, 3), "points_sd": (4, 3)}
CHANGES = [
    ({"points": None}, "has no array 'points'"),
    ({"time": np.zeros(12)}, "a.npz, frame 1: time goes from 0.000000 s to 0.000000 s"),
    ({"time": np.full(12, np.nan)}, "frame 0: time goes from -inf s to nan s"),
    ({"time": np.array("never")}, "time is an array of <U5, not of "),
    ({"points": np.zeros((12, 5, 3))}, "frame 0: points have shape (5, 3), not (4, 3)"),
    ({"points": np.full((12, 4, 3), 1e9)}, "lies 1e+09 m away"),
    ({"held_valid": np.zeros((3, 2), bool)}, "held_valid has shape (3, 2) for 12 frames"),
    ({"state": np.full(12, -1)}, "state is -1, not between 0 and 65535"),
    ({"points_valid": np.full((12, 4), 2.5)}, "points_valid is an array of float64, not of "),
    ({"scan0_time": np.array(0.5)}, "has no array 'scan0_grid'"),
    ({"scan0_time": np.array("x"), "scan0_grid": np.zeros((2, 2, 3)), "scan0_contour": np.zeros((4, 3))},
     "scan 0 is no time with arrays of numbers"),
    ({f"scan0_{part}": value for part, value in (("time", np.array(np.nan)), *SHAPES)}, "a.npz: scan at nan s: lies"),
    ({f"scan{k}_{part}": value for k in (0, 1) for part, value in (("time", np.array(0.5)), *SHAPES)},
     "a.npz: has two scans of the surface at one time"),
    ({name: np.zeros((0, *shape)) for name, shape in EMPTY.items()}, "a.npz: holds no frame"),
    ({"points_valid": None}, "has no array 'points_valid'"),
    ({"about": np.array("[1]")}, "its array 'about' is no text that describes a take"),
    ({"about": np.array("{")}, "its array 'about' is no text that describes a take"),
    ({"about": np.array("[" * 100_000)}, "its array 'about' is no text that describes a take"),
    ({"about": np.zeros(3)}, "its array 'about' is no text that describes a take"),
    ({"about": np.array("{}")}, "its rig is invalid: "),
    ({"points": "no array"}, "is an .npz archive that is damaged or holds objects"),
    ({"about": np.array(["x"], object)}, "is an .npz archive that is damaged or holds objects"),
    ({"about": np.array("x" * (1 << 22))}, "its arrays have 16.8 MB"),
]  # fmt: skip


@pytest.mark.parametrize(("changed", "said"), CHANGES)
def test_an_export_that_was_changed_is_refused_in_one_sentence(tmp_path, changed, said):
    exported(tmp_path, **changed)
    done = hangtime_here("import", "a.npz", "--out", "back", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("hangtime: a.npz")
    assert said in line
    assert line.endswith((AGAIN, "import shorter recordings"))
    assert not (tmp_path / "back").exists()


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"missing_s": [["a", "b"]]}, "its missing_s must be pairs of seconds"),
        ({"missing_s": 3}, "its missing_s must be pairs of seconds"),
        ({"take_id": 3}, "its header is invalid: take_id"),
        ({"garment": {"format": "hangtime-garment/1"}}, "its garment is invalid: "),
        ({"notes": {"a": 3}}, "its header is invalid: "),
        ({"rig": "\ud800"}, "its array 'about' is no text that describes a take"),
        ({"notes": {"a": "\ud800"}}, "its array 'about' is no text that describes a take"),
        ({"missing_s": [[0.0, 1e9]]}, "its missing_s has a span in which no frames can be missing"),
    ],
)
def test_a_description_that_was_changed_is_refused_by_its_field(tmp_path, monkeypatch, fields, said):
    monkeypatch.chdir(tmp_path)
    exported(tmp_path)
    exported(tmp_path, about=about(**fields))
    done = hangtime_here("import", "a.npz", "--out", "back", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"hangtime: a.npz: {said}")
    assert done.stderr.endswith(f"; {AGAIN}\n")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ["--garment", "g.toml"],
            "--garment: is for other recordings, and a.npz holds a whole take; leave out --garment",
        ),
        (["--hanger", "h.npz"], "--hanger: is for other recordings, and a.npz holds a whole take; leave out --hanger"),
        (["--unit", "mm"], "--unit: is for motion capture, and a.npz is none; leave out --unit"),
    ],
)
def test_an_option_that_an_export_does_not_need_is_refused(tmp_path, options, said):
    exported(tmp_path)
    hangtime_here("swatch", "g.toml", "--mass", "0.05", folder=tmp_path)
    done = hangtime_here("import", "a.npz", *options, "--out", "back", folder=tmp_path)
    assert done.stderr.startswith(f"hangtime: {said}")
    assert not (tmp_path / "back").exists()


def test_a_pipe_is_no_export(tmp_path):
    os.mkfifo(tmp_path / "a.npz")
    done = hangtime_here("import", "a.npz", folder=tmp_path)
    assert done.returncode == 2
    assert "a.npz" in done.stderr


def test_recordings_in_a_folder_without_permission_keep_no_other_from_being_imported(tmp_path):
    exported(tmp_path)
    hangtime_here("swatch", "g.toml", "--mass", "0.05", folder=tmp_path)
    (tmp_path / "shut").mkdir()
    for name in ("b.npz", "c.csv", "d.xyz"):
        (tmp_path / "shut" / name).write_text("x")
    (tmp_path / "shut").chmod(0)
    lost = ["shut/b.npz", "shut/c.csv", "shut/d.xyz"]
    try:
        (mixed, alone) = hangtime_unprivileged(
            ["import", "a.npz", "shut/b.npz", "shut/d.xyz", "--out", "back"],
            ["import", *lost, "--garment", "g.toml", "--out", "none"], folder=tmp_path,
        )  # fmt: skip
    finally:
        (tmp_path / "shut").chmod(0o700)
    assert (mixed.returncode, alone.returncode) == (2, 2)
    assert mixed.stdout.startswith("back/a.mcap: 12 frames")
    told = "lost: {}: cannot be read (Permission denied); get the permission to read it"
    assert alone.stdout.splitlines() == [told.format(name) for name in lost]


def test_arrays_that_grow_from_next_to_nothing_are_refused_before_they_are_unpacked(tmp_path, monkeypatch):
    """A million zeros pack a thousand times smaller; as many random numbers hardly pack at all."""
    monkeypatch.setattr(npz, "FREELY_UNPACKED", 1 << 22)
    wanted = {"most_bytes": 1 << 27, "advice": AGAIN}
    np.savez_compressed(tmp_path / "sound.npz", t=np.random.default_rng(1).normal(size=1_000_000))
    assert npz.load_arrays(tmp_path / "sound.npz", ["t"], **wanted)["t"].shape == (1_000_000,)
    np.savez_compressed(tmp_path / "bomb.npz", t=np.zeros(1_000_000))
    with pytest.raises(TakeError, match=r"its arrays grow from [0-9.]+ kB to 8\.0 MB, as those of no recording do"):
        npz.load_arrays(tmp_path / "bomb.npz", ["t"], **wanted)


def test_an_archive_that_overstates_its_packed_bytes_is_measured_by_the_file(tmp_path, monkeypatch):
    """The directory of a zip archive may state any number; the file has no more bytes than it has."""
    monkeypatch.setattr(npz, "FREELY_UNPACKED", 1 << 22)
    np.savez_compressed(tmp_path / "bomb.npz", t=np.zeros(1_000_000))
    raw = bytearray((tmp_path / "bomb.npz").read_bytes())
    struct.pack_into("<I", raw, raw.rfind(b"PK\1\2") + 20, 1 << 31)  # compressed size (APPNOTE.TXT, 4.3.12)
    (tmp_path / "bomb.npz").write_bytes(raw)
    with pytest.raises(TakeError, match="its arrays grow from"):
        npz.load_arrays(tmp_path / "bomb.npz", ["t"], most_bytes=1 << 27, advice=AGAIN)
