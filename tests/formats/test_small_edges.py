"""Edges of small parts: names without paths, folders without permission, a hanger's own time, a store out of reach."""

from __future__ import annotations

import json
import os
import shutil
import sys
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from formats.errors import AddressError
from formats.exporters.arrays import write_npz
from formats.files_below import files_below
from formats.importers.own_arrays import import_own_arrays
from formats.interrupts import _Imports
from formats.judgement import _end
from formats.meant_units import number_meant
from formats.soft_lines import SoftLines
from formats.store_address import first_line, open_bucket
from formats.summary import summarise
from formats.take import FrameState
from formats.terminal import ProgressLine
from formats.toml_files import LARGEST_TOML, place_in, read_toml
from formats.two_clocks import hanger_gap, with_hanger
from formats.whole_files import give_name, make_writable
from tests.fit.here import hangtime_here
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_archive import a_take
from tests.formats.test_descriptions import RIG
from tests.formats.test_two_clocks import recorded
from tests.formats.unprivileged import without_permissions


def test_a_name_without_a_path_is_listed_as_one_that_was_never_seen(tmp_path):
    """With two paths and three names; the JSON document has all that the lines say."""
    places = np.random.default_rng(0).normal(300, 3, (40, 2, 3))
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(places, ["left", "right one", "gone"], rate=10.0))
    done = hangtime_here("takes", "labels", "a.c3d", folder=tmp_path)
    assert done.stdout.splitlines()[3] == "gone       has no path in the file"
    told = json.loads(hangtime_here("takes", "labels", "a.c3d", "--json", folder=tmp_path).stdout)
    assert {"name": "gone", "seen": 0.0, "first_m": None} in told["markers"]
    assert [one["name"] for one in told["markers"]] == ["left", "right one", "gone"]
    assert told["without_path"] == ["gone"]
    assert (told["file"], told["frames"], told["duration_s"]) == ("a.c3d", 40, pytest.approx(3.9))


def test_a_folder_without_permission_is_an_error_and_one_below_it_is_named(tmp_path):
    for name in ("open", "locked"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.mcap").touch()
    (tmp_path / "locked").chmod(0)
    try:
        with without_permissions():
            assert files_below(tmp_path, ".mcap") == ([tmp_path / "open/a.mcap"], [tmp_path / "locked"])
            with pytest.raises(PermissionError) as caught:
                files_below(tmp_path / "locked", ".mcap")
            assert caught.value.filename == str(tmp_path / "locked")
            done = hangtime_here("takes", "list", "locked", folder=tmp_path)
    finally:
        (tmp_path / "locked").chmod(0o700)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "hangtime: locked: cannot be read (Permission denied); get the permission to read it\n"
    assert files_below(tmp_path / "missing", ".mcap") == ([], [])


@pytest.mark.parametrize(("stated", "is_complete"), [(True, True), (False, False), (None, False), (1, False)])
def test_an_exported_take_is_complete_where_its_text_says_so(tmp_path, stated, is_complete):
    write_npz(tmp_path / "a.npz", a_take(12))
    with np.load(tmp_path / "a.npz") as arrays:
        kept = dict(arrays)
    about = json.loads(str(kept["about"])) | {"is_complete": stated}
    np.savez(tmp_path / "a.npz", **kept | {"about": np.array(json.dumps(about))})
    assert import_own_arrays(tmp_path / "a.npz").is_complete is is_complete


@pytest.mark.parametrize("later", [0.0, 7.5])
@pytest.mark.parametrize(("first", "last", "is_told"), [(3, 39, False), (4, 39, True), (0, 36, False), (0, 34, True)])
def test_the_hangers_own_time_is_told_from_the_takes_beginning(tmp_path, later, first, last, is_told):
    """40 pictures: 39 intervals, of which 36 are enough; whatever the clock shows when the take begins."""
    from formats.importers.swung_cloth import import_swung_cloth

    recorded(tmp_path)
    take = import_swung_cloth(tmp_path / "a.npz")
    at = take.time[first : last + 1]
    found = with_hanger(take, at, np.zeros((len(at), 2, 3)), 0.002)
    found = replace(found, time=found.time + later)
    assert hanger_gap(found) == (f", from {at[0]:.1f} to {at[-1]:.1f} s only" if is_told else "")


def test_a_take_of_points_alone_has_a_hanger_that_was_never_seen():
    take = a_take(30)
    found = summarise(replace(take, state=np.full(30, FrameState.POINTS_ALONE, np.uint16)))
    assert found["hanger_seen_percent"] == 0.0


def test_noise_is_told_in_hundredths_of_a_millimetre():
    take = a_take(30)
    take.points_sd[:] = 0.0375
    assert [one["sd_mm"] for one in summarise(take)["points"]] == [37.5] * 4


@pytest.mark.parametrize(("at", "drawn"), [(0, [0]), (3, [3]), (8, [8])])
def test_a_line_of_one_pixel_covers_the_pixels_of_its_places_and_no_others(at, drawn):
    pytest.importorskip("PIL")
    for is_upright in (True, False):
        lines = SoftLines(9, 9)
        lines.draw([(at, 0), (at, 8)] if is_upright else [(0, at), (8, at)], "black")
        picture = np.asarray(lines.picture().convert("L")).astype(int)
        middle = (picture if is_upright else picture.T)[1:-1]
        assert [k for k in range(9) if (middle[:, k] < 255).any()] == drawn
        assert not middle[:, at].any()


INTERRUPTED = """
import signal
from pathlib import Path
signal.raise_signal(signal.SIGINT)
Path(__file__).with_suffix(".done").touch()
"""


def test_an_import_is_not_interrupted_however_many_came_before_it(tmp_path, monkeypatch):
    """Ctrl-C comes within three modules, one after the other: each is complete before it counts."""
    monkeypatch.setattr(sys, "meta_path", [_Imports(), *sys.meta_path])
    monkeypatch.syspath_prepend(str(tmp_path))
    for number in range(3):
        name = f"interrupted_while_loading_{number}"
        (tmp_path / f"{name}.py").write_text(INTERRUPTED)
        with pytest.raises(KeyboardInterrupt):
            import_module(name)
        assert (tmp_path / f"{name}.done").exists()


def test_an_end_of_the_held_edge_is_a_marker_where_the_rig_has_a_hanger():
    take = a_take(5)
    assert _end(take) == "end of the held edge"
    assert _end(replace(take, rig=RIG)) == "hanger marker"


@pytest.mark.parametrize(
    ("text", "field", "number"),
    [
        ("35 g", "mass_kg", "0.035"), ("35 g", "parts.of.mass_kg", "0.035"), ("35 g", "points[2].mass_kg[1]", "0.035"),
        ("6 cm", "points[2].at_m[0]", "0.06"), ("6 cm", "mass_kg", ""), ("0,06", "points[2].at_m[0]", "0.06"),
        ("35 g", "mass_kg.of", ""),
    ],
)  # fmt: skip
def test_a_number_is_meant_in_the_unit_at_the_end_of_its_field(text, field, number):
    assert number_meant(text, field) == number


def test_buckets_without_their_library_are_told_with_the_address(monkeypatch):
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(AddressError) as caught:
        open_bucket("s3://bkt/run", extra="batch")
    assert str(caught.value) == (
        "s3://bkt/run: buckets need the library obstore; in Hangtime's checkout: pip install -e '.[batch]'"
    )


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("Generic S3 error: no such host\nand more", "no such host"), ("plainly wrong", "plainly wrong"),
        ("", "ValueError"),
    ],
)  # fmt: skip
def test_a_stores_error_is_told_by_its_first_line_without_the_librarys_name(text, line):
    assert first_line(ValueError(text)) == line


@pytest.mark.parametrize(
    "words", ["name must be text", "unknown field `a`", "the field `a` is missing in b", "1 is odd"]
)
def test_a_field_of_tables_without_a_text_has_the_path_for_its_place(words):
    assert place_in("a.toml", {}, words) == "a.toml"


def test_a_toml_file_of_the_largest_size_is_read_and_a_larger_one_refused(tmp_path):
    path, line = tmp_path / "a.toml", b'name = "a"\n'
    path.write_bytes(line + b"#" * (LARGEST_TOML - len(line)))
    assert read_toml(path) == {"name": "a"}
    with path.open("ab") as file:
        file.write(b"#")
    with pytest.raises(
        Exception, match=r"a\.toml: has more than 1048576 bytes, which no such file has; check the path"
    ):
        read_toml(path)


@pytest.mark.parametrize(("first", "share", "is_told"), [(0.5, 0.51, False), (0.5, 0.53, True), (0.97, 0.985, False)])
def test_the_time_that_is_left_is_not_told_from_work_of_an_earlier_process(first, share, is_told):
    """A fiftieth of the work has to be done by this one, whatever was there before."""
    now = [0.0]
    line = ProgressLine("fit", lambda: now[0])
    assert line._left(first) == ""
    now[0] = 3.5
    assert bool(line._left(share)) == is_told


def test_a_rename_that_replaces_nothing_is_audited_as_any_rename(tmp_path):
    seen = []
    sys.addaudithook(lambda event, given: seen.append((event, *given)) if event == "os.rename" else None)
    (tmp_path / "a.partial").write_text("mine")
    give_name(tmp_path / "a.partial", tmp_path / "a", may_replace=False)
    assert seen[-1] == ("os.rename", str(tmp_path / "a.partial"), str(tmp_path / "a"), -1, -1)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    (tmp_path / "b.partial").write_text("other")
    with pytest.raises(FileExistsError, match="File exists"):
        give_name(tmp_path / "b.partial", tmp_path / "a", may_replace=False)
    assert ((tmp_path / "a").read_text(), (tmp_path / "b.partial").read_text()) == ("mine", "other")


def test_a_folder_is_writable_where_the_system_has_no_nameless_files(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "O_TMPFILE")
    monkeypatch.setattr("tempfile._O_TMPFILE_WORKS", False)  # which Python finds when it loads the module
    make_writable(tmp_path / "new/below")
    assert list((tmp_path / "new/below").iterdir()) == []
    shutil.rmtree(tmp_path / "new")
