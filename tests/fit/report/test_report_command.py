"""`hangtime report` rebuilds a page without a simulation; `hangtime compare` compares results."""

from __future__ import annotations

import json
import os
import re
import zipfile

import msgspec
import numpy as np
import pytest

from fit.report.answer import run_names
from fit.report.kept import load_motions, save_motions
from fit.report.methods import method_figures
from fit.report.origin import Origin
from fit.report.page import write_report
from fit.report.plot import COLOURS, draw_plot
from formats.archive import write_take
from formats.fit_records import Combination
from formats.results import save_diagnosis, save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result, motion
from tests.fit.scenes import hung, sheet, swing, take_of

ORIGIN = Origin(facts=[("Hangtime", "0.1.0")], takes=[("swing-01", "fitted to", "beef")])


@pytest.fixture
def folder(tmp_path):
    """A folder as `fit` and then `diagnose` leave it."""
    out = tmp_path / "out"
    out.mkdir()
    save_fit_result(out / "fit.json", fit_result())
    save_diagnosis(out / "diagnosis.json", diagnosis())
    page, motions = out / "report.html", [motion("swing-02", is_held_out=True), motion()]
    save_motions(page, motions, ORIGIN, diagnosis().created)
    kept, origin = load_motions(page, diagnosis().created)
    write_report(page, fit=fit_result(), diagnosis=diagnosis(), motions=kept, origin=origin)
    return out


def test_a_report_made_again_is_the_same_page(folder, tmp_path):
    before = (folder / "report.html").read_bytes()
    (folder / "report.html").unlink()
    done = hangtime_here("report", "out", folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "Report: out/report.html\n")
    assert (folder / "report.html").read_bytes() == before
    assert b"beef" in before


def words_of(page):
    """The words of a page without script and style."""
    bare = re.sub(r"<(script|style).*?</\1>", "", page, flags=re.S)
    return " ".join(re.sub(r"<[^>]*>", " ", bare).split())


def test_a_folder_without_kept_motion_makes_a_page_that_says_so(folder, tmp_path):
    (folder / "report.motion.npz").unlink()
    done = hangtime_here("report", "out", "--out", "again.html", "--json", folder=tmp_path)
    assert "has no player" in done.stderr
    assert json.loads(done.stdout) == {"report": "again.html", "takes": []}
    assert 'id="player"' not in (tmp_path / "again.html").read_text()
    assert hangtime_here("report", "out", "--out", "again.html", folder=tmp_path).returncode == 2  # it is there


@pytest.mark.parametrize("name", ["fit.json", "diagnosis.json", "report.html", "report.motion.npz", "link.png"])
def test_a_picture_replaces_no_file_of_the_results(folder, tmp_path, name):
    """Not even with --overwrite; a name through a link is the same file."""
    (folder / "link.png").symlink_to("fit.json")
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    done = hangtime_here("report", "out", "--plot", f"out/{name}", "--overwrite", folder=tmp_path)
    assert done.returncode == 2
    assert f"{name}: is a file of the results, and no picture; give another name" in done.stderr
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before


@pytest.mark.parametrize("command", ["fit", "diagnose"])
def test_a_picture_replaces_no_take_that_is_read(tmp_path, command):
    take = write_take(tmp_path / "a.mcap", take_of(sheet(), np.arange(30) / 30, swing(np.arange(30) / 30)))
    before = take.read_bytes()
    for option in ["--plot"] if command == "fit" else ["--plot", "--arrows"]:
        done = hangtime_here(command, "a.mcap", option, "a.mcap", "--overwrite", folder=tmp_path)
        assert done.returncode == 2
        assert "a.mcap: would replace the take that is read; give another name" in done.stderr
        assert take.read_bytes() == before
    if command == "diagnose":
        done = hangtime_here(command, "a.mcap", "--plot", "x.png", "--arrows", "x.png", folder=tmp_path)
        assert (done.returncode, "x.png: is named by two options; give each" in done.stderr) == (2, True)


def a_bomb(file, size):
    """An archive of an array of zeros, a thousandth as large as what it unpacks to."""
    head = b"{'descr': '|u1', 'fortran_order': False, 'shape': (%d,), }" % size
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("head.npy", "w") as part:
        part.write(b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head)
        for _ in range(size >> 20):
            part.write(bytes(1 << 20))


@pytest.mark.parametrize("kind", ["bomb", "pipe", "holes"])
def test_hostile_motion_beside_a_report_is_refused_in_one_sentence(kind, folder, tmp_path):
    """40 MB of zeros in 40 kB, a pipe without a writer, and 300 GB of holes."""
    kept = folder / "report.motion.npz"
    kept.unlink()
    if kind == "bomb":
        a_bomb(kept, 40 << 20)
    elif kind == "pipe":
        os.mkfifo(kept)
    else:
        with kept.open("wb") as file:
            file.truncate(300 << 30)
    done = hangtime_here("report", "out", folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("hangtime: out/report.motion.npz: is no motion of a report; remove it, or ")


def test_a_folder_without_results_is_refused_in_one_sentence(tmp_path):
    done = hangtime_here("report", ".", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("hangtime: .: holds neither fit.json nor diagnosis.json; ")
    assert "is no folder of results" in hangtime_here("report", "gone", folder=tmp_path).stderr


def test_a_fit_of_other_takes_than_the_diagnosis_is_left_out(folder, tmp_path):
    save_fit_result(folder / "fit.json", msgspec.structs.replace(fit_result(), take_ids=["elsewhere"]))
    done = hangtime_here("report", "out", folder=tmp_path)
    assert "out/fit.json is of other takes than the diagnosis (elsewhere; the diagnosis is of " in done.stderr
    assert done.stderr.splitlines()[0].endswith(": the report leaves out fit.json.")
    assert "kinect-skirt" not in words_of((folder / "report.html").read_text())


def test_comparing_folders_says_whose_fit_is_left_out(folder, tmp_path):
    save_fit_result(folder / "fit.json", msgspec.structs.replace(fit_result(), take_ids=["elsewhere"]))
    done = hangtime_here("compare", "out", "out/diagnosis.json", folder=tmp_path)
    assert done.stderr.startswith("out/fit.json is of other takes than the diagnosis")


def test_a_fit_made_after_the_diagnosis_has_its_own_page_again(folder, tmp_path):
    later = msgspec.structs.replace(fit_result(), created="2026-04-01T00:00:00Z", take_ids=["elsewhere"])
    save_fit_result(folder / "fit.json", later)
    save_motions(folder / "report.html", [motion("elsewhere", names=("before", "after"))], ORIGIN, later.created)
    done = hangtime_here("report", "out", "--json", folder=tmp_path)
    assert json.loads(done.stdout)["takes"] == ["elsewhere"]
    assert done.stderr.startswith("out/diagnosis.json is of other takes than the fit (")
    assert "air drag" not in words_of((folder / "report.html").read_text())


def test_a_plot_draws_each_run_in_its_colour_and_nothing_where_no_free_point_is_seen(folder, tmp_path):
    image = pytest.importorskip("PIL.Image")
    done = hangtime_here("report", "out", "--plot", "error.png", folder=tmp_path)
    assert done.returncode == 0
    assert done.stdout.endswith("Picture: error.png\n")
    picture = np.asarray(image.open(tmp_path / "error.png").convert("RGB"))
    assert picture.shape == (680, 1200, 3)  # two takes, a panel each
    blue, red = (tuple(int(COLOURS[run][k : k + 2], 16) for k in (1, 3, 5)) for run in ("base", "fit"))
    assert all((picture == colour).all(axis=2).sum() > 1000 for colour in (blue, red))
    real = motion().real.copy()
    real[60:120, 2:] = np.nan  # the middle third of six seconds
    draw_plot([motion(real=real)], run_names(None, None), tmp_path / "lost.png")
    lost = np.asarray(image.open(tmp_path / "lost.png").convert("RGB"))[80:290]
    drawn = (lost == blue).all(axis=2).any(axis=0)
    assert not drawn[84 + 380 : 84 + 710].any()
    assert drawn[84 : 84 + 360].mean() > 0.9


def test_a_combination_in_the_report_has_a_verdict_and_a_value_only_where_the_takes_identify_it():
    rows = []
    for is_identified, is_at_bound in ((True, False), (False, False), (False, True)):
        one = Combination(
            name="velocity damping", unit="1/s", initial=1.0, fitted=0.625, interval_low=0.5, interval_high=0.75,
            is_identified=is_identified, is_at_bound=is_at_bound,
        )  # fmt: skip
        page = method_figures(msgspec.structs.replace(a_fit(), combinations=[one]))
        text = " ".join(re.sub("<[^>]*>", " ", page[page.index("velocity damping") :]).split())
        rows.append(("0.625" in text, text.rsplit("per s ", 1)[-1]))
    assert rows == [(True, "identified"), (False, "not identified"), (False, "not identified, at its bound")]


def test_a_parameter_that_motion_identifies_as_it_is_stands_once_in_a_comparison(tmp_path):
    """Of `si`, whose two dampings are combinations too; the parameter's interval is the one that is shown."""
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        twin = Combination(
            name="velocity damping", unit="1/s", initial=1.0, fitted=0.5, interval_low=0.0, interval_high=9.0,
            is_identified=True,
        )  # fmt: skip
        save_fit_result(tmp_path / name / "fit.json", msgspec.structs.replace(a_fit(), combinations=[twin]))
    told = hangtime_here("compare", "one", "two", folder=tmp_path).stdout.splitlines()
    (row,) = [line for line in told if line.startswith("velocity damping")]
    assert row.split() == ["velocity", "damping", "[1/s]", *["0.5", "(0.4", "to", "0.625)"] * 2, "yes"]


def test_fits_side_by_side_say_whether_their_intervals_overlap(folder, tmp_path):
    """Struct 49 to 73.4 against 20 to 30 has nothing in common; bend is the same in both."""
    other = tmp_path / "other"
    other.mkdir()
    changed = [
        msgspec.structs.replace(p, fitted=25.0, interval_low=20.0, interval_high=30.0) if p.name == "struct" else p
        for p in fit_result().parameters
    ]
    save_fit_result(other / "fit.json", msgspec.structs.replace(fit_result(), parameters=changed))
    done = hangtime_here("compare", "out", "other", "--out", "both.html", folder=tmp_path)
    assert done.returncode == 0
    rows = {line.split("  ")[0]: line for line in done.stdout.splitlines()}
    assert re.search(r"^ +out +other +intervals overlap$", done.stdout, re.MULTILINE)
    assert re.search(r"61\.2 \(49 to 73\.4\) +25 \(20 to 30\) +no$", rows["struct [Blender]"])
    assert rows["bend [Blender]"].endswith("yes")
    assert "not identified (1.36 to 2.04)" in rows["mass [x weighed]"]
    assert "mean distance of all points, takes fitted to" in rows
    page = (tmp_path / "both.html").read_text()
    assert "2 fits side by side" in page
    assert "25 (20 to 30)" in page
    assert "<script" not in page
    told = json.loads(hangtime_here("compare", "out", "other", "--json", folder=tmp_path).stdout)
    assert [one["file"] for one in told["compared"]] == ["out", "other"]
    assert told["compared"][1]["parameters"][1]["fitted"] == 25.0


def test_a_comparison_shows_mesh_and_seed_and_an_effect_of_one_fit_among_the_parameters(tmp_path):
    """Air drag, which only the second fit has, stands behind the parameter that it follows there."""
    drag = msgspec.structs.replace(a_fit().parameters[0], name="air_drag", unit="1")
    finer = msgspec.structs.replace(
        a_fit(), parameters=[*a_fit().parameters, drag], spacing=0.025, seed=7, combinations=[]
    )
    for name, fit in (("a", msgspec.structs.replace(a_fit(), spacing=0.05, seed=3, combinations=[])), ("b", finer)):
        save_fit_result(tmp_path / f"{name}.json", fit)
    told = hangtime_here("compare", "a.json", "b.json", folder=tmp_path).stdout.splitlines()
    rows = [line.split("  ")[0] for line in told]
    assert next(line.split() for line in told if line.startswith("mesh spacing"))[2:] == ["50", "mm", "25", "mm"]
    assert next(line.split() for line in told if line.startswith("seed"))[1:] == ["3", "7"]
    assert rows.index("air drag") == rows.index("velocity damping [1/s]") + 1


def test_diagnoses_and_takes_stand_side_by_side_too(folder, tmp_path):
    save_diagnosis(tmp_path / "b.json", diagnosis(verdict="none", named=[]))
    shown = hangtime_here("compare", "out/diagnosis.json", "b.json", folder=tmp_path).stdout
    assert re.search(r"^verdict +effect +none$", shown, re.MULTILINE)
    assert re.search(r"^base model, rms +12\.3 mm +12\.3 mm$", shown, re.MULTILINE)
    time, garment = np.arange(0, 3, 1 / 30), sheet()
    for name, high in (("a", 0.05), ("b", 0.1)):
        moved = swing(time, amplitude=high)
        write_take(tmp_path / f"{name}.mcap", take_of(garment, time, moved, hung(garment, time), name=name))
    shown = hangtime_here("compare", "a.mcap", "b.mcap", folder=tmp_path).stdout
    assert re.search(r"^hanger travels +0 x 100 x 0 mm +0 x 200 x 0 mm$", shown, re.MULTILINE)
    mixed = hangtime_here("compare", "a.mcap", "out", folder=tmp_path)
    assert mixed.returncode == 2
    assert "out: is a fit, and a.mcap is a take; compare things of one kind" in mixed.stderr
    assert "name two or more" in hangtime_here("compare", "a.mcap", folder=tmp_path).stderr
