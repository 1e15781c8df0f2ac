"""Result files: schemas, validation, atomic writing."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import jsonschema
import msgspec
import numpy as np
import pytest

import formats
from formats.diagnosis_records import Diagnosis, place_of
from formats.errors import ResultError
from formats.fit_records import FitResult
from formats.results import (
    diagnosis_from,
    fit_result_from,
    load_diagnosis,
    load_fit_result,
    save_diagnosis,
    save_fit_result,
)
from tests.fit.report.report_scene import diagnosis, fit_result

SCHEMA_FOLDER = Path(formats.__file__).parent / "schemas"


def without_indents(schema):
    """Return a schema whose descriptions begin at the left; msgspec does so since 0.23, and Python since 3.13."""
    if isinstance(schema, list):
        return [without_indents(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        name: inspect.cleandoc(value) if name == "description" and isinstance(value, str) else without_indents(value)
        for name, value in schema.items()
    }  # fmt: skip


SCHEMAS = {
    name: {"$schema": "https://json-schema.org/draft/2020-12/schema", **without_indents(msgspec.json.schema(record))}
    for name, record in (("fit-result.json", FitResult), ("diagnosis.json", Diagnosis))
}


@pytest.mark.parametrize("name", sorted(SCHEMAS))
def test_the_published_schema_is_the_one_in_force(name):
    assert json.loads((SCHEMA_FOLDER / name).read_text()) == SCHEMAS[name]


def test_results_come_back_and_match_their_schemas(tmp_path):
    fit, found = fit_result(), diagnosis()
    save_fit_result(tmp_path / "fit.json", fit)
    save_diagnosis(tmp_path / "diagnosis.json", found)
    assert load_fit_result(tmp_path / "fit.json") == fit
    assert load_diagnosis(tmp_path / "diagnosis.json") == found
    jsonschema.validate(json.loads((tmp_path / "fit.json").read_text()), SCHEMAS["fit-result.json"])
    jsonschema.validate(json.loads((tmp_path / "diagnosis.json").read_text()), SCHEMAS["diagnosis.json"])


def test_a_number_of_numpy_is_written_as_one_of_python(tmp_path):
    save_fit_result(tmp_path / "fit.json", msgspec.structs.replace(fit_result(), seconds=np.float64(1.5)))
    assert load_fit_result(tmp_path / "fit.json").seconds == 1.5
    with pytest.raises(ResultError, match="seconds is not a finite number"):
        save_fit_result(tmp_path / "bad.json", msgspec.structs.replace(fit_result(), seconds=np.float64("nan")))


def test_a_number_that_is_not_finite_is_refused_and_nothing_is_left(tmp_path):
    bad = msgspec.structs.replace(fit_result(), seconds=float("nan"))
    with pytest.raises(ResultError, match="seconds is not a finite number"):
        save_fit_result(tmp_path / "fit.json", bad)
    assert list(tmp_path.iterdir()) == []


def test_a_named_effect_must_be_among_the_findings(tmp_path):
    bad = msgspec.structs.replace(diagnosis(), verdict="effect", named=["gremlins"])
    with pytest.raises(ResultError, match="gremlins"):
        save_diagnosis(tmp_path / "d.json", bad)
    bad = msgspec.structs.replace(diagnosis(), alternatives={"air_drag": ["imps"]})
    with pytest.raises(ResultError, match="imps"):
        save_diagnosis(tmp_path / "d.json", bad)


def test_a_result_behind_a_byte_order_mark_is_read(tmp_path):
    save_fit_result(tmp_path / "fit.json", fit_result())
    (tmp_path / "fit.json").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "fit.json").read_bytes())
    assert load_fit_result(tmp_path / "fit.json") == fit_result()


def test_a_wrong_field_is_named(tmp_path):
    save_fit_result(tmp_path / "fit.json", fit_result())
    (tmp_path / "fit.json").write_text((tmp_path / "fit.json").read_text().replace('"seed"', '"sead"'))
    with pytest.raises(ResultError, match="sead"):
        load_fit_result(tmp_path / "fit.json")


@pytest.mark.parametrize(
    ("regions", "words"),
    [
        (["bottom left", "bottom centre", "bottom right"], "along the bottom"),
        (["bottom left", "bottom right"], "at the bottom left and bottom right"),
        (["top left"], "at the top left"),
        ([], ""),
    ],
)
def test_regions_are_named_in_words(regions, words):
    assert place_of(regions) == words


def test_a_file_of_300_gigabytes_is_no_result_and_not_read(tmp_path):
    with (tmp_path / "fit.json").open("wb") as file:
        file.truncate(300 << 30)
    with pytest.raises(ResultError, match=r"has 322.1 GB, which no result has; check the path"):
        load_fit_result(tmp_path / "fit.json")


def test_a_result_of_millions_of_short_notes_is_refused_before_it_is_decoded(tmp_path):
    """Decoded, 28 MB of notes of two letters would take 450 MB and four seconds."""
    file = tmp_path / "fit.json"
    save_fit_result(file, msgspec.structs.replace(fit_result(), notes=["ab"]))
    raw = file.read_bytes().replace(b'"ab"', b'"ab"' + b',"ab"' * 1_700_000, 1)
    file.write_bytes(raw)
    for read in (lambda: load_fit_result(file), lambda: fit_result_from(raw, "fits/a.json")):
        with pytest.raises(ResultError, match=r"fits?.*\.json: has 8\.5 MB of 170\d{4} short values, which no"):
            read()


def edited(path, *changes):
    """Write what a person made of a result, without its digest: each change is a path in the JSON and a value."""
    plain = json.loads(path.read_text())
    plain.pop("digest", None)  # removed, so that the numbers themselves are looked at
    for keys, value in changes:
        inner = plain
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = value
    path.write_text(json.dumps(plain))


MASS = ("parameters", 0)
OWN_BOUNDS = "mass is {}, outside its own bounds of 0.15 to 10"


@pytest.mark.parametrize(
    ("keys", "value", "says"),
    [
        ((*MASS, "fitted"), 1e308, "parameters[0].fitted is 1e+308, and no result has a number that large"),
        ((*MASS, "fitted"), 10.01, "parameters[0].fitted: " + OWN_BOUNDS.format("10.01")),
        ((*MASS, "fitted"), -1, "parameters[0].fitted: " + OWN_BOUNDS.format("-1")),
        ((*MASS, "initial"), 0.1, "parameters[0].initial: " + OWN_BOUNDS.format("0.1")),
        ((*MASS, "minimum"), 11, "parameters[0]: the bounds of mass are crossed (11 to 10)"),
        ((*MASS, "interval_low"), 2.5, "the interval of mass has not a lower and an upper end"),
        (("parameters", 1, "name"), "mass", "parameters[1]: mass is there twice"),
        (("effects",), {"air": 1.2}, "effects.air is 1.2, and the parameter's value 3.3"),
        (("material",), {"velocity_damping": -1}, "no cloth has velocity_damping = -1"),
        (("material",), {"bending_stiffness": 0}, "no cloth has bending_stiffness = 0"),
        (("material",), {"shear_stiffness": -1e-9}, "no cloth has shear_stiffness = -1e-09"),
        (("material",), {"areal_density": -1}, "no cloth has areal_density = -1"),
        (
            ("trivial",),
            [{"name": "crystal ball", "train": {"mean_m": 0.1, "max_m": 0.2, "per_frame_m": [0.1], "time_s": [0.0]}}],
            "trivial[0].name: there is no predictor named 'crystal ball'",
        ),
        (("layers",), 0, "layers is 0, and cloth has one or more"),
        (("spacing",), -0.01, "spacing is -0.01 m, and a mesh has more"),
        (("spacing",), 0, "spacing is 0 m, and a mesh has more"),
        (("seconds",), 1e101, "seconds is 1e+101, and no result has a number that large"),
    ],
)
def test_a_fit_that_contradicts_itself_is_refused_when_it_is_read(tmp_path, keys, value, says):
    save_fit_result(tmp_path / "fit.json", fit_result())
    edited(tmp_path / "fit.json", (keys, value))
    with pytest.raises(ResultError) as refused:
        load_fit_result(tmp_path / "fit.json")
    assert str(refused.value) == f"{tmp_path}/fit.json: {says}; fit again"


@pytest.mark.parametrize(("kind", "value"), [("minimum", 0), ("minimum", -1), ("interval_low", 0)])
def test_a_bound_that_no_cloth_has_is_refused_by_its_place(tmp_path, kind, value):
    """A tester's sheet divides by the stiffness at the ends of its interval and at its bounds."""
    save_fit_result(tmp_path / "fit.json", fit_result())
    name = ("parameters", 0, "name")
    edited(tmp_path / "fit.json", (name, "stretch_stiffness"), (("effects",), {"stiffening": 1.0}))
    load_fit_result(tmp_path / "fit.json")
    edited(tmp_path / "fit.json", (("parameters", 0, kind), value))
    with pytest.raises(ResultError, match=rf"parameters\[0\]\.{kind}: no cloth has stretch_stiffness = {value}"):
        load_fit_result(tmp_path / "fit.json")


def test_a_material_that_is_not_the_fitted_one_is_refused_unless_effects_change_it(tmp_path):
    save_fit_result(tmp_path / "fit.json", fit_result())
    changes = (("material",), {"bend": 8.5}), (("effects",), {})
    edited(tmp_path / "fit.json", *changes)
    with pytest.raises(ResultError, match=r"material.bend is 8.5, and the parameter's value 8.4"):
        load_fit_result(tmp_path / "fit.json")
    edited(tmp_path / "fit.json", (("material", "bend"), 8.4 * (1 + 1e-12)))
    load_fit_result(tmp_path / "fit.json")
    edited(tmp_path / "fit.json", (("material", "bend"), 8.5), (("effects",), {"stiffening": 1.0}))
    load_fit_result(tmp_path / "fit.json")


def test_a_value_at_its_bound_may_be_a_rounding_beyond(tmp_path):
    save_fit_result(tmp_path / "fit.json", fit_result())
    edited(tmp_path / "fit.json", ((*MASS, "fitted"), 10 * (1 + 1e-14)), ((*MASS, "interval_high"), 10))
    load_fit_result(tmp_path / "fit.json")


@pytest.mark.parametrize(
    ("keys", "value", "says"),
    [
        (
            ("base_parameters", 0, "fitted"),
            81,
            "base_parameters[0].fitted: struct is 81, outside its own bounds of 5 to 80",
        ),
        (("effects", 0, "probability"), 1.5, "effects[0].probability is 1.5, and must be from 0 to 1"),
        (
            ("effects", 0, "amplitude_interval"),
            [2, 1.9],
            "effects[0].amplitude_interval has not a lower and an upper end",
        ),
        (("gap", "base_mm", "interval"), [13, 11], "gap.base_mm.interval has not a lower and an upper end"),
        (("gap", "base_mm", "value"), 1e308, "gap.base_mm.value is 1e+308, and no result has a number that large"),
    ],
)
def test_a_diagnosis_that_contradicts_itself_is_refused_when_it_is_read(tmp_path, keys, value, says):
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis())
    edited(tmp_path / "diagnosis.json", (keys, value))
    with pytest.raises(ResultError) as refused:
        load_diagnosis(tmp_path / "diagnosis.json")
    assert str(refused.value) == f"{tmp_path}/diagnosis.json: {says}; diagnose again"


COPY = "copy it again, or make it again"
SAVE = "save it as UTF-8, or copy it from where it was made"


@pytest.mark.parametrize(
    ("spoilt", "says"),
    [
        (lambda raw: raw.decode().encode("utf-16"), f"is text in UTF-16, and a result is UTF-8; {SAVE}"),
        (lambda raw: raw.decode().encode("utf-16-le"), f"is text in UTF-16, and a result is UTF-8; {SAVE}"),
        (lambda raw: bytes(len(raw)), f"holds nothing but zeros, as a power cut leaves a file; {COPY}"),
        (lambda raw: b" \n", f"is empty; {COPY}"),
        (lambda raw: b"", f"is empty; {COPY}"),
        (lambda raw: raw[:300] + bytes(9) + raw[309:],
         f"holds zero bytes within its text: the file is damaged; {COPY}"),
        (lambda raw: b"\xef\xbb\xbf\n" + raw + b"\0", f"holds zero bytes within its text: the file is damaged; {COPY}"),
        (lambda raw: b"PK34" + raw[:99] + bytes(9), "is a binary file, and no result; give the folder or the .json of "
         "a fit or diagnosis"),
    ],
)  # fmt: skip
def test_a_result_that_is_no_text_says_what_it_is(tmp_path, spoilt, says):
    for save, load, record in (
        (save_fit_result, load_fit_result, fit_result()), (save_diagnosis, load_diagnosis, diagnosis()),
    ):  # fmt: skip
        path = tmp_path / "r.json"
        save(path, record)
        path.write_bytes(spoilt(path.read_bytes()))
        with pytest.raises(ResultError) as refused:
            load(path)
        assert str(refused.value) == f"{path}: {says}"


@pytest.mark.parametrize(
    ("save", "read", "record"),
    [(save_fit_result, fit_result_from, fit_result()), (save_diagnosis, diagnosis_from, diagnosis())],
    ids=["fit", "diagnosis"],
)
def test_a_result_is_read_from_bytes_and_an_error_says_whence_they_are(tmp_path, save, read, record):
    save(tmp_path / "new/r.json", record)
    raw = (tmp_path / "new/r.json").read_bytes()
    assert read(raw, "the store") == record
    assert raw.endswith(b"}\n")
    with pytest.raises(ResultError) as refused:
        read(b"{}", "the store")
    kind = "fit result" if isinstance(record, FitResult) else "diagnosis"
    assert str(refused.value).startswith(f"the store: is not a {kind}: the field `format` is missing")
    assert refused.value.advice == "make it again"
