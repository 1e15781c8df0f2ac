"""An earlier result in the folder is kept under a number where it is of other takes or options, and said to be."""

from __future__ import annotations

import msgspec
import pytest

from fit.folders import set_aside_others
from formats.archive import write_take
from formats.results import load_fit_result, save_diagnosis, save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis as shown_diagnosis
from tests.fit.test_command_line import a_swung_take


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"held_out_ids": ["b"]}, "is judged on b"), ({"method": "lean"}, "has another method"),
        ({"search": "annealing"}, "has another search"), ({"seed": 7}, "has another seed"),
        ({"spacing": 0.2}, "has another mesh spacing"), ({"effects": {"hem": 0.01}}, "has other effects"),
        ({"parameters": []}, "has other starts or ranges of its parameters"), ({"created": "2020-01-01"}, ""),
    ],
)  # fmt: skip
def test_a_fit_of_the_same_takes_is_kept_where_it_was_made_otherwise(tmp_path, changes, says):
    new = a_fit()
    save_fit_result(tmp_path / "fit.json", msgspec.structs.replace(new, **changes, material={}))
    said = set_aside_others(tmp_path / "fit.json", lambda result: True, new)
    assert said == (f"{tmp_path / 'fit.json'} {says}: kept as fit.1.json, with its report." if says else "")
    assert (tmp_path / "fit.1.json").exists() == bool(says)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"held_out_ids": ["c"]}, "is judged on c"), ({"effects": []}, "has another library of effects"),
        ({"base_parameters": []}, "has other starts or ranges of its parameters"), ({"created": "2020-01-01"}, ""),
    ],
)  # fmt: skip
def test_a_diagnosis_of_the_same_takes_is_kept_where_it_was_made_otherwise(tmp_path, changes, says):
    new = shown_diagnosis(verdict="none", named=[])
    save_diagnosis(tmp_path / "diagnosis.json", msgspec.structs.replace(new, **changes))
    said = set_aside_others(tmp_path / "diagnosis.json", lambda result: True, new)
    path = tmp_path / "diagnosis.json"
    assert said == (f"{path} {says}: kept as diagnosis.1.json, with its report." if says else "")


def test_a_fit_without_a_held_out_take_is_kept_where_one_with_it_follows_and_the_same_again_is_replaced(tmp_path):
    """Fitted without, with, and with the held-out take: the first is kept under a number, the second is replaced."""
    write_take(tmp_path / "a.mcap", a_swung_take(seconds=2.0))
    write_take(tmp_path / "b.mcap", a_swung_take("b", hz=0.9, seconds=2.0))
    words = ("fit", "a.mcap", "--out", "out", "--method", "kinect-skirt", "--iterations", 1, "--spacing", 0.15)
    for more, said in (((), ""), (("--held-out", "b.mcap"), "kept as fit.1.json"), (("--held-out", "b.mcap"), "")):
        done = hangtime_here(*words, *more, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        assert ("out/fit.json is judged on no held-out take: kept as fit.1.json" in done.stderr) == bool(said)
        assert ("kept as" in done.stderr) == bool(said)
    assert load_fit_result(tmp_path / "out/fit.json").held_out_ids == ["b"]
    assert load_fit_result(tmp_path / "out/fit.1.json").held_out_ids == []
    assert not (tmp_path / "out/fit.2.json").exists()
