"""An earlier result in the folder is kept under a number where it is of other takes or options, and said to be."""

from __future__ import annotations

import resource
import signal

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
        ({"options": {"--gamma": 2.0}}, "has another --gamma"), ({"options": {"--gamma": 1.0}}, ""),
        ({"options": {"--held-out": "cafe"}}, "is judged on another recording of the same name"),
        ({"options": {}}, ""),  # of an older version
    ],
)  # fmt: skip
def test_a_fit_of_the_same_takes_is_kept_where_it_was_made_otherwise(tmp_path, changes, says):
    new = msgspec.structs.replace(a_fit(), options={"--gamma": 1, "--held-out": "beef"})
    save_fit_result(tmp_path / "fit.json", msgspec.structs.replace(new, **changes, material={}))
    said = set_aside_others(tmp_path / "fit.json", lambda result: True, new)
    assert said == (f"{tmp_path / 'fit.json'} {says}: kept as fit.1.json, with its report." if says else "")
    assert (tmp_path / "fit.1.json").exists() == bool(says)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"held_out_ids": ["c"]}, "is judged on c"), ({"effects": []}, "has another library of effects"),
        ({"base_parameters": []}, "has other starts or ranges of its parameters"), ({"created": "2020-01-01"}, ""),
        ({"options": {"--by": "evidence"}}, "has another --by"), ({"options": {}}, ""),
    ],
)  # fmt: skip
def test_a_diagnosis_of_the_same_takes_is_kept_where_it_was_made_otherwise(tmp_path, changes, says):
    new = shown_diagnosis(verdict="none", named=[], options={"--by": "rules"})
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


def test_a_fit_judged_on_another_recording_of_the_same_name_is_kept(tmp_path):
    write_take(tmp_path / "a.mcap", a_swung_take(seconds=2.0))
    words = ("fit", "a.mcap", "--held-out", "b.mcap", "--out", "out", "--method", "kinect-skirt", "--iterations", 1)
    for hz, is_kept in ((0.9, False), (0.9, False), (0.8, True)):
        write_take(tmp_path / "b.mcap", a_swung_take("b", hz=hz, seconds=2.0), overwrite=True)
        done = hangtime_here(*words, "--spacing", 0.15, folder=tmp_path)
        assert done.returncode == 0, done.stderr
        said = "out/fit.json is judged on another recording of the same name: kept as fit.1.json, with its report."
        assert (said in done.stderr) == is_kept
        assert "Warning: annealing found no candidate better than its start" in done.stdout
        assert not any(p.is_identified for p in load_fit_result(tmp_path / "out/fit.json").parameters)


@pytest.mark.parametrize("option", [("--iterations", 2), ("--gamma", 1e3)])
def test_a_fit_is_kept_where_another_number_of_its_search_is_given(tmp_path, option):
    write_take(tmp_path / "a.mcap", a_swung_take(seconds=2.0))
    words = ("fit", "a.mcap", "--out", "out", "--method", "kinect-skirt", "--iterations", 1, "--spacing", 0.15)
    assert hangtime_here(*words, folder=tmp_path).returncode == 0
    done = hangtime_here(*words, *option, folder=tmp_path)
    assert (done.returncode, f"has another {option[0]}: kept as fit.1.json" in done.stderr) == (0, True), done.stderr


def test_a_fit_whose_report_finds_no_room_has_said_where_the_earlier_result_is(tmp_path):
    """The limit of a file's size stands for a full disk: fit.json is below it, and report.html above."""
    write_take(tmp_path / "a.mcap", a_swung_take(seconds=2.0))
    words = ("fit", "a.mcap", "--out", "out", "--method", "kinect-skirt", "--iterations", 1, "--spacing", 0.15)
    assert hangtime_here(*words, folder=tmp_path).returncode == 0
    sizes = [(tmp_path / "out" / name).stat().st_size for name in ("fit.json", "report.html")]
    before, handled = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (sum(sizes) // 2, before[1]))
    try:
        done = hangtime_here(*words, "--seed", 1, folder=tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handled)
    assert (done.returncode, "report.html" in done.stderr) == (2, True), done.stderr
    assert "out/fit.json has another seed: kept as fit.1.json, with its report." in done.stderr
