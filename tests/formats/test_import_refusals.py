"""Errors about files that cannot be imported name the true cause."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import time
import warnings
import zipfile
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.descriptions import dump_description, load_garment, load_rig
from formats.errors import DescriptionError, ImplausibleError, TakeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import write_marker_csv
from formats.importers.swatch_mocap import MarkerOptions, import_marker_take
from formats.importers.units import other_unit
from formats.plausible import check_plausible_rig
from formats.rig import Sensor
from tests.fit.here import hangtime_here
from tests.formats.test_archive import RIG
from tests.formats.test_command_line import swung_cloth
from tests.formats.test_marker_oddities import GARMENT, hanging


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.oni", "ends in .oni, which is no kind of file that can be imported; `hangtime record --sensor FILE`"),
        ("a.mcap", "ends in .mcap, which is no kind of file that can be imported; a take needs no import"),
        ("a.BVH", "ends in .BVH, which is no kind of file that can be imported; `hangtime animate --bvh FILE`"),
        ("a.xlsx", "ends in .xlsx, which is no kind of file that can be imported; give marker paths (.c3d, .trc"),
        ("a", "has no ending, which is no kind of file that can be imported; give marker paths"),
        ("a.npz", "is no .npz archive; give marker paths"),
    ],
)
def test_a_file_that_import_cannot_read_is_refused_with_the_command_that_reads_it(tmp_path, name, words):
    (tmp_path / name).write_bytes(b"something")
    done = hangtime_here("import", name, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"hangtime: {name}: {words}")


def test_an_archive_that_is_cut_off_is_reported_from_another_kind_of_file(tmp_path):
    np.savez(tmp_path / "a.npz", points=np.zeros((40, 3)))
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:-100])
    done = hangtime_here("import", "a.npz", folder=tmp_path)
    told = "no end of its archive was found: it is cut off, or damaged at its end; copy or export it again"
    assert done.stderr == f"hangtime: a.npz: {told}\n"


def test_bytes_behind_the_end_of_an_archive_are_counted(tmp_path):
    """Python finds an end only in the last 64 KiB, where a zip archive may have a comment."""
    np.savez(tmp_path / "a.npz", points=np.zeros((40, 3)), t=np.frombuffer(b"PK\5\6" * 20, np.uint8))
    raw = (tmp_path / "a.npz").read_bytes()
    for behind in (b"x" * 100_000, bytes(70_000), b"PK\5\6" * 20_000):
        (tmp_path / "a.npz").write_bytes(raw + behind)
        done = hangtime_here("import", "a.npz", folder=tmp_path)
        told = f"{len(behind)} bytes follow the end of its archive; copy or export it again"
        assert (done.returncode, done.stderr) == (2, f"hangtime: a.npz: {told}\n")


@pytest.mark.parametrize("again", ["points.npy", "points"])
def test_an_array_that_an_archive_holds_twice_is_refused(tmp_path, again):
    """The last one of a name would count, and the other be lost without a word."""
    swung_cloth(tmp_path / "a.npz")
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # Python's, of the name that is there
        archive.writestr("notes.npy", b"")  # another program's, whose copy hurts nothing
        archive.writestr("notes.npy", b"")
        assert hangtime_here("import", "a.npz", "--out", "one", folder=tmp_path).returncode == 0
        archive.writestr(again, archive.read("points.npy"))
    done = hangtime_here("import", "a.npz", folder=tmp_path)
    told = "holds the array 'points' 2 times, and which of them counts is unknown; export it again"
    assert (done.returncode, done.stderr) == (2, f"hangtime: a.npz: {told}\n")


@pytest.mark.parametrize("name", ["a.csv", "a.npz", "a b"])
@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (["x.C3D", "y.csv", "z.csv", "notes.md"], "is a folder; give the files in it, as in NAME/*.C3D NAME/*.csv"),
        (["x.mcap"], "is a folder of takes; `hangtime takes list NAME` lists them"),
        ([], "is a folder without .c3d, .trc, .csv, .tsv"),
    ],
)
def test_a_folder_is_refused_with_a_pattern_of_its_files(tmp_path, name, inside, said):
    """Its files may be of several garments, so that an import takes them by name."""
    (tmp_path / name).mkdir()
    for one in inside:
        (tmp_path / name / one).touch()
    (tmp_path / "swatch.toml").write_text(dump_description(GARMENT))
    done = hangtime_here("import", name, "--garment", "swatch.toml", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"hangtime: {name}: {said.replace('NAME', shlex.quote(name))}")


@pytest.mark.parametrize("name", ["a\x1b[2J", "a\nb", "a\u202eb", "it's"])
def test_the_pattern_of_a_folder_with_an_odd_name_is_one_that_a_shell_takes(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / name / "x.csv").touch()
    (tmp_path / "swatch.toml").write_text(dump_description(GARMENT))
    done = hangtime_here("import", name, "--garment", "swatch.toml", folder=tmp_path)
    pattern = done.stderr.split("as in ")[1].removesuffix("\n")
    assert pattern.isprintable()
    listed = subprocess.run(["bash", "-c", f"printf %s {pattern}"], cwd=tmp_path, capture_output=True, check=True)
    assert listed.stdout.decode() == f"{name}/x.csv"


def test_an_unknown_subject_is_named_with_those_that_are_there(tmp_path):
    two = hanging()
    labels = tuple(f"{who}:{label}" for who in "BA" for label in two.labels)
    both = replace(two, labels=labels, positions=np.concatenate([two.positions, two.positions + 1.0], axis=1))
    path = write_marker_csv(tmp_path / "a.csv", both)
    with pytest.raises(TakeError, match=r"has no subject 'C'; give --subject, one of A, B$"):
        import_marker_take(path, GARMENT, MarkerOptions(subject="C"))
    assert import_marker_take(path, GARMENT, MarkerOptions(subject="A")).points[0, 0, 0] > 0.5
    plain = write_marker_csv(tmp_path / "b.csv", two)
    with pytest.raises(TakeError, match=r"has no subject 'C'; leave out --subject"):
        import_marker_take(plain, GARMENT, MarkerOptions(subject="C"))


@pytest.mark.parametrize(
    ("times", "words"),
    [(1000.0, "millimetres that were taken for metres?"), (100.0, "centimetres that were taken for metres?"),
     (10.0, "millimetres that were taken for centimetres?"), (0.001, "metres that were taken for millimetres?"),
     (1 / 25.4, "inches that were taken for millimetres?"), (1.4, ""), (5.0, ""), (0.0, "")],
)  # fmt: skip
def test_a_wrong_unit_is_guessed_from_how_far_off_lengths_are(times, words):
    assert other_unit(times).endswith(words)
    assert bool(other_unit(times)) == bool(words)


@pytest.mark.parametrize(
    ("times", "words"), [(1000.0, "millimetres that were taken for m"), (0.01, "metres that were taken for c")]
)
def test_markers_in_another_unit_than_stated_bring_the_question(tmp_path, times, words):
    tracks = hanging()
    path = write_marker_csv(tmp_path / "a.csv", replace(tracks, positions=times * tracks.positions))
    with pytest.raises(TakeError, match=rf"; are these {words}[a-z]*\?"):
        import_marker_take(path, GARMENT)


@pytest.mark.parametrize(("unit", "times"), [("mm", 1000.0), ("cm", 100.0), ("in", 1 / 0.0254)])
def test_the_names_of_the_columns_state_the_unit(tmp_path, unit, times):
    tracks = hanging()
    path = write_marker_csv(tmp_path / "a.csv", replace(tracks, positions=times * tracks.positions))
    head, _, frames = path.read_text().partition("\n")
    path.write_text(head.replace("_m,", f"_{unit},").removesuffix("_m") + f"_{unit}\n{frames}")
    take = import_marker_take(path, GARMENT)
    assert take.points == pytest.approx(tracks.positions, abs=1e-4)
    path.write_text(head.replace("_m,", f"_{unit},") + f"\n{frames}")  # the last one is of another unit
    with pytest.raises(TakeError, match=rf"column 49 of line 1 is '.*_z_m', not '.*_z_{unit}'"):
        import_marker_take(path, GARMENT)


def test_a_unit_that_contradicts_the_names_of_the_columns_is_refused(tmp_path):
    path = write_marker_csv(tmp_path / "a.csv", hanging())
    with pytest.raises(
        TakeError, match="states its lengths in m, not mm: its 1000 is 1000 m, and would be 1 m; leave out --unit"
    ):
        import_marker_take(path, GARMENT, MarkerOptions(unit="mm"))
    assert len(import_marker_take(path, GARMENT, MarkerOptions(unit="m")).time) > 20


def test_markers_that_were_never_seen_are_named(tmp_path):
    tracks = hanging()
    places = tracks.positions.copy()
    places[:, [5, 9]] = np.nan
    write_marker_csv(tmp_path / "a.csv", replace(tracks, positions=places))
    write_marker_csv(tmp_path / "b.csv", tracks)
    for name, unseen in (("c", 5), ("d", 6)):
        places = tracks.positions.copy()
        places[:, 5 : 5 + unseen] = np.nan
        write_marker_csv(tmp_path / f"{name}.csv", replace(tracks, positions=places))
    (tmp_path / "swatch.toml").write_text(dump_description(GARMENT))
    words = ("import", "a.csv", "b.csv", "--garment", "swatch.toml", "--overwrite")
    advice = "bring the whole garment into view, with nothing before it"
    lines = hangtime_here(*words, folder=tmp_path).stdout.splitlines()
    assert [line for line in lines if "never" in line] == [
        f"Warning: row2_column2, row3_column2 were never seen; {advice}"
    ]
    lines = hangtime_here("import", "c.csv", "d.csv", *words[3:], folder=tmp_path).stdout.splitlines()
    five = ", ".join(GARMENT.point_names[5:10])
    assert [line for line in lines if "never" in line] == [
        f"Warning: {five} were never seen; {advice}", f"Warning: {five} and 1 more were never seen; {advice}"
    ]  # fmt: skip
    told = json.loads(hangtime_here(*words, "--json", folder=tmp_path).stdout)["takes"]
    assert [one["never_seen"] for one in told] == [["row2_column2", "row3_column2"], []]


def test_an_imported_recording_is_judged_as_one_of_our_own(tmp_path):
    """Cloth whose held edge swings by 10 cm, is out of sight for a second, and comes back."""
    tracks = hanging(frames=600)
    swung = tracks.positions + 0.05 * np.sin(tracks.time)[:, None, None] * np.array([1.0, 0, 0])
    lost = swung.copy()
    top = [k for k, name in enumerate(tracks.labels) if name in ("row1_column1", "row1_column4")]
    lost[100:200, top] = np.nan
    write_marker_csv(tmp_path / "whole.csv", replace(tracks, positions=swung))
    write_marker_csv(tmp_path / "lost.csv", replace(tracks, positions=lost))
    (tmp_path / "swatch.toml").write_text(dump_description(GARMENT))
    words = ("import", "whole.csv", "lost.csv", "--garment", "swatch.toml")
    assert [line for line in hangtime_here(*words, folder=tmp_path).stdout.splitlines() if "Warning" in line] == [
        "Warning: the two ends of the held edge were not seen together for 1.0 s from 1.0 s on; "
        "a fit leaves out that time and 2.5 s after it; "
        "record again with both ends of the held edge in view from beginning to end"
    ]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_a_description_is_read_in_every_encoding_that_its_first_bytes_show(tmp_path, encoding):
    path = tmp_path / "a.toml"
    named = dump_description(GARMENT).replace('"swatch"', '"Stück"', 1)
    path.write_bytes(named.replace("\n", "\r\n").encode(encoding))
    assert load_garment(path) == load_garment(_written(tmp_path / "b.toml", named))


def _written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_a_description_in_another_encoding_is_reported_so(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes('name = "Stück"'.encode("cp1252"))
    with pytest.raises(DescriptionError, match=r"is no text in UTF-8 \(at line 1\); save it as UTF-8 text"):
        load_rig(path)


@pytest.mark.parametrize(("name", "focal"), [("fx", 57580.0), ("fy", 5.758), ("fx", 0.5758)])
def test_a_focal_length_of_no_sensor_is_refused_with_what_its_picture_would_span(name, focal):
    sensor = Sensor(width=640, height=480, fx=575.8, fy=575.8, cx=319.5, cy=239.5)
    check_plausible_rig(msgspec.structs.replace(RIG, sensor=sensor), "rig.toml")
    wrong = msgspec.structs.replace(RIG, sensor=msgspec.structs.replace(sensor, **{name: focal}))
    with pytest.raises(ImplausibleError, match=rf"sensor\.{name} = {re.escape(f'{focal:g}')} px lets \d+ pixels span"):
        check_plausible_rig(wrong, "rig.toml")


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * 200_000) + " = 1",
        "[" + " . ".join(["'b c'"] * 100_000) + "]",
        'x = {"y".' + "z." * 50_000 + "w = 1}",
    ],
)
def test_a_key_of_very_many_parts_is_refused_before_it_is_read(tmp_path, text):
    """Python needs minutes and gigabytes for the first."""
    path = tmp_path / "a.toml"
    path.write_text(text)
    start = time.process_time()
    with pytest.raises(DescriptionError, match="has a key of twenty parts or more"):
        load_garment(path)
    assert time.process_time() - start < 1


def test_a_line_of_millions_of_cells_is_refused_before_it_is_split(tmp_path):
    """Ten megabytes of commas become a gigabyte of cells."""
    path = tmp_path / "a.csv"
    path.write_bytes(b"time_s" + 10_000_000 * b"," + b"\n")
    start = time.process_time()
    with pytest.raises(TakeError, match="has a line of more than 100000 cells; export fewer markers"):
        read_marker_tracks(path)
    assert time.process_time() - start < 1
