"""An export by call is the command's file, and a diagnosis shows its own numbers as CSV, dictionary and HTML."""

from __future__ import annotations

import csv
import io
import json
import re

import msgspec
import numpy as np
import pytest

import hangtime
from fit.export.kinds import EXPORT_KINDS
from fit.export.tables import parameters_csv
from formats.archive import write_take
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.fit.scenes import hung, sheet, take_of


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a fit and a still take of another garment than the swatch."""
    folder = tmp_path_factory.mktemp("export")
    hangtime.FitOutcome(result=a_fit()).save(folder / "fit.json")
    time, garment = np.arange(0, 1, 1 / 30), sheet()
    write_take(folder / "still.mcap", take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time)))
    return folder


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("usd-physics", {"thickness": 0.0004}),
        ("usd-physics", {"spacing": 0.05}),
        ("usd-physics", {"thickness": 0.002, "take": "still.mcap"}),
        ("mujoco", {"take": "still.mcap", "spacing": 0.1}),
        ("newton", {"spacing": 0.05}),
        ("blender", {"take": "still.mcap"}),
        ("csv", {}),
        ("table", {}),
        ("u3m", {}),
    ],
)
def test_an_export_by_call_is_the_commands_file(folder, tmp_path, kind, options):
    """And each option counts in either: without it the file is another one."""
    if kind == "usd-physics":
        pytest.importorskip("pxr", reason="usd-core is not installed")
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    by_command, by_call, plain = (
        tmp_path / f"{name}/a{EXPORT_KINDS[kind].suffix}" for name in ("command", "call", "plain")
    )
    done = hangtime_here("export", "fit.json", "--to", kind, "--out", by_command, *words, folder=folder)
    assert done.returncode == 0, done.stderr
    given = {name: folder / value if name == "take" else value for name, value in options.items()}
    assert hangtime.export(folder / "fit.json", kind, by_call, **given) == [by_call]
    assert by_call.read_bytes() == by_command.read_bytes()
    if options:
        hangtime.export(hangtime.load(folder / "fit.json"), kind, plain)
        assert plain.read_bytes() != by_call.read_bytes()


def test_an_export_by_call_replaces_a_file_only_where_that_is_asked_for(folder, tmp_path):
    (tmp_path / "a.csv").write_text("mine")
    with pytest.raises(hangtime.HangtimeError, match=r"a\.csv"):
        hangtime.export(folder / "fit.json", "csv", tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text() == "mine"
    hangtime.export(folder / "fit.json", "csv", tmp_path / "a.csv", overwrite=True)
    assert "stretch_stiffness" in (tmp_path / "a.csv").read_text()


ROWS = [
    {"effect": "air_drag", "is_tested": "True", "is_named": "True", "probability": "0.94", "amplitude": "1.31",
     "unit": "1", "closure": "0.87", "p_value": "2e-07", "is_refitted": "True"},
    {"effect": "hem", "is_tested": "True", "is_named": "False", "probability": "0.03", "amplitude": "0.004",
     "unit": "kg/m", "closure": "0.08", "p_value": "0.21", "is_refitted": "True"},
    {"effect": "time_offset", "is_tested": "True", "is_named": "False", "probability": "", "amplitude": "-0.0021",
     "unit": "s", "closure": "0.01", "p_value": "0.64", "is_refitted": "True"},
    {"effect": "clip_slip", "is_tested": "False", "is_named": "False", "probability": "", "amplitude": "",
     "unit": "m", "closure": "", "p_value": "", "is_refitted": "False"},
]  # fmt: skip


def test_a_diagnosis_has_a_row_an_effect_as_csv(tmp_path):
    """Every cell of it: each column holds another number."""
    outcome = hangtime.DiagnosisOutcome(result=diagnosis())
    text = outcome.to_csv(tmp_path / "tables/effects.csv")
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [{name: value.lower() for name, value in row.items()} for row in rows] == [
        {name: value.lower() for name, value in row.items()} for row in ROWS
    ]
    assert (tmp_path / "tables/effects.csv").read_text() == text == outcome.to_csv()


def test_csv_marks_the_sizes_that_no_refit_found():
    """A size of the screening is linearised, and may lie far beyond the range: 2923 for a timing of 1 at most."""
    given = diagnosis()
    screened = msgspec.structs.replace(
        given.effects[1], id="frame_timing", amplitude=-2923.0, amplitude_interval=None, closure=None, p_value=None,
        note="screened only: it explains 1 % of the residual",
    )  # fmt: skip
    at_its_bound = msgspec.structs.replace(screened, id="hem", note="at its bound, so that its size has no interval")
    refitted = msgspec.structs.replace(screened, id="draught", fitted_share=0.02)
    found = diagnosis(effects=[given.effects[0], screened, at_its_bound, refitted])
    rows = csv.DictReader(io.StringIO(hangtime.DiagnosisOutcome(result=found).to_csv()))
    assert {row["effect"]: (row["amplitude"], row["is_refitted"].lower()) for row in rows} == {
        "air_drag": ("1.31", "true"), "frame_timing": ("-2923.0", "false"), "hem": ("", "true"),
        "draught": ("-2923.0", "true"),
    }  # fmt: skip


def test_a_diagnosis_as_a_dictionary_is_its_file(tmp_path):
    outcome = hangtime.DiagnosisOutcome(result=diagnosis())
    told = outcome.to_dict()
    assert (told["verdict"], told["named"], outcome.verdict) == ("effect", ["air_drag"], "effect")
    numbers = [(one["id"], one["probability"], one["amplitude"], one["p_value"]) for one in told["effects"][:2]]
    assert numbers == [("air_drag", 0.94, 1.31, 2e-7), ("hem", 0.03, 0.004, 0.21)]
    assert told["gap"]["closure"]["value"] == 0.87
    file = outcome.save(tmp_path / "diagnosis.json")
    stated = json.loads(file.read_text())
    assert len(stated.pop("digest")) == 64  # hexadecimal digits of a SHA-256
    assert stated == json.loads(json.dumps(told))
    assert hangtime.load(file).result == outcome.result


def test_a_diagnosis_shows_its_effects_as_html_and_as_text():
    """Those tested, the most probable first; in a notebook every word is text and no HTML."""
    given = diagnosis(sentence="The model lacks <b>air</b> drag.")
    effects = [given.effects[k] for k in (1, 3, 2, 0)]
    outcome = hangtime.DiagnosisOutcome(result=diagnosis(sentence=given.sentence, effects=effects))
    html = outcome._repr_html_()
    heads = re.findall(r"<th>(.*?)</th>", html)
    assert heads == ["effect", "probability", "size", "90 % interval", "gap closed", ""]
    rows = [re.findall(r"<td>(.*?)</td>", row) for row in re.findall(r"<tr>(<td>.*?)</tr>", html)]
    shown = [
        ["air_drag", "94 %", "1.31", "1.02 to 1.6", "87 %", "named"],
        ["hem", "3 %", "-", "-0.001 to 0.009 kg/m", "8 %", ""],
        ["time_offset", "", "-", "-0.006 to 0.002 s", "1 %", ""],
    ]
    assert rows == shown
    assert re.findall(r"<p>(.*?)</p>", html) == [
        "Verdict: effect", "The model lacks &lt;b&gt;air&lt;/b&gt; drag.",
        "Errors are root mean square distances of the free points.", given.next_experiment.sentence,
    ]  # fmt: skip
    lines = [line.split() for line in str(outcome).splitlines()]
    assert lines[-3:] == [" ".join(row).split() for row in shown]


def test_a_table_of_a_fit_has_no_rounding_noise_and_loses_no_other_digit():
    """0.1 + 0.2 is written as 0.3, and a third in full; 0.30000000000004 is no noise."""
    first, second, *others = fit_result().parameters
    changed = {"initial": 0.1 + 0.2, "fitted": 1 / 3, "minimum": 0.0, "interval_low": 0.30000000000004}
    noisy = msgspec.structs.replace(second, **changed, interval_high=0.5)
    made = msgspec.structs.replace(fit_result(), parameters=[first, noisy, *others])
    for text, columns in (
        (hangtime.FitOutcome(result=made).to_csv(), ("initial", "fitted", "interval_low")),
        (parameters_csv(made, None), ("value", "interval_low")),
    ):
        (row,) = (one for one in csv.DictReader(io.StringIO(text)) if noisy.name in one.values())
        assert [row[name] for name in columns][-2:] == ["0.3333333333333333", "0.30000000000004"]
        assert row.get("initial", "0.3") == "0.3"
