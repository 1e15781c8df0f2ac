"""Tests are limited by their processor time, not by wall time, which a busy machine prolongs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests import conftest

ROOT = Path(__file__).parents[1]


def run(folder, body, still=600.0):
    """Run a test of this body in a pytest of its own, with a limit of 0.5 s."""
    (folder / "test_one.py").write_text(
        "import subprocess, sys, time\nimport pytest\n\n"
        f"@pytest.mark.processor_time(0.5)\ndef test_one():\n    {body}\n\ndef test_two():\n    pass\n"
    )
    words = ["-p", "tests.conftest", "-p", "no:cacheprovider", "-c", "/dev/null", "--rootdir", folder, folder]
    patched = f"import sys, pytest, tests.conftest as c; c.LOOK, c.STILL = 0.1, {still}; "
    code = patched + "sys.exit(pytest.main(sys.argv[1:]))"
    done = subprocess.run([sys.executable, "-c", code, *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout


@pytest.mark.parametrize(
    "body",
    [
        pytest.param("while True: pass", marks=pytest.mark.slow),
        "subprocess.run([sys.executable, '-c', 'while True: pass'], timeout=60)",
    ],
    ids=["itself", "a child"],
)
def test_a_test_that_uses_more_than_its_half_second_of_a_processor_fails_and_the_next_one_runs(tmp_path, body):
    said = run(tmp_path, body)
    assert "took more than 0.5 s of processor time" in said
    assert "1 failed, 1 passed" in said


def test_a_test_that_waits_for_ever_is_ended(tmp_path):
    """It sleeps for an hour; here standing still for one second is too long."""
    said = run(tmp_path, "time.sleep(3600)", still=1.0)
    assert "stood still for 1 s" in said
    assert "1 failed, 1 passed" in said


def test_time_in_which_the_processor_did_something_else_does_not_count(monkeypatch):
    """Ten minutes of wall time in which the test got 59 s of the processor."""
    monkeypatch.setattr(conftest, "used", lambda: clock[0])
    clock = [100.0]
    watch = conftest.Watch(60.0)
    for _ in range(int(600 / conftest.LOOK)):
        clock[0] += 59.0 / (600 / conftest.LOOK)
        watch.look()
    clock[0] += 2.0
    with pytest.raises(pytest.fail.Exception, match="took more than 60 s"):
        watch.look()


def test_a_run_that_ends_frees_taichi_which_then_keeps_its_kernels_for_the_next_run(monkeypatch):
    events = []
    monkeypatch.setitem(sys.modules, "taichi", SimpleNamespace(reset=lambda: events.append("freed")))
    conftest.pytest_sessionfinish()
    assert events == ["freed"]


def test_of_a_test_that_passed_one_report_is_sent_with_its_time_and_of_another_one_all():
    def reports(*failing):
        return [
            SimpleNamespace(when=when, passed=when not in failing, user_properties=[("of", when)])
            for when in ("setup", "call", "teardown")
        ]

    (one,) = conftest.one_report(reports())
    assert (one.when, one.user_properties) == ("call", [("of", "teardown")])
    for failing in ("call", "teardown"):
        assert len(conftest.one_report(reports(failing))) == 3
    assert len(conftest.one_report(reports("setup")[::2])) == 2  # a test that could not begin


def test_tests_of_a_room_of_fit_stay_in_one_process_and_others_with_their_file():
    assert conftest.room_of("tests/fit/gap/test_floor.py::test_one[a/b]") == "tests/fit/gap"
    assert conftest.room_of("tests/formats/test_damage.py::test_one") == "tests/formats/test_damage.py"
    assert conftest.room_of("tests/test_repository.py::test_one") == conftest.room_of("tests/test_docstrings.py::test")
