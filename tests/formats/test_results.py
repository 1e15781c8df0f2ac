"""Result files: schemas, validation, atomic writing."""

from __future__ import annotations

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
from formats.results import load_diagnosis, load_fit_result, save_diagnosis, save_fit_result
from tests.fit.report.report_scene import diagnosis, fit_result

SCHEMA_FOLDER = Path(formats.__file__).parent / "schemas"
SCHEMAS = {
    name: {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(record)}
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
