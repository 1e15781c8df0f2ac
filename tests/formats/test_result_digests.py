"""A result that was changed after it was written is refused; one that was only written in other words is read."""

from __future__ import annotations

import json
import re

import msgspec
import pytest

from formats.errors import ResultError
from formats.result_digests import with_digest
from formats.results import (
    load_diagnosis,
    load_fit_result,
    load_result,
    result_bytes,
    save_diagnosis,
    save_fit_result,
)
from tests.fit.export.exported import a_fit
from tests.fit.report.report_scene import diagnosis, fit_result

KINDS = [
    (save_fit_result, load_fit_result, fit_result, "fit again"),
    (save_diagnosis, load_diagnosis, diagnosis, "diagnose again"),
]


@pytest.fixture(params=KINDS, ids=["fit", "diagnosis"])
def kept(request, tmp_path):
    """A file, its reader, what it holds, and what makes it again."""
    save, load, record, again = request.param
    save(tmp_path / "r.json", record())
    return tmp_path / "r.json", load, record(), again


def numbers_in(text):
    """Where each number of a text stands."""
    return [found.span() for found in re.finditer(r"(?<=[ \[])-?\d+(\.\d+)?(e-?\d+)?(?=[,\n\]])", text)]


def test_every_changed_number_is_found(kept):
    path, load, _, again = kept
    text = path.read_text()
    spans = numbers_in(text)
    assert len(spans) > 50
    for begin, stop in spans:
        number = json.loads(text[begin:stop])
        changed = number + 1 if isinstance(number, int) else number * (1 + 1e-7) + 1e-12
        path.write_text(f"{text[:begin]}{json.dumps(changed)}{text[stop:]}")
        with pytest.raises(ResultError) as refused:
            load(path)
        assert again in str(refused.value)


def test_a_changed_word_and_a_further_one_are_found(kept):
    path, load, record, again = kept
    for change in ({"created": "2031-01-01"}, {"notes": [*record.notes, "more"]}):
        whole = json.loads(path.read_text()) | change
        path.with_name("other.json").write_text(json.dumps(whole))
        for read in (load, load_result):
            with pytest.raises(ResultError) as refused:
                read(path.with_name("other.json"))
            assert str(refused.value) == (
                f"{path.with_name('other.json')}: was changed after it was written: its content has another digest "
                f"than it states; {again}; or remove its field 'digest', and it is read as it is"
            )


@pytest.mark.parametrize("indent", [None, 1, 4])
def test_a_result_in_other_spaces_line_ends_and_order_is_the_same(kept, indent):
    path, load, record, _ = kept
    whole = json.loads(path.read_text())
    for one in (whole, dict(reversed(whole.items())), json.loads(json.dumps(whole, sort_keys=True))):
        path.write_bytes(b"\xef\xbb\xbf" + json.dumps(one, indent=indent).replace("\n", "\r\n").encode())
        assert load(path) == record


def test_a_result_as_other_programs_write_its_numbers_is_the_same(kept):
    """JavaScript writes 1.0 and -0.0 as 1 and 0, and 1e-07 as 1e-7."""
    path, load, record, _ = kept
    text = re.sub(r"(?<=\d)\.0(?=[,\n\]])", "", path.read_text())
    assert text != path.read_text()
    path.write_text(text)
    assert load(path) == record
    path.write_text(json.dumps(json.loads(text), sort_keys=True))
    assert load(path) == record


def test_numbers_of_any_size_have_one_digest(tmp_path):
    numbers = [-0.0, 0.0, 1e-7, 2.0**53 + 2, 1e22, 1.5, 7.0]
    save_fit_result(tmp_path / "r.json", msgspec.structs.replace(fit_result(), history=numbers))
    whole = json.loads((tmp_path / "r.json").read_text())
    assert whole["history"] == numbers
    text = json.dumps(whole | {"history": "here"})
    (tmp_path / "r.json").write_text(text.replace('"here"', "[0, 0, 1e-7, 9007199254740994, 1e+22, 15e-1, 7]"))
    assert load_fit_result(tmp_path / "r.json").history == numbers


def test_a_whole_number_beyond_every_double_is_a_change(tmp_path):
    save_fit_result(tmp_path / "r.json", fit_result())
    whole = json.loads((tmp_path / "r.json").read_text())
    (tmp_path / "r.json").write_text(json.dumps(whole | {"seed": 10**400}))
    with pytest.raises(ResultError, match="was changed after it was written"):
        load_fit_result(tmp_path / "r.json")


def test_a_result_without_a_digest_is_read_as_it_is(kept):
    """As one of an older version, or with its line removed."""
    path, load, record, _ = kept
    lines = path.read_text().splitlines()
    assert lines[2].startswith('  "digest": "')
    path.write_text("\n".join(lines[:2] + lines[3:]).replace(record.created, "2031-01-01"))
    assert load(path).created == "2031-01-01"


def test_a_result_that_is_written_again_states_its_own_digest(kept):
    path, load, record, _ = kept
    assert result_bytes(load(path), path) == result_bytes(record, path) == path.read_bytes()


def test_a_record_that_holds_an_older_digest_states_its_own(kept):
    """As one that somebody decoded from a file by its type, and changed."""
    path, load, record, _ = kept
    held = msgspec.structs.replace(msgspec.json.decode(path.read_bytes(), type=type(record)), created="2031-01-01")
    path.write_bytes(result_bytes(held, path))
    assert load(path) == msgspec.structs.replace(record, created="2031-01-01")


def rounded(value, form):
    if isinstance(value, dict):
        return {name: rounded(one, form) for name, one in value.items()}
    if isinstance(value, list):
        return [rounded(one, form) for one in value]
    return float(format(value, form)) if isinstance(value, float) else value


@pytest.mark.parametrize("digits", [5, 15, 16])
def test_a_result_whose_numbers_a_program_has_rounded_is_told_so(kept, digits):
    path, load, _, again = kept
    whole = json.loads(path.read_text())
    whole["notes"] = []
    whole |= {"options": {f"number {k}": 1 / (k + 7) for k in range(30)}}
    raw = with_digest(json.dumps(whole).encode())
    path.write_bytes(raw)
    load(path)
    path.write_text(json.dumps(rounded(json.loads(raw), f".{digits}g")))
    for read in (load, load_result):
        with pytest.raises(ResultError) as refused:
            read(path)
        assert str(refused.value) == (
            f"{path}: was rounded or changed after it was written: all its numbers have {digits} digits at most, as a "
            f"program leaves them that rounds; read the file that Hangtime wrote, or {again}; or remove its field "
            "'digest', and it is read as it is"
        )


def test_a_result_of_which_one_number_was_changed_is_not_called_rounded(kept):
    path, load, *_ = kept
    whole = json.loads(path.read_text()) | {"options": {f"number {k}": 1 / (k + 7) for k in range(30)}}
    path.write_bytes(
        with_digest(json.dumps(whole).encode()).replace(b"0.1,", b"0.2,").replace(b"0.14285714285714285", b"0.15")
    )
    with pytest.raises(ResultError, match="its content has another digest than it states"):
        load(path)


@pytest.mark.parametrize("order", ["first", "last", "other text"])
def test_a_result_is_read_by_its_format_wherever_it_stands(kept, order):
    path, _, record, _ = kept
    whole = json.loads(path.read_text())
    if order == "last":
        whole["format"] = whole.pop("format")
    if order == "other text":
        path.write_text(json.dumps(whole).replace('"format": "h', '"format": "\\u0068', 1))
    else:
        path.write_text("\ufeff" * (order == "last") + json.dumps(whole, indent=3))
    assert load_result(path) == record


@pytest.mark.parametrize("is_edited", [False, True])
def test_a_rounded_result_whose_numbers_disagree_is_told_so_whether_or_not_it_was_edited_before(tmp_path, is_edited):
    """Rounding moves the material's numbers away from the parameters'; nothing shows an edit before it."""
    path = tmp_path / "fit.json"
    kept = a_fit(values={"stretch_stiffness": 100 / 3, "shear_stiffness": 70 / 3, "bending_stiffness": 1e-5 / 7})
    save_fit_result(path, msgspec.structs.replace(kept, history=[1 / (k + 7) for k in range(30)]))
    whole = json.loads(path.read_text())
    if is_edited:
        whole["parameters"][1]["fitted"] /= 2
    path.write_text(json.dumps(rounded(whole, ".5g")))
    with pytest.raises(ResultError, match="was rounded or changed after it was written: all its numbers have 5 "):
        load_fit_result(path)
    path.write_text(json.dumps(whole | {"digest": "0" * 64, "layers": 0}))
    with pytest.raises(ResultError, match="was changed after it was written: its content has another digest"):
        load_fit_result(path)
