"""Every refusal of a reader or a command is a whole sentence: the place, the value, the next step."""

from __future__ import annotations

import errno
import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats import command, store_address, telling
from formats.archive import write_take
from formats.descriptions import check_garment, check_rig, dump_description
from formats.errors import WHOLE_STAY, DescriptionError, HangtimeError, TakeError
from formats.importers.c3d_file import LARGEST_C3D
from formats.importers.marker_lines import LARGEST_TEXT
from formats.importers.marker_tracks import write_marker_csv
from formats.outputs import check_is_no_input
from formats.results import load_diagnosis, load_fit_result
from formats.rig import Calibration
from formats.surface import SurfaceScan, decode_scan, encode_scan
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.formats.test_archive import a_take
from tests.formats.test_descriptions import GARMENT, HANGER, HOLE, RIG, cut
from tests.formats.test_marker_oddities import GARMENT as SWATCH
from tests.formats.test_marker_oddities import hanging

SEE = "; see docs/reference/file-formats.md"
MANY = tuple((0.3 * np.sin(a), 0.3 * np.cos(a)) for a in np.radians(np.linspace(-0.1, 359.8, 1001)))


@pytest.fixture
def desk(tmp_path):
    """A folder with takes, marker files, a garment, and what is none of these."""
    write_take(tmp_path / "a.mcap", a_take(20))
    write_take(tmp_path / "other" / "a.mcap", a_take(20))
    write_marker_csv(tmp_path / "m.csv", hanging())
    write_marker_csv(tmp_path / "unseen.csv", replace(hanging(), positions=np.full((30, 16, 3), np.nan)))
    stranger = replace(hanging(), labels=(*SWATCH.point_names, "cap"))
    seen = np.full((30, 17, 3), np.nan)
    seen[:, 16] = 1.0
    write_marker_csv(tmp_path / "cap.csv", replace(stranger, positions=seen))
    (tmp_path / "swatch.toml").write_text(dump_description(SWATCH))
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    (tmp_path / "long.toml").write_text("#" * (1 << 20) + "\n")
    for name, size in (("huge.c3d", LARGEST_C3D), ("huge.csv", LARGEST_TEXT)):
        with (tmp_path / name).open("wb") as sparse:
            sparse.truncate(size + 1)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("takes list file", "file: is no folder; give a folder; `hangtime takes show` shows one take"),
        ("takes list empty", "empty: holds no takes; `hangtime record` and `hangtime import` make some"),
        ("takes show file", "file: is empty; give a take archive"),
        ("takes show gone.mcap", "gone.mcap: cannot be read (No such file or directory); check the path"),
        (
            "takes export a.mcap other/a.mcap --to csv --out here",
            "a.mcap: two takes would become a.csv; export one of them elsewhere",
        ),
        ("import m.csv", "m.csv: motion capture needs to know the garment; give --garment FILE; `hangtime swatch` "
         "writes one, and `hangtime takes labels` names the markers"),
        ("takes export a.mcap other/../a.mcap --to csv --out here", "a.mcap: was given twice; give it once"),
        ("import m.csv other/../m.csv", "m.csv: was given twice; give it once"),
        ("import m.csv other/m.csv", "m.csv: two takes would become m.mcap; import one of them elsewhere"),
        (
            "import m.csv --garment swatch.toml --hanger m.csv",
            "--hanger: motion capture holds its hanger: the markers on the two top corners; leave out --hanger",
        ),
        ("import m.csv --garment swatch.toml --up w", "--up: there is no axis 'w'; choose one of x, y, z, -x, -y, -z"),
        (
            "import unseen.csv --garment swatch.toml",
            "unseen.csv: none of the garment's markers was ever seen; export their trajectories",
        ),
        (
            "import cap.csv --garment swatch.toml",
            "cap.csv: none of the garment's markers was ever seen; export their trajectories",
        ),
        ("import huge.csv --garment swatch.toml", "huge.csv: has 268.4 MB of text; export fewer frames at once"),
        ("import huge.c3d --garment swatch.toml", "huge.c3d: has 1.1 GB, which no C3D file has; check the path"),
        (
            "import m.csv --garment long.toml",
            "long.toml: has more than 1048576 bytes, which no such file has; check the path",
        ),
        ("import m.csv --garment swatch.toml --out file/in", "file/in: cannot be made or written to (Not a "
         "directory); give another path: a part of this one is a file"),
        ("swatch s.toml --mass 0.05 --markers 2", "--markers: a swatch has too few markers along each side (got "
         "2); give 4 or more"),
        ("swatch s.toml --mass 0.05 --markers 45", "--markers: 45 markers along each side are more than the 2000 "
         "that a take holds; give 44 at most"),
        ("swatch s.toml --mass 0.05 --side 500", "--side: no swatch has a side of 500 m and a mass of 0.05 kg; were "
         "millimetres meant? Give metres and kilograms"),
    ],
    ids=lambda words: words if "hangtime" not in words else None,
)  # fmt: skip
def test_a_command_refuses_with_location_value_and_next_step(desk, words, sentence):
    done = hangtime_here(*words.split(), folder=desk)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"hangtime: {sentence}\n")


@pytest.mark.parametrize(
    ("words", "made", "numbers"),
    [
        ("import m.csv --garment swatch.toml --out made", ["garment.toml", "m.mcap", "rig.toml"], ["30 frames"]),
        ("import m.csv --garment swatch.toml --out made --frames 25", None, ["25 frames"]),
    ],
)
def test_the_same_command_with_what_it_asks_for_does_its_work(desk, words, made, numbers):
    done = hangtime_here(*words.split(), folder=desk)
    assert (done.returncode, done.stderr) == (0, "")
    assert made is None or sorted(path.name for path in (desk / "made").iterdir()) == made
    assert all(number in done.stdout for number in numbers)


def of_rig(**changes):
    return check_rig, msgspec.structs.replace(RIG, **changes)


def of_garment(made=GARMENT, **changes):
    return check_garment, msgspec.structs.replace(made, **changes)


def of_hanger(**changes):
    return of_rig(hanger=msgspec.structs.replace(HANGER, **changes))


@pytest.mark.parametrize(
    ("check", "sentence"),
    [
        (of_garment(outline_m=MANY, points=()),
         "outline_m has 1001 corners and holes_m 0, at most 1000 each can be used"),
        (of_garment(cut(), holes_m=(HOLE,) * 334),
         "outline_m has 4 corners and holes_m 1002, at most 1000 each can be used"),
        (of_garment(points=GARMENT.points * 501), "points: 2004 are more than the 2000 that a take holds"),
        (of_garment(outline_m=((0, 0), (0.01, 0), (0.01, -0.005), (0, -0.005)), points=()),
         "outline_m encloses hardly any area (5e-05 m2)"),
        (of_garment(points_are="markers"), 'points_are needs format = "hangtime-garment/2"'),
        (of_garment(cut(), grain_degrees=-91.0), "grain_degrees must be between -90 and 90 (got -91)"),
        (of_garment(cut(), seams=((3, 4),)),
         "seams: [3, 4] are not neighbouring corners of the outline, clockwise, counted from 0"),
        (of_hanger(held_m=((0.2, 0.1, 0.0),) * 2),
         "hanger.held_m: the two ends of the held edge are at the same place"),
        (of_hanger(dot_colours=((0, 0, 255), (0, 256, 0))),
         "hanger.dot_colours must be three numbers from 0 to 255 each (got [0, 256, 0])"),
        (of_hanger(ids=(7, 7)), "hanger.ids must differ (both are 7)"),
        (of_rig(calibration=Calibration(depth_scale=1.3)),
         "calibration.depth_scale must be between 0.8 and 1.25 (got 1.3)"),
        (of_rig(calibration=Calibration(depth_offset_px=(0.0, -31.0))),
         "calibration.depth_offset_px must be at most 30 pixels either way (got -31)"),
        (of_rig(gravity=(0.0, 0.0, 1.02)), "gravity must be a unit vector (its length is 1.02)"),
    ],
)  # fmt: skip
def test_a_description_is_refused_with_its_field_and_value(check, sentence):
    judge, description = check
    with pytest.raises(DescriptionError) as caught:
        judge(description, "a.toml")
    assert str(caught.value) == f"a.toml: {sentence}{SEE}"


def _scan(grid=2, contour=4, time=1.0, place=1.0):
    return SurfaceScan(time=time, grid=np.full((*np.broadcast_to(grid, 2), 3), place), contour=np.zeros((contour, 3)))


@pytest.mark.parametrize(
    ("scan", "sentence"),
    [
        (_scan(grid=(2, 3)), "scan at 1 s: has (2, 3) places and 4 around them; give a square of at most 512 a side "
         "and at most 65536 around it"),
        (_scan(grid=513), "scan at 1 s: has (513, 513) places and 4 around them; give a square of at most 512 a side "
         "and at most 65536 around it"),
        (_scan(contour=65537), "scan at 1 s: has (2, 2) places and 65537 around them; give a square of at most 512 a "
         "side and at most 65536 around it"),
        (_scan(time=-1.1e10), "scan at -1.1e+10 s: lies centuries away; give its time in seconds"),
        (replace(_scan(), contour=np.array([[np.nan, 1.0, 1.0]])), "scan at 1 s: a place lacks a coordinate; give NaN "
         "for all three where it is unseen"),
        (_scan(place=-1001.0), "scan at 1 s: a place lies 1001 m away; give metres"),
    ],
)  # fmt: skip
def test_a_scan_that_no_take_holds_is_refused(scan, sentence):
    with pytest.raises(TakeError) as caught:
        encode_scan(scan)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(("grid", "contour"), [(512, 4), (2, 65536), (0, 0)])
def test_a_scan_of_the_most_points_comes_back(grid, contour):
    found = decode_scan(encode_scan(_scan(grid=grid, contour=contour, time=-1e10, place=1000.0)))
    assert (found.grid.shape, found.contour.shape, found.time) == ((grid, grid, 3), (contour, 3), -1e10)
    assert (found.grid == 1000.0).all()


def _parameter(**changes):
    one, *others = fit_result().parameters
    return {"parameters": [msgspec.structs.replace(one, **changes), *others]}


FIRST = fit_result().parameters[0].name
NO_INTERVAL = f"the interval of {FIRST} has not a lower and an upper end; fit again"


@pytest.mark.parametrize(
    ("load", "record", "sentence"),
    [
        (load_fit_result, {"layers": 0}, "layers is 0, and cloth has one or more; fit again"),
        (load_fit_result, _parameter(interval_low=None, interval_high=1.0), NO_INTERVAL),
        (load_fit_result, _parameter(interval_low=1.0, interval_high=None), NO_INTERVAL),
        (load_fit_result, _parameter(interval_low=1.0, interval_high=0.5), NO_INTERVAL),
        (load_fit_result, {"material": {**fit_result().material, "areal_density": 0.0}},
         "no cloth has areal_density = 0; fit again"),
        (load_diagnosis, {"verdict": "effect", "named": []},
         "the verdict `effect` names exactly one effect; diagnose again"),
        (load_diagnosis, {"named": ["imp"]},
         "names the effect 'imp', which is not among its findings; diagnose again"),
    ],
)  # fmt: skip
def test_a_result_that_contradicts_itself_is_refused(tmp_path, load, record, sentence):
    whole = fit_result() if load is load_fit_result else diagnosis()
    path = tmp_path / "r.json"
    path.write_bytes(msgspec.json.encode(msgspec.structs.replace(whole, **record)))
    with pytest.raises(HangtimeError) as caught:
        load(path)
    assert str(caught.value) == f"{path}: {sentence}"


@pytest.mark.parametrize(("load", "whole"), [(load_fit_result, fit_result()), (load_diagnosis, diagnosis())])
def test_a_result_of_another_version_names_both(tmp_path, load, whole):
    path, (kind, _, version) = tmp_path / "r.json", whole.format.partition("/")
    for other, words in (
        (f"{kind}/{int(version) + 1}", f"has the format {kind}/{int(version) + 1}, and this version of Hangtime reads "
         f"{whole.format}; read it with the version that wrote it, or make it again"),
        ("rig/1", "is not a "),
    ):  # fmt: skip
        path.write_bytes(msgspec.json.encode(whole).replace(whole.format.encode(), other.encode()))
        with pytest.raises(HangtimeError) as caught:
            load(path)
        assert str(caught.value).startswith(f"{path}: {words}")


def test_a_file_that_an_option_reads_is_not_written_over(tmp_path):
    (tmp_path / "f.json").write_text("{}")
    (tmp_path / "link.json").symlink_to("f.json")
    check_is_no_input(tmp_path / "new.json", {"FIT": tmp_path / "f.json"})
    with pytest.raises(HangtimeError) as caught:
        check_is_no_input(tmp_path / "link.json", {"--take": tmp_path / "gone", "FIT": tmp_path / "f.json"})
    assert str(caught.value) == f"{tmp_path / 'link.json'}: is what FIT reads; give another name to --out"


def _opened(url):
    return store_address.folder_of(url) or store_address.open_bucket(url, extra="batch")


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("  ", "no folder or bucket was given; give a path or an address; is a variable empty?"),
        ("ftp://me:secret@host/x", "'ftp://host/x' is neither a folder nor a bucket; give a path, file:///..., "
         "s3://..., gs://... or az://..."),
        ("gs:/x", "'gs:/x' lacks a // behind gs:; write gs://BUCKET/NAME"),
        ("s3://b/x%2fy", "s3://b/x%2fy: has %2f in it, which would be another character in the bucket; choose a name "
         "without %2f"),
        ("s3://b:80/x", "s3://b:80/x: has a port, a user or a password before the bucket's name; write "
         "s3://BUCKET/NAME"),
    ],
)  # fmt: skip
def test_an_address_is_refused_without_its_secrets(url, sentence):
    with pytest.raises(HangtimeError) as caught:
        _opened(url)
    assert str(caught.value) == sentence


def _fails_with(error):
    def run(**_):
        raise error

    return run


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (ModuleNotFoundError(name="cv2.aruco"), "cv2 is not installed; in Hangtime's checkout: pip install -e "
         "'.[capture]'"),
        (ModuleNotFoundError(name="bokeh"), "bokeh is not installed; in Hangtime's checkout: pip install -e "
         "'.[batch]'"),
        (ModuleNotFoundError(name="mcap"), "mcap is not installed; in Hangtime's checkout: scripts/setup"),
        (OSError(errno.ENOSPC, "No space left on device"), "output: cannot be written (No space left on device); "
         f"make room on the disk, or choose another one; {WHOLE_STAY}"),
        (OSError(errno.EROFS, "Read-only file system", "a"), "a: cannot be written (Read-only file system); choose "
         "another folder: the disk of this one is read-only"),
        (OSError(errno.EACCES, "Permission denied", "a"), "a: cannot be used (Permission denied); get the permission "
         "for it, or choose another place"),
        (OSError(errno.EISDIR, "Is a directory", "a"), "a: cannot be used (Is a directory); give a file: this is a "
         "folder"),
        (OSError(errno.EXDEV, "Invalid cross-device link", "a"), "a: cannot be used (Invalid cross-device link); check "
         "the path"),
    ],
)  # fmt: skip
def test_an_error_of_the_system_becomes_one_sentence(monkeypatch, tmp_path, error, sentence):
    def run(**_):
        telling.ask_json(is_asked=True)
        raise error

    monkeypatch.setattr(command, "whole", lambda name: run)
    done = hangtime_here("takes", folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"hangtime: {sentence}\n")
    assert json.loads(done.stdout) == {"error": sentence}


@pytest.mark.parametrize(
    "error", [ModuleNotFoundError(name="formats.gone"), ModuleNotFoundError(), OSError(errno.EBADF, "Bad descriptor")]
)
def test_a_fault_of_the_program_stays_one(monkeypatch, tmp_path, error):
    monkeypatch.setattr(command, "whole", lambda name: _fails_with(error))
    with pytest.raises(type(error)):
        hangtime_here("takes", folder=tmp_path)
