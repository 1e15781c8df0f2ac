"""`hangtime fit` and `hangtime diagnose` from a user's view."""

from __future__ import annotations

import dataclasses
import json
import re
import shlex
import subprocess
import sys

import msgspec
import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.effects import LIBRARY, find_effects
from fit.errors import INCONCLUSIVE, FitError
from fit.folders import alone
from fit.gap.diagnosis import diagnose
from fit.identification.calibrate import calibrate
from fit.identification.request import Request, request_of
from fit.methods import KINECT_SKIRT, LEAN, SI
from fit.report import gather as reporting
from fit.virtual_tests.sheet import sheet_of
from formats.archive import read_take, write_take
from formats.results import load_diagnosis, load_fit_result, save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.recordings.test_geometry import scaled
from tests.fit.scenes import hung, material, shared, sheet, simulate_take, swing, take_of

FRAME = 1 / 30


def real_hangtime(*words, folder):
    return subprocess.run(
        [sys.executable, "-m", "formats.command", *map(str, words)], capture_output=True, text=True, cwd=folder
    )


@shared
def a_swung_take(name="a", damping=3.0, hz=0.7, seconds=4.0):
    time = np.arange(0, seconds, FRAME)
    garment = sheet()
    row = material(garment, velocity_damping=damping)
    return simulate_take(garment, time, swing(time, amplitude=0.06, hz=hz), row, noise=0.002, seed=5, name=name)


@pytest.fixture(scope="module")
def swung():
    return a_swung_take()


@pytest.mark.slow
def test_bad_input_ends_the_real_command_like_that_too(tmp_path):
    done = real_hangtime("fit", "gone.mcap", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "hangtime: gone.mcap: cannot be read (No such file or directory); check the path\n"


def test_a_fit_lowers_the_error_and_says_so(tmp_path):
    """Linear damping of 3 /s against the 1.5 /s of the initial vector: forty iterations find most of it."""
    take = write_take(tmp_path / "a.mcap", a_swung_take())
    other = write_take(tmp_path / "b.mcap", a_swung_take("b", hz=0.9))
    done = hangtime_here(
        "fit", take, "--held-out", other, "--method", "kinect-skirt", "--iterations", 40, "--spacing", 0.1,
        "--out", "out", folder=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = load_fit_result(tmp_path / "out" / "fit.json")
    assert result.error.train_after.mean_m < 0.8 * result.error.train_before.mean_m
    assert result.error.held_out_after is not None
    assert result.error.held_out_before is not None
    assert result.error.held_out_after.mean_m < result.error.held_out_before.mean_m
    assert result.history == sorted(result.history, reverse=True)
    assert not (tmp_path / "out" / "fit.partial.json").exists()
    assert "mean distance of all points" in done.stdout
    assert "all frames, held out" in done.stdout
    assert re.search(r"^annealing: \d+ %, [\d.]+ mm mean distance on fitted takes, \d+/40", done.stderr, re.MULTILINE)
    assert (tmp_path / "out" / "report.html").read_text().startswith("<!doctype html>")


def test_a_search_stays_within_narrower_bounds():
    """The initial 0.95 lies outside 0.96 to 0.98 and is moved to the nearer bound."""
    request = request_of(KINECT_SKIRT, [], iterations=12, seed=3, spacing=0.1, bounds=["velocity=0.96:0.98"])
    velocity = next(p for p in calibrate([a_swung_take()], [], request).parameters if p.name == "velocity")
    assert velocity.initial == 0.96
    assert 0.96 <= velocity.fitted <= 0.98
    assert (velocity.minimum, velocity.maximum) == (0.96, 0.98)


def test_a_saved_search_of_other_takes_is_refused(tmp_path):
    take = a_swung_take()
    (tmp_path / "c.json").write_text(json.dumps({"key": {"takes": ["x"]}, "search": {}}))
    with pytest.raises(FitError, match="other takes or options"):
        calibrate([take], [], Request(method=SI), checkpoint=tmp_path / "c.json")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("fit", "gone.mcap"), "gone.mcap: cannot be read"),
        (("diagnose", "gone.mcap"), "gone.mcap: cannot be read"),
        (("fit", "a.mcap", "--method", "guess"), "there is no method named 'guess'"),
        (("fit", "a.mcap", "--effect", "gremlins"), "there is no effect named 'gremlins'"),
        (("fit", "a.mcap", "--spacing", "3"), "mesh spacing 3.0 m does not fit"),
        (("fit", "a.mcap", "--spacing", "1e-6"), "choose a spacing from 0.0022 m to half of its smaller side"),
        (
            ("diagnose", "a.mcap", "--spacing", "50"),
            "half of its smaller side; the spacing is in metres: 0.05 for 50 millimetres\n",
        ),
        (("fit", "a.mcap", "--spacing", "0.001"), " nodes where 40000 are the most; choose a spacing from"),
        (("diagnose", "a.mcap", "--spacing", "-1"), "--spacing: the mesh spacing is -1 m; give metres"),
        (("fit", "a.mcap", "--bounds", "velocity_damping=4:3"), "the lower bound of velocity_damping, 4, is not below"),
        (
            ("fit", "a.mcap", "--bounds", "velocity_damping=nan:3"),
            "'velocity_damping=nan:3' has a bound that is no number",
        ),
        (("fit", "a.mcap", "--bounds", "bent=3:20"), "there is no parameter named 'bent'"),
        (("fit", "a.mcap", "--bounds", "shear_stiffness=30"), "'shear_stiffness=30' is not NAME=LOW:HIGH"),
        (("fit", "a.mcap", "--bounds", "velocity_damping=3:900"), "3 to 900 leaves the range of velocity_damping"),
        (
            ("fit", "a.mcap", "--bounds", "velocity_damping=3:4", "--bounds", "velocity_damping=3:5"),
            "velocity_damping is given twice",
        ),
        (("fit", "a.mcap", "--method", "mocap-swatch", "--search", "tempering"), "tempering draws by how likely"),
        (("diagnose", "a.mcap", "--fit", "gone.json"), "gone.json: cannot be read"),
        (("diagnose", "a.mcap", "--held-out-motion", "twist"), "no take moves 'twist'"),
        (("fit", "a.mcap", "--held-out-motion", "wobble"), "there is no kind of motion named 'wobble'"),
        (("fit", "a.mcap", "--held-out", "a.mcap"), "this take is both fitted to and held out"),
        (("diagnose", "a.mcap", "a.mcap"), "this take is given twice"),
        (("fit", "a.mcap", "--method", "si", "--effect", "shear_stiffness"), "has shear_stiffness as a parameter"),
        (("fit", "a.mcap", "--effect", "air_drag", "--effect", "air_drag"), "air_drag is named twice"),
        (("fit", "a.mcap", "--gamma", "nan"), "gamma is nan; give a number above 0"),
        (("fit", "a.mcap", "--gamma", "-1"), "gamma is -1"),
        (  # told, and refused for the take alone
            ("fit", "a.mcap", "--held-out", "a.mcap", "--iterations", "1"),
            "--iterations changes nothing here: least-squares has no number of iterations.\n",
        ),
        (("fit", "a.mcap", "--seed", "-1"), "-1 is outside the range: the value must be at least 0"),
        (("diagnose", "a.mcap", "--seed", "-1"), "-1 is outside the range: the value must be at least 0"),
        (("diagnose", "a.mcap", "--without", "gremlins"), "there is no effect named 'gremlins'"),
        (("diagnose", "a.mcap", "--without", "hem", "--add", "hem"), "hem is to be added and left out"),
        (("batch", ".", "--seed", "-1"), "-1 is outside the range: the value must be at least 0"),
        (("fit", "a.mcap", "--out", "a.mcap"), "a.mcap: cannot be made or written to (File exists)"),
        (("diagnose", "a.mcap", "--out", "a.mcap/b"), "a.mcap/b: cannot be made or written to"),
        (("blind", "make", "a.mcap", "--nulls", "1"), "a.mcap: cannot be made or written to"),
    ],
)
def test_bad_input_gives_one_sentence_and_exit_code_2(tmp_path, swung, words, sentence):
    write_take(tmp_path / "a.mcap", swung)
    done = hangtime_here(*words, folder=tmp_path)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr


def test_a_folder_where_a_result_should_be_is_refused_before_the_search(tmp_path):
    write_take(tmp_path / "a.mcap", a_swung_take())
    (tmp_path / "fitted" / "fit.json").mkdir(parents=True)
    done = hangtime_here("fit", "a.mcap", folder=tmp_path)
    assert done.returncode == 2
    assert "fitted/fit.json: is a folder" in done.stderr


@pytest.fixture(scope="module")
def two_takes():
    return [a_swung_take(), a_swung_take("b", hz=0.9)]


@pytest.fixture(scope="module")
def ours(two_takes):
    found = calibrate(two_takes[:1], [], request_of(KINECT_SKIRT, ["air_drag"], iterations=2, seed=1, spacing=0.15))
    return msgspec.structs.replace(found, effects={}, parameters=found.parameters[:6])


@pytest.fixture
def theirs(ours):
    return msgspec.structs.replace(ours, engine="blender", material={}, combinations=[])


def test_a_fit_of_blenders_cloth_is_no_fabric():
    ours = a_fit("kinect-skirt")
    assert ours.engine == "own"
    assert "G, shear" in sheet_of(ours)
    with pytest.raises(FitError, match="its cloth is blender's"):
        sheet_of(msgspec.structs.replace(ours, engine="blender", material={}))
    with pytest.raises(FitError, match="does not hold its material"):
        sheet_of(msgspec.structs.replace(ours, material={"areal_density": 0.1}))


@pytest.mark.slow
def test_a_fit_of_blenders_cloth_moves_none_of_ours(two_takes, ours, theirs, tmp_path, monkeypatch):
    with_effect = msgspec.structs.replace(ours, effects={"hem": 0.02})
    coarse = Resolution(spacing=0.15)
    findings = diagnose(two_takes[:1], two_takes[1:], effects=find_effects(["hem"]), resolution=coarse)
    shown = []
    monkeypatch.setattr(reporting, "write_report", lambda path, *, motions, **_: shown.append(motions[0]))
    for fit in (ours, theirs, None, with_effect):
        reporting.write_diagnosis_report(tmp_path / "r.html", findings, fit)
    assert [motion.shown for motion in shown] == [("base", "fit"), ("base",), ("base",), ("base", "fit")]
    moved = [motion.runs["fit"].points for motion in (shown[0], shown[3])]
    assert not np.array_equal(*moved)  # the fit moves with the effect that it has


def test_a_fit_is_tested_as_a_fabric_and_warns_of_intervals_that_are_too_short(tmp_path):
    write_take(tmp_path / "a.mcap", a_swung_take())
    words = ["a.mcap", "--spacing", 0.15]
    fitted = hangtime_here("fit", *words, "--search", "annealing", "--iterations", 2, folder=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
    assert "Fitting to a; judging on the same, as none is held out." in fitted.stderr
    assert "its 90 % intervals are too short" in fitted.stdout
    assert "minimised" not in fitted.stdout
    assert "90 % interval, if the model holds" in fitted.stdout
    assert "neither missing physics nor the mesh's error" in fitted.stdout
    following = "hangtime diagnose a.mcap --spacing 0.15 --out fitted"
    assert fitted.stdout.endswith(f"Next: `{following}` looks for missing physics.\n")
    sheet_in_words = hangtime_here("fabric", "fitted/fit.json", folder=tmp_path)
    assert sheet_in_words.returncode == 0, sheet_in_words.stderr
    stiffness = load_fit_result(tmp_path / "fitted/fit.json").material["bending_stiffness"]
    assert stiffness > 0
    assert "B " in sheet_in_words.stdout  # bending rigidity, as KES calls it
    with alone(tmp_path / "fitted"):
        second = hangtime_here("fit", *words, folder=tmp_path)
    assert second.returncode == 2
    assert "another command writes here" in second.stderr


def test_a_diagnosis_says_before_it_simulates_that_the_takes_are_too_short(tmp_path, monkeypatch):
    """Two seconds of the 2.5 that are needed; it is interrupted where the simulations would begin."""
    write_take(tmp_path / "a.mcap", a_swung_take(seconds=2.05))

    def interrupted(*_takes, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr("fit.gap.diagnosis.diagnose", interrupted)
    done = hangtime_here("diagnose", "a.mcap", folder=tmp_path)
    assert done.returncode == 130
    assert "No effect will be named: the shortest take lasts 2.0 s; at least 2.5 s are needed. Record longer." in (
        done.stderr
    )


def test_takes_that_cannot_decide_end_with_a_code_of_their_own_and_with_a_report(tmp_path):
    """Two seconds of the 2.5 that are needed, with one effect in the library."""
    pytest.importorskip("PIL")
    from PIL import Image

    write_take(tmp_path / "a.mcap", a_swung_take(seconds=2.0))
    without = [word for e in LIBRARY if e.name != "hem" for word in ("--without", e.name)]
    words = ["diagnose", "a.mcap", "--model", "lean", "--spacing", 0.2, "--plot", "e.png", "--json", *without]
    done = hangtime_here(*words, "--arrows", "left.png", folder=tmp_path)
    assert done.returncode == INCONCLUSIVE == 4
    told = json.loads(done.stdout)
    assert told["diagnosis"]["verdict"] == "inconclusive"
    assert (tmp_path / told["report"]).exists()
    assert (told["plot"], told["arrows"]) == ("e.png", "left.png")
    assert (tmp_path / told["plot"]).read_bytes().startswith(b"\x89PNG")
    with Image.open(tmp_path / told["arrows"]) as left:
        assert len(left.convert("RGB").getcolors(1 << 20)) > 3  # paper, and ink of simulated, tracked and missed
    page = (tmp_path / told["report"]).read_text()
    assert "hangtime diagnose a.mcap --model lean" in page  # the origin


@pytest.mark.slow
def test_a_diagnosis_says_what_it_found_and_leaves_its_report(tmp_path):
    """With the lean model, whose shear is in the library, a hem added by hand, and a fit of the same takes."""
    write_take(tmp_path / "a.mcap", a_swung_take())
    write_take(tmp_path / "b.mcap", a_swung_take("b", hz=0.9))
    fitted = calibrate([read_take(tmp_path / "a.mcap")], [], request_of(SI, [], iterations=2, seed=1, spacing=0.15))
    save_fit_result(tmp_path / "out/fit.json", fitted)
    words = ["diagnose", "a.mcap", "--held-out", "b.mcap", "--out", "out", "--spacing", 0.15, "--seed", 3]
    words += ["--without", "air_drag", "--without", "draught"]
    done = hangtime_here(*words, "--model", "lean", "--add", "hem", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Fitting to a; judging on b." in done.stderr
    found = load_diagnosis(tmp_path / "out/diagnosis.json")
    assert f"Verdict: {found.verdict}\n{found.sentence}\n" in done.stdout
    assert (found.take_ids, found.held_out_ids) == (["a"], ["b"])
    assert {p.name for p in found.base_parameters} == {p.name for p in LEAN.parameters}
    hem = next(f for f in found.effects if f.id == "hem")
    assert hem.amplitude_interval is not None  # refitted, though there is no gap to close
    assert next(f for f in found.effects if f.id == "shear_stiffness").tested
    assert {f.id for f in found.effects} == {e.name for e in LIBRARY} - {"air_drag", "draught"}
    assert found.sentence.endswith(" Not looked for, as asked: air drag, a draught.")
    closable = r"With hem \([^)]* kg/m, 90 % interval\): no gap shows that it could close"
    assert re.search(closable, done.stdout), done.stdout
    page = (tmp_path / "out/report.html").read_text()
    assert page.startswith("<!doctype html>")
    assert f"{fitted.simulations} simulations in" in page  # of the fit beside it
    assert not (tmp_path / "out/diagnosis.partial").exists()
    with_drag = msgspec.structs.replace(fitted, effects={"air_drag": 1.0})
    save_fit_result(tmp_path / "drag.json", with_drag)
    kept = hangtime_here(*words, "--fit", "drag.json", folder=tmp_path)
    assert kept.returncode == 2
    assert "--without: the fit keeps air_drag in its model" in kept.stderr
    again = hangtime_here(*words, "--model", "lean", "--add", "nothing_known", folder=tmp_path)
    assert again.returncode == 2
    assert "nothing_known" in again.stderr


def test_a_fit_of_other_takes_is_kept_under_a_number(tmp_path):
    take = a_swung_take()
    request = request_of(KINECT_SKIRT, [], iterations=2, seed=1, spacing=0.15)
    save_fit_result(tmp_path / "out/fit.json", calibrate([take], [], request))
    write_take(tmp_path / "b.mcap", dataclasses.replace(take, take_id="b"))
    done = hangtime_here(
        "fit",
        "b.mcap",
        "--out",
        "out",
        "--method",
        "kinect-skirt",
        "--iterations",
        1,
        "--spacing",
        0.15,
        folder=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "is of other takes (a): kept as fit.1.json" in done.stderr
    assert load_fit_result(tmp_path / "out/fit.json").take_ids == ["b"]
    assert load_fit_result(tmp_path / "out/fit.1.json").take_ids == ["a"]


def test_a_second_diagnosis_in_a_folder_and_impossible_takes_are_refused_before_the_work(tmp_path):
    time = np.arange(60) / 30
    flat, path = sheet(), swing(time)
    take = take_of(flat, time, path, hung(flat, time) + path[:, None])
    write_take(tmp_path / "a.mcap", take)
    with alone(tmp_path):
        second = hangtime_here("diagnose", "a.mcap", "--out", ".", folder=tmp_path)
    heavy = msgspec.structs.replace(scaled(flat, 6.0), mass_kg=1.3)
    write_take(tmp_path / "b.mcap", dataclasses.replace(take, garment=heavy))
    impossible = hangtime_here("diagnose", "b.mcap", folder=tmp_path)
    assert (second.returncode, impossible.returncode) == (2, 2)
    assert "another command writes here" in second.stderr
    assert "the garment's held edge is 2400 mm long" in impossible.stderr
    assert not (tmp_path / "diagnosis").exists()


@pytest.mark.slow  # `tests/formats/test_endings.py` has every command that nobody reads
@pytest.mark.parametrize(
    ("where", "code"),
    [
        ("2>&-", 0),
        ("2>/dev/full", 0),
        ("2>&1 | true", 141),
        (">/dev/full", 2),
    ],
)
def test_a_fit_whose_output_nobody_reads_is_still_finished(tmp_path, where, code):
    write_take(tmp_path / "a.mcap", a_swung_take())
    words = [
        sys.executable,
        "-m",
        "formats.command",
        "fit",
        "a.mcap",
        "--search",
        "annealing",
        "--iterations",
        "2",
        "--spacing",
        "0.15",
    ]
    done = subprocess.run(
        ["bash", "-c", f"{shlex.join(words)} {where}; exit ${{PIPESTATUS[0]}}"], capture_output=True, text=True,
        cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert load_fit_result(tmp_path / "fitted/fit.json").take_ids == ["a"]


def interrupted_after(path):
    if path:
        path.write_text("{}")
    raise KeyboardInterrupt


def test_work_that_ends_before_it_wrote_anything_leaves_no_empty_folder(tmp_path):
    empty, used = tmp_path / "empty", tmp_path / "used"
    for folder in (empty, used):
        folder.mkdir()
        with pytest.raises(KeyboardInterrupt), alone(folder):
            interrupted_after(folder / "fit.partial.json" if folder == used else None)
    assert not empty.exists()
    assert (used / "fit.partial.json").exists()
