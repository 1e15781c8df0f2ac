"""Every command that reads an earlier result refuses a number of another unit or sign, and names its field."""

from __future__ import annotations

import json

import pytest

import hangtime
from fit.identification.read_again import load_diagnosed, load_either, load_fit, read_fit
from formats.errors import HangtimeError
from formats.results import save_diagnosis, save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis


def edited(path, *keys, value):
    whole = inner = json.loads(path.read_text())
    whole.pop("digest", None)  # removed, so that the numbers themselves are looked at
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    path.write_text(json.dumps(whole))


@pytest.fixture
def fitted(tmp_path):
    """A folder with a fit of `si` and its drag in `fit.json`."""
    save_fit_result(tmp_path / "fit.json", a_fit(effects={"air_drag": 1.1}))
    return tmp_path


COMMANDS = [
    ("export", ".", "--to", "csv", "--out", "out.csv"),
    ("export", ".", "--to", "usd-physics", "--out", "out.usda"),
    ("fabric", "."),
    ("compare", ".", "fit.json"),
    ("report", "."),
    ("animate", ".", "--motion", "twist", "--out", "out.glb"),
]
WRONG = [
    (("parameters", 0, "unit"), "kN/m", "parameters[0].unit: stretch_stiffness is in kN/m, and Hangtime has it in N/m"),
    (("parameters", 0, "fitted"), 1e9, "parameters[0].fitted: stretch_stiffness is 1e+09, outside its own bounds of"),
    (("parameters", 0, "interval_high"), 1e-3, "the interval of stretch_stiffness has not a lower and an upper end"),
    (("parameters", 0, "minimum"), -30.0, "parameters[0].minimum: no cloth has stretch_stiffness = -30"),
    (("parameters", 0, "fitted"), "NaN", "parameters[0].fitted"),
    (("parameters", -1, "unit"), "N", "parameters[5].unit: air_drag is in N, and Hangtime has it in 1"),
    (("parameters", -1, "interval_low"), -0.5, "parameters[5].interval_low: air_drag is -0.5, and is never below 0"),
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: words[0])
@pytest.mark.parametrize(("keys", "value", "says"), WRONG)
def test_a_command_refuses_a_fit_with_a_wrong_number_and_writes_nothing(fitted, command, keys, value, says):
    edited(fitted / "fit.json", *keys, value=value)
    done = hangtime_here(*command, folder=fitted)
    assert done.returncode == 2, done.stderr
    assert f"fit.json: {says}" in done.stderr or (value == "NaN" and says in done.stderr)
    assert "again" in done.stderr
    assert [file.name for file in fitted.iterdir()] == ["fit.json"]


@pytest.mark.parametrize(("keys", "value", "says"), WRONG)
def test_the_python_interface_refuses_the_same(fitted, keys, value, says):
    edited(fitted / "fit.json", *keys, value=value)
    for read in (
        lambda: hangtime.load(fitted / "fit.json"),
        lambda: hangtime.export(fitted / "fit.json", "csv", fitted / "out.csv"),
    ):
        with pytest.raises(HangtimeError) as refused:
            read()
        assert says in str(refused.value)


@pytest.mark.parametrize(
    ("keys", "value", "says"),
    [
        (("effects", 0, "unit"), "N", "effects[0].unit: air_drag is in N, and Hangtime has it in 1; diagnose again"),
        (("effects", 0, "closure", "value"), 0.5, "effects[0].closure.value is 0.5, outside its own interval of 0.79"),
        (("effects", 0, "amplitude"), 9.0, "effects[0].amplitude is 9, outside its own interval of "),
        (("gap", "base_mm", "value"), 900.0, "gap.base_mm.value is 900, outside its own interval of "),
        (("gap", "with_effect_mm", "value"), 0.001, "gap.with_effect_mm.value is 0.001, outside its own interval of "),
        (
            ("effects", 0, "amplitude_interval"),
            [2, 1],
            "effects[0].amplitude_interval has not a lower and an upper end",
        ),
    ],
)
def test_a_diagnosis_with_a_wrong_number_is_refused_by_each_reader_as_a_diagnosis(tmp_path, keys, value, says):
    file = tmp_path / "diagnosis.json"
    save_diagnosis(file, diagnosis())
    edited(file, *keys, value=value)
    for command in (("report", "."), ("compare", ".", "."), ("compare", "diagnosis.json", "diagnosis.json")):
        done = hangtime_here(*command, folder=tmp_path)
        assert done.returncode == 2
        assert says in done.stderr
    with pytest.raises(HangtimeError) as refused:
        hangtime.load(file)
    assert says in str(refused.value)


@pytest.mark.parametrize("begin", [b"", b"\xef\xbb\xbf"], ids=["plain", "byte order mark"])
def test_a_damaged_diagnosis_is_named_as_one_also_where_a_fit_is_wanted(tmp_path, begin):
    file = tmp_path / "diagnosis.json"
    save_diagnosis(file, diagnosis())
    edited(file, "verdict", value=7)
    file.write_bytes(begin + file.read_bytes())
    for read in (hangtime.load, load_either, read_fit):
        with pytest.raises(HangtimeError, match="is not a diagnosis: verdict must be text"):
            read(file)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: words[0])
def test_a_command_refuses_a_fit_that_was_changed_within_range_and_writes_nothing(fitted, command):
    text = (fitted / "fit.json").read_text()
    density = json.loads(text)["material"]["areal_density"]
    (fitted / "fit.json").write_text(text.replace(f'"areal_density": {density}', f'"areal_density": {1.1 * density}'))
    done = hangtime_here(*command, folder=fitted)
    assert done.returncode == 2, done.stderr
    told = "fit.json: was changed after it was written: its content has another digest than it states; fit again; or "
    assert f"{told}remove its field 'digest', and it is read as it is" in done.stderr
    assert [file.name for file in fitted.iterdir()] == ["fit.json"]


def test_results_without_a_fault_are_read(fitted):
    assert load_fit(fitted / "fit.json") == a_fit(effects={"air_drag": 1.1})
    save_diagnosis(fitted / "diagnosis.json", diagnosis())
    assert load_diagnosed(fitted / "diagnosis.json") == diagnosis()
    older = a_fit(effects={})
    save_fit_result(fitted / "fit.json", older)
    edited(fitted / "fit.json", "method", value="a method of another version")
    assert load_fit(fitted / "fit.json").parameters == older.parameters


@pytest.mark.parametrize(("text", "why"), [("{", "is not a diagnosis"), (None, "was changed after it was written")])
def test_a_diagnosis_beside_a_fit_that_cannot_be_used_is_told(fitted, text, why):
    """It may name an effect that the fit lacks."""
    file = fitted / "diagnosis.json"
    save_diagnosis(file, diagnosis())
    file.write_text(text or file.read_text().replace('"verdict": "effect"', '"verdict": "none"'))
    for command in (("fabric", "."), ("export", ".", "--to", "csv", "--out", "out.csv")):
        done = hangtime_here(*command, folder=fitted)
        assert done.returncode == 0, done.stderr
        assert f"Warning: diagnosis.json beside this fit cannot be used: {why}" in done.stdout + done.stderr


def test_a_fit_without_a_diagnosis_beside_it_warns_of_none(fitted):
    assert not [note for note in read_fit(fitted)[0].notes if "diagnosis.json" in note]
