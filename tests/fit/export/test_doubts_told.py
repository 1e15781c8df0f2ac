"""What the commands print of a fit whose numbers are doubtful, and that the file says the same."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest

from fit.export.about import doubts
from fit.export.fabric import fabric_of
from fit.export.kinds import EXPORT_KINDS
from formats.archive import write_take
from formats.results import save_fit_result
from tests.fit.export.exported import a_fit, text_of
from tests.fit.here import hangtime_here
from tests.fit.scenes import hung, sheet, swing, take_of

NOTES = [
    "Warning: the fit hardly beats a trivial predictor: 8.0 mm, a rigid sheet 8.2 mm. Its parameters tell little.",
    "At its bound: bending_stiffness. Its range stopped the fit there.",
    "Warning: the take swing-01 is incomplete (60 frames are left; missing: 2.0 to 4.0 s).",
]
NOT_IDENTIFIED = (
    "Warning: the takes do not identify shear and velocity damping. Other values within the intervals follow them as "
    "well."
)
KINDS = ["csv", "parquet", "table", "usd-physics", "newton", "mujoco", "u3m", "blender"]
LIBRARIES = {"parquet": "pyarrow", "usd-physics": "pxr", "usd": "pxr"}


def doubtful():
    return msgspec.structs.replace(a_fit(unknown=("shear_stiffness", "velocity_damping")), notes=["A remark.", *NOTES])


def exported(folder, kind, result, *more):
    if kind in LIBRARIES:
        pytest.importorskip(LIBRARIES[kind], reason="a library of the export is not installed")
    save_fit_result(folder / "fit.json", result)
    name = f"out{EXPORT_KINDS[kind].suffix}"
    return hangtime_here("export", ".", "--to", kind, "--out", name, *more, folder=folder)


@pytest.mark.parametrize("kind", KINDS)
def test_every_export_prints_each_doubt_of_a_fit_on_a_line_and_a_sure_fit_prints_none(tmp_path, kind):
    done = exported(tmp_path, kind, doubtful())
    name = f"out{EXPORT_KINDS[kind].suffix}"
    assert (done.returncode, done.stdout, done.stderr.splitlines()) == (0, f"{name}\n", [*NOTES, NOT_IDENTIFIED])
    sure = exported(tmp_path, kind, a_fit(), "--overwrite")
    assert (sure.returncode, sure.stderr) == (0, "")


@pytest.mark.parametrize("kind", ["usd", "gltf", "pc2"])
def test_an_export_of_a_motion_prints_the_doubts_too(tmp_path, kind):
    time = np.arange(0, 0.8, 1 / 30)
    write_take(tmp_path / "swing.mcap", take_of(sheet(), time, swing(time), hung(sheet(), time)))
    done = exported(tmp_path, kind, doubtful(), "--take", "swing.mcap", "--spacing", "0.1")
    assert done.returncode == 0
    assert [line for line in done.stderr.splitlines() if "%" not in line] == [*NOTES, NOT_IDENTIFIED]


@pytest.mark.parametrize("kind", ["table", "usd-physics", "newton", "mujoco", "u3m", "blender"])
def test_the_file_itself_names_each_number_that_is_not_identified_with_its_interval_alone(kind):
    text = " ".join(text_of(kind, doubtful()).replace("- ", "").replace("\n#", "\n").split())
    for note in NOTES:
        assert note in text
    said = "shear: 90 % interval 24 to 37.5 N/m; the takes do not identify it: the whole interval stays possible."
    assert said in text


def test_a_film_of_a_doubtful_fit_prints_the_doubts(tmp_path):
    save_fit_result(tmp_path / "fit.json", doubtful())
    words = ("--motion", "twist", "--seconds", "2", "--spacing", "0.1", "--out", "a.glb")
    done = hangtime_here("animate", ".", *words, folder=tmp_path)
    assert done.returncode == 0
    assert [line for line in done.stderr.splitlines() if "%" not in line] == [*NOTES, NOT_IDENTIFIED]


def test_json_holds_the_doubts_beside_the_files(tmp_path):
    found = json.loads(exported(tmp_path, "csv", doubtful(), "--json").stdout)
    assert found == {"remarks": [*NOTES, NOT_IDENTIFIED], "files": [{"file": "out.csv"}]}


def test_a_table_on_the_terminal_tells_its_doubts_once(tmp_path):
    save_fit_result(tmp_path / "fit.json", doubtful())
    done = hangtime_here("export", ".", "--to", "table", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Its parameters tell little" in " ".join(done.stdout.split())


def test_a_fit_without_intervals_says_that_nothing_tells_how_sure_its_numbers_are():
    given = a_fit()
    given = msgspec.structs.replace(
        given, parameters=[msgspec.structs.replace(p, is_identified=None) for p in given.parameters]
    )
    (line,) = doubts(given, fabric_of(given))
    assert line.startswith("Warning: nothing tells how sure stretch warp, stretch weft, shear, bending warp")
    assert line.endswith("velocity damping may be. The fit computed no interval.")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--to newton --take a.mcap", "--take: newton holds the fabric alone, and no garment"),
        ("--to table --take a.mcap", "--take: table holds the fabric alone, and no garment"),
        ("--to csv --spacing 0.02", "--spacing: csv holds no mesh here"),
        ("--to csv --out x.cvs", "x.cvs: --to csv writes no .cvs, and programs go by the end of the name; did you mean "
         "x.csv?"),
        ("--to parquet --out x.parqet", "and programs go by the end of the name; did you mean x.parquet?"),
        ("--to csv --out x.parqet", "x.parqet: --to csv writes no .parqet, and programs go by the end of the name; "
         "give a name that ends in .csv"),
        ("--to gltf --take a.mcap --out x.gbl", "did you mean x.glb?"),
    ],
)  # fmt: skip
def test_a_wrong_order_is_refused_before_any_doubt_is_told(tmp_path, words, said):
    """A fit of unidentified numbers has doubts."""
    save_fit_result(tmp_path / "fit.json", a_fit(unknown=("bending_stiffness",)))
    time = np.arange(0, 0.8, 1 / 30)
    write_take(tmp_path / "a.mcap", take_of(sheet(), time, swing(time), hung(sheet(), time)))
    done = hangtime_here("export", ".", *words.split(), folder=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("name", ["x", "x.CSV", "x.txt"])
def test_a_name_without_an_ending_or_with_a_usual_one_is_kept(tmp_path, name):
    save_fit_result(tmp_path / "fit.json", a_fit())
    assert hangtime_here("export", ".", "--to", "csv", "--out", name, folder=tmp_path).returncode == 0
    assert (tmp_path / name).exists()
