"""An argument of the wrong kind is refused with its true kind, and with advice that the call accepts."""

from __future__ import annotations

import numpy as np
import pytest

import hangtime
from fit.api.arguments import check_switches
from tests.fit.report.report_scene import fit_result

A_TAKE = "a.mcap"  # no such file: the kinds are checked first


@pytest.mark.parametrize("call", [hangtime.fit, hangtime.diagnose])
@pytest.mark.parametrize("progress", [1, 0, "yes", 0.5, []])
def test_a_progress_that_is_no_function_is_answered_with_what_is_possible(call, progress):
    """1 == True, but no reader of the call sees which of the two is meant."""
    with pytest.raises(hangtime.HangtimeError, match=r"^progress: cannot be called; give a function, True or False$"):
        call(A_TAKE, progress=progress)


@pytest.mark.parametrize("value", ["no", 1, 0, 0.5, None, []])
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("anyway", lambda value: hangtime.fit(A_TAKE, anyway=value)),
        ("anyway", lambda value: hangtime.diagnose(A_TAKE, anyway=value)),
        ("anyway", lambda value: hangtime.simulate(A_TAKE, anyway=value)),
        ("overwrite", lambda value: hangtime.report(None, "r.html", overwrite=value)),
        ("overwrite", lambda value: hangtime.export("fit.json", "csv", "a.csv", overwrite=value)),
        ("overwrite", lambda value: hangtime.FitOutcome(result=fit_result()).save("f.json", overwrite=value)),
        ("overwrite", lambda value: hangtime.FitOutcome(result=fit_result()).to_csv("f.csv", overwrite=value)),
    ],
)
def test_a_switch_takes_true_and_false_alone(name, call, value, tmp_path, monkeypatch):
    """The text "no" counts as True in Python, and would replace a file."""
    monkeypatch.chdir(tmp_path)  # where a call that takes it writes its file
    kind = "None" if value is None else f"of the kind {type(value).__name__}"
    with pytest.raises(hangtime.HangtimeError, match=f"^{name}: is {kind}; give True or False$"):
        call(value)


def test_a_switch_of_numpy_is_one():
    check_switches(anyway=np.bool_(True), overwrite=False)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"takes": b"a.mcap"}, "takes: is of the kind bytes; give a take, the path of one, or a list of them"),
        ({"takes": {"a": 1}}, "takes: is of the kind dict; give a take, the path of one, or a list of them"),
        ({"takes": [A_TAKE, None]}, "takes: holds None; give a take or the path of one"),
        ({"held_out": [7]}, "held_out: holds a value of the kind int; give a take or the path of one"),
        ({"held_out_motion": [7]}, "held_out_motion: holds a value of the kind int; give a list of texts"),
        ({"effects": [None]}, "effects: holds None; give a list of texts"),
        ({"bounds": [7]}, "bounds: holds a value of the kind int; give NAME=LOW:HIGH, one text a parameter"),
    ],
)  # fmt: skip
def test_a_list_that_holds_something_else_says_so(options, sentence, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / A_TAKE).write_bytes(b"")
    with pytest.raises(hangtime.HangtimeError) as caught:
        hangtime.fit(options.pop("takes", A_TAKE), **options)
    assert str(caught.value) == sentence


def test_a_diagnosis_keeps_its_fits_in_a_folder():
    with pytest.raises(hangtime.HangtimeError, match=r"^checkpoint: is of the kind int; give the path of a folder$"):
        hangtime.diagnose(A_TAKE, checkpoint=7)
