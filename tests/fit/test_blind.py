"""The blind check: its generator against closed forms, its seal, its score, and that nothing leaks."""

from __future__ import annotations

import ast
import dataclasses
from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy.optimize import curve_fit

import fit
from fit.blind import sealing
from fit.blind.cases import Label, draw_description, draw_label, make_takes
from fit.blind.collection import case_ids, draw_labels, make, open_labels
from fit.blind.engine import SAMPLES, Drive, Plan, simulate
from fit.blind.page import baselines_of, write_page
from fit.blind.plants import PLANTS, STRANGERS
from fit.blind.scoring import Answer, Rate, score
from fit.blind.sheet import build_sheet
from fit.effects import LIBRARY
from fit.errors import FitError
from tests.fit import report_scene

GRAVITY = 9.80665
PACKAGE = Path(fit.__file__).parent
GENERATOR = ("sheet", "swing", "engine", "motions", "plants", "cases")
TOOL = ("fit.cloth", "fit.effects", "fit.gap", "fit.recording", "fit.search", "fit.calibration",
        "fit.parameterisations", "fit.objective")  # fmt: skip


def imports_of(path):
    """Every module that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
    return found


@pytest.mark.parametrize("name", GENERATOR)
def test_the_generator_imports_nothing_of_the_tool(name):
    taken = imports_of(PACKAGE / "blind" / f"{name}.py")
    assert not {t for t in taken if t.startswith(TOOL)}


def test_the_tool_imports_nothing_of_the_generator():
    for path in PACKAGE.rglob("*.py"):
        if "blind" not in path.parts and path.name != "cli.py":
            assert not {t for t in imports_of(path) if t.startswith("fit.blind")}, path


def a_sheet(width=0.4, height=0.45, spacing=0.04):
    return build_sheet(width, height, spacing, np.random.default_rng(0))


def a_plan(**changes):
    plan = Plan(warp=300.0, weft=300.0, shear=30.0, poisson=0.0, bending=(1.4e-5, 1.4e-5), density=0.2, damping=0.0)
    return dataclasses.replace(plan, **changes)


def a_drive(sheet, seconds, displacement=lambda t: np.zeros((len(t), 3)), rate=30.0):
    t = np.arange(0, seconds + 0.1, 1 / SAMPLES)
    x = sheet.rest[sheet.top, 0]
    top = np.stack([x, 0 * x, 0 * x], 1)
    return Drive(top[None] + displacement(t)[:, None], np.arange(0, seconds, 1 / rate))


def nudge(t):
    fade = np.clip((t - 0.2) / 0.6, 0, 1) * (1 - np.clip((t - 1.8) / 0.4, 0, 1))
    return np.stack([0 * t, 0.008 * np.sin(2 * np.pi * 0.9 * t) * fade, 0 * t], 1)


def test_the_generators_sheet_swings_at_the_frequency_of_a_hanging_chain():
    """1.2024 sqrt(g / 0.45 m) / 2 pi = 0.893 Hz."""
    sheet = a_sheet()
    seen = simulate(sheet, a_plan(damping=0.05), [a_drive(sheet, 7.0, nudge)], np.array([[0.0, -0.45]]))[0]
    time = np.arange(len(seen)) / 30
    late = time > 2.5

    def wave(t, a, b, omega, decay):
        return np.exp(-decay * t) * (a * np.cos(omega * t) + b * np.sin(omega * t))

    found, _ = curve_fit(wave, time[late], seen[late, 0, 1], p0=[0.02, 0.0, 5.6, 0.05])
    assert found[2] / (2 * np.pi) == pytest.approx(1.2024 * np.sqrt(GRAVITY / 0.45) / (2 * np.pi), rel=0.01)
    # Nothing drives it any more: it must not gain.
    assert found[3] > 0


def test_the_generators_sheet_stretches_by_half_its_weight_over_its_stiffness():
    """rho g L^2 / (2 k) = 1.99 mm for 100 N/m without Poisson's ratio."""
    sheet = a_sheet()
    seen = simulate(sheet, a_plan(warp=100.0, damping=5.0), [a_drive(sheet, 1.5)], np.array([[0.0, -0.45]]))[0]
    assert -seen[-1, 0, 2] - 0.45 == pytest.approx(0.2 * GRAVITY * 0.45**2 / 200, rel=0.04)


def test_the_generators_hinges_measure_curvature():
    """A roll of radius 0.5 m: 1/2 B / R^2 = 2 B per area, by construction averaged over both axes."""
    sheet = a_sheet()
    energies = []
    for axis in (0, 1):
        lift = 0.5 * sheet.rest[:, axis] ** 2 / 0.5
        energies.append(0.5 * ((sheet.hinge_weights * lift[sheet.hinges]).sum(1) ** 2).sum() / (0.4 * 0.45))
    assert np.mean(energies) == pytest.approx(2.0)
    assert energies[0] == pytest.approx(energies[1], rel=0.25)


def test_points_that_come_late_are_those_of_an_earlier_instant():
    """A planted delay of 20 ms at 50 frames a second moves every frame by exactly one."""
    about = dataclasses.replace(
        draw_description(np.random.default_rng(4)), rate=50.0, seconds=1.6, noise=1e-7, dropout=0.0, layout="5"
    )
    label = Label("single", ("time_offset",), (0.02,))
    plain, late = (make_takes("x", about, chosen)[0][0].points for chosen in (Label("null"), label))
    shifted = min(np.abs(late[5:-5] - plain[5 + k : len(plain) - 5 + k]).max() for k in (-1, 1))
    assert shifted < 2e-5
    assert np.abs(late - plain).max() > 1e-3


def test_metadata_does_not_tell_the_label():
    """Nearest class mean of what is public, leave one out, names nulls among 300 descriptions no better than chance."""
    rng = np.random.default_rng(11)
    labels = draw_labels(150, 150, 0, 0, rng)
    public = np.random.default_rng([11, 1])
    rows = []
    for _ in labels:
        d = draw_description(public)
        rows.append(
            [d.width, d.height, np.log(d.density), len(d.layout), d.seconds, d.rate, np.log(d.noise), d.dropout]
        )
    data = np.array(rows)
    data = (data - data.mean(0)) / data.std(0)
    is_null = np.array([label.kind == "null" for label in labels])
    hits = 0
    for k in range(len(data)):
        others = np.arange(len(data)) != k
        means = [data[others & (is_null == kind)].mean(0) for kind in (False, True)]
        hits += int((np.linalg.norm(data[k] - means[1]) < np.linalg.norm(data[k] - means[0])) == is_null[k])
    # Chance is 150 of 300, standard deviation 8.7.
    assert hits < 150 + 3 * 8.7


def test_every_effect_of_the_generator_can_be_planted():
    rng = np.random.default_rng(0)
    assert set(PLANTS) <= {e.name for e in LIBRARY}
    assert not set(STRANGERS) & {e.name for e in LIBRARY}
    about = dataclasses.replace(
        draw_description(np.random.default_rng(4)), rate=30.0, seconds=1.0, noise=1e-7, dropout=0.0, layout="8x8"
    )
    plain = make_takes("x", about, Label("null"))
    for name in ("hem", "hanger_rotation", "magnet", "tracker_smoothing", "depth_scale"):
        planted = make_takes("x", about, draw_label("single", name, rng))
        apart = max(np.abs(a.points - b.points).max() for a, b in zip(plain[0], planted[0], strict=True))
        assert np.isfinite(apart), name
        assert apart > 1e-4, name


def test_a_seal_opens_with_its_key_only(tmp_path):
    key = sealing.new_key()
    sealed = sealing.seal(b"air_drag", key)
    assert b"air_drag" not in sealed
    assert sealing.unseal(sealed, key, tmp_path) == b"air_drag"
    for wrong in (sealing.new_key(), b"short"):
        with pytest.raises(FitError, match="do not match their key"):
            sealing.unseal(sealed, wrong, tmp_path)
    with pytest.raises(FitError, match="do not match their key"):
        sealing.unseal(sealed[:-1] + bytes([sealed[-1] ^ 1]), key, tmp_path)


def test_a_collection_is_made_once_and_noticed_when_changed(tmp_path):
    labels = [Label("single", ("time_offset",), (0.02,))]
    make(tmp_path, labels, 3, lambda *_: None)
    first = (tmp_path / "manifest.json").read_text()
    make(tmp_path, labels, 3, lambda *_: None)
    assert (tmp_path / "manifest.json").read_text() == first
    case = case_ids(tmp_path)[0]
    assert open_labels(tmp_path)[case] == labels[0]
    assert "time_offset" not in first
    with pytest.raises(FitError, match="another collection"):
        make(tmp_path, labels, 4, lambda *_: None)
    (tmp_path / "cases" / case / "take-1.mcap").write_bytes(b"changed")
    with pytest.raises(FitError, match="is not the file that was made"):
        case_ids(tmp_path)


def test_wilsons_interval_by_hand():
    """8 of 10: 0.490 to 0.943 (Wilson 1927; Newcombe 1998, table I gives 0.4902 and 0.9433)."""
    assert Rate(8, 10).interval == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert Rate(0, 0).interval == (0.0, 1.0)


def an_answer(case, label, verdict, named):
    scene = report_scene.diagnosis()
    first = changed(scene.effects[0], id="air_drag", amplitude=1.2, minimum_detectable=0.4, probability=0.9)
    second = changed(scene.effects[1], id="hem", amplitude=0.01, minimum_detectable=0.004, probability=0.1)
    return Answer(case, label, changed(scene, verdict=verdict, named=named, effects=[first, second]))


def changed(record, **changes):
    return msgspec.structs.replace(record, **changes)


def test_rates_count_what_they_say():
    drag, nothing = Label("single", ("air_drag",), (1.2,)), Label("null")
    answers = [
        an_answer("a", drag, "effect", ["air_drag"]),
        an_answer("b", drag, "effect", ["hem"]),
        an_answer("c", drag, "ambiguous", ["hem", "air_drag"]),
        an_answer("d", nothing, "none", []),
        an_answer("e", nothing, "effect", ["hem"]),
        an_answer("f", Label("stranger", ("magnet",), (5.0,)), "unknown", []),
        an_answer("g", Label("pair", ("air_drag", "hem"), (1.2, 0.01)), "several", ["air_drag", "hem"]),
        Answer("h", drag, None),
    ]
    found = score(answers)
    rates = {name.strip(): (rate.hits, rate.total) for name, rate in found.rates.items()}
    assert rates["false alarms on nulls (an effect named)"] == (1, 2)
    assert rates["single effects: right one or its group named"] == (2, 4)
    assert rates["named right, 2 to 4 times detectable"] == (2, 3)
    assert rates["unknown where no library has it"] == (1, 1)
    assert rates["pairs: both named"] == (1, 1)
    # Named with 0.9 (drag) or 0.1 (hem): of the five named ones `e`'s and `b`'s hem is not confident.
    assert rates["confident (0.8 and above) and wrong"] == (0, 5)
    assert found.confusion["air_drag", "hem"] == 2
    page = write_page(found, answers, baselines_of(answers), {"labels_sha256": "0" * 64})
    assert page.startswith("<!doctype html>")
    assert "false alarms on nulls" in page
