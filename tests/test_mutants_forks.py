"""The mutation tester's processes: which tests they run on a mutant, in which order, and when they end."""

from __future__ import annotations

import _thread
import json
import shutil
import time
from threading import Thread

import psutil
import pytest

from tests.mutants import __main__ as program
from tests.mutants import forks, kept, plugin

AREA, TESTS = "p", ["tests/p"]

MODULE = "def half(x):\n    return x / 2\n\n\ndef twice(x):\n    return 2 * x\n"
TEST = """import os
from pathlib import Path

from p.a import half, twice


def note():
    with Path({log!r}).open("a") as log:
        print(os.environ.get("MUTANT_UNDER_TEST"), os.getpid(), file=log)


def test_half():
    note()
    assert half(4) == 2


def test_twice():
    note()
    assert twice(2) < 9
"""
HALVES = ["p.a.x_half__mutmut_1", "p.a.x_half__mutmut_2"]
TWICES = ["p.a.x_twice__mutmut_1", "p.a.x_twice__mutmut_2"]


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A small checkout: tests kill both mutants of `half` and neither of `twice`, and log which mutant they run on."""
    root = tmp_path / "checkout"
    empty = ["p/__init__.py", "tests/__init__.py", "tests/mutants/__init__.py", "README.md", "pyproject.toml"]
    of_tests = TEST.format(log=str(tmp_path / "log"))
    for name, text in {**dict.fromkeys(empty, ""), "p/a.py": MODULE, "tests/p/test_a.py": of_tests}.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for module in (plugin, forks, kept):
        shutil.copy(module.__file__, root / "tests/mutants")
    monkeypatch.setattr(program, "ROOT", root)
    monkeypatch.setattr(program, "COPIES", root / "build")
    monkeypatch.setattr(program, "COPIED", ("p", "tests"))
    return root


def run(root, names, end=float("inf"), listed=lambda *_: False):
    """Test mutants; return those whose tests ran, and the results that are kept."""
    log = root.parent / "log"
    program.make_mutants(AREA, TESTS)
    log.write_text("")
    program.test_mutants(AREA, TESTS, names, 1, root / "kept", end, listed)
    return sorted({word for word in log.read_text().split() if word.startswith("p.")}), results(root)


def results(root):
    return kept.known(root / "kept/p.json", kept.now(program.copy_of(AREA), AREA, TESTS))


@pytest.mark.slow
def test_a_second_run_tests_what_the_first_left_out_and_a_third_nothing(checkout):
    every = dict.fromkeys(HALVES, 1) | dict.fromkeys(TWICES, 0)
    assert run(checkout, HALVES + TWICES, end=time.monotonic()) == ([], {})
    assert run(checkout, HALVES) == (HALVES, dict.fromkeys(HALVES, 1))
    assert run(checkout, [*HALVES, TWICES[0]]) == (TWICES[:1], dict.fromkeys(HALVES, 1) | {TWICES[0]: 0})
    assert run(checkout, HALVES + TWICES) == (TWICES[1:], every)
    assert run(checkout, HALVES + TWICES) == ([], every)
    test = checkout / "tests/p/test_a.py"
    test.write_text(test.read_text().replace("< 9", "== 4"))
    assert run(checkout, HALVES + TWICES) == (HALVES + TWICES, dict.fromkeys(every, 1))


@pytest.mark.slow
def test_an_interrupted_run_keeps_what_it_found_and_leaves_no_process(checkout):
    """The second test of `twice` never ends on a mutant; the interrupt comes when it has begun."""
    test, log = checkout / "tests/p/test_a.py", checkout.parent / "log"
    sleep = '    import time\n    time.sleep(600 * ("twice" in os.environ.get("MUTANT_UNDER_TEST", "")))\n'
    test.write_text(test.read_text() + sleep)

    def interrupt():
        while not (log.exists() and "twice__mutmut" in log.read_text()):
            time.sleep(0.05)
        _thread.interrupt_main()

    Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        run(checkout, HALVES + TWICES, listed=lambda function, _: function == "p.a.twice")  # which come last
    assert results(checkout) == dict.fromkeys(HALVES, 1)
    assert has_ended(int(log.read_text().split()[-1]))


def has_ended(pid):
    for _ in range(600):
        if not psutil.pid_exists(pid):
            return True
        time.sleep(0.1)
    return False


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fate", "code"),
    [("while True: pass", forks.TIMEOUT), ("os._exit(0)", forks.BROKEN), ("os.kill(os.getpid(), 11)", -11)],
)
def test_a_mutant_whose_tests_never_end_or_end_their_process_is_dead(checkout, fate, code):
    """The test's child process is ended too. The second mutant is tested after the first."""
    test, log = checkout / "tests/p/test_a.py", checkout.parent / "log"
    odd = f"""    if "twice" in os.environ.get("MUTANT_UNDER_TEST", ""):
        import subprocess
        with Path({str(log)!r}).open("a") as log:
            print(subprocess.Popen(["sleep", "600"]).pid, file=log)
        {fate}
"""
    test.write_text(test.read_text() + odd)
    found = dict.fromkeys(HALVES, 1) | dict.fromkeys(TWICES, code)
    assert run(checkout, HALVES + TWICES) == (HALVES + TWICES, found)
    asleep = [int(line) for line in log.read_text().splitlines() if line.isdigit()]
    assert len(asleep) == 2
    assert all(has_ended(pid) for pid in asleep)


FIXTURES = """import time
import pytest


@pytest.fixture(scope="{scope}")
def made():
    time.sleep(2)


def test_half(made):
    from p.a import half
    half(4)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("scope", "least", "most"), [("module", 3.0, 8.0), ("session", 12.0, 20.0)])
def test_only_what_several_files_share_gives_each_test_more_time(checkout, scope, least, most):
    """Of 2 s for a fixture, five times these and 3.5 s; a mutant's test counts its processor time until it is ended."""
    test, log = checkout / "tests/p/test_a.py", checkout.parent / "log"
    (checkout / "tests/p/test_slow.py").write_text(FIXTURES.format(scope=scope))
    odd = f"""    import time
    told = 0.0
    while "half" in os.environ.get("MUTANT_UNDER_TEST", ""):
        if time.process_time() > told + 0.1:
            told = time.process_time()
            with Path({str(log.with_name("spent"))!r}).open("a") as spent:
                print(told, file=spent)
"""
    test.write_text(test.read_text().replace("    assert half(4) == 2", f"{odd}    assert half(4) == 2"))
    found = run(checkout, HALVES[:1])[1]
    assert found == {HALVES[0]: forks.TIMEOUT}
    assert least < float(log.with_name("spent").read_text().split()[-1]) < most


@pytest.mark.slow
def test_the_test_that_killed_a_functions_last_mutant_comes_first(checkout):
    test, log = checkout / "tests/p/test_a.py", checkout.parent / "log"
    slow = test.read_text().replace("assert half(4)", "import time\n    time.sleep(0.2)\n    assert half(4)")
    test.write_text(slow + "\n\ndef test_any():\n    note()\n    half(4)\n")
    for name, runs in ((HALVES[0], 2), (HALVES[1], 1)):
        run(checkout, [name])
        assert log.read_text().split().count(name) == runs


@pytest.mark.slow
def test_the_tests_of_a_modules_own_file_come_before_shorter_ones(checkout):
    any_test = checkout / "tests/p/test_any.py"
    any_test.write_text(TEST.format(log=str(checkout.parent / "log")).replace("assert ", ""))
    own = checkout / "tests/p/test_a.py"
    own.write_text(own.read_text().replace("assert half(4)", "import time\n    time.sleep(0.2)\n    assert half(4)"))
    run(checkout, HALVES[:1])
    assert (checkout.parent / "log").read_text().split().count(HALVES[0]) == 1
    assert results(checkout) == {HALVES[0]: 1}


@pytest.mark.slow
def test_a_test_that_killed_mutants_of_the_module_comes_before_others(checkout):
    """It killed those of one function, and kills those of the other, of which a test of its own file is shorter."""
    both = checkout / "tests/p/test_both.py"
    text = TEST.format(log=str(checkout.parent / "log"))
    both.write_text(text.replace("assert half(4) == 2", "assert half(twice(2)) == 2").partition("def test_twice")[0])
    own = checkout / "tests/p/test_a.py"
    own.write_text(own.read_text().replace("assert half(4) == 2", "half(4)"))
    run(checkout, HALVES[:1])
    assert (checkout.parent / "log").read_text().split().count(HALVES[0]) == 2
    run(checkout, TWICES[:1])
    assert (checkout.parent / "log").read_text().split().count(TWICES[0]) == 1
    assert results(checkout) == {HALVES[0]: 1, TWICES[0]: 1}


@pytest.mark.slow
def test_a_mutant_that_no_test_reaches_has_no_result_before_its_turn(checkout):
    """They were all counted at once, so that a sample of a few mutants held all of these."""
    module = checkout / "p/a.py"
    module.write_text(MODULE + "\n\ndef alone(x):\n    return x + 1\n")
    alone = ["p.a.x_alone__mutmut_1", "p.a.x_alone__mutmut_2"]

    def is_last(function, _):
        return function == "p.a.alone"

    _, first = run(checkout, HALVES + alone, end=time.monotonic(), listed=is_last)
    assert first == {}
    _, every = run(checkout, HALVES + alone, listed=is_last)
    assert every == dict.fromkeys(HALVES, 1) | dict.fromkeys(alone, kept.WITHOUT_TESTS)
    lines = (program.copy_of(AREA) / "results.jsonl").read_text().splitlines()
    assert {json.loads(line)[0] for line in lines[2:]} == set(alone)


@pytest.mark.slow
def test_a_test_that_fails_without_a_mutant_is_named(checkout, capfd):
    test = checkout / "tests/p/test_a.py"
    test.write_text(test.read_text().replace("== 2", "== 3"))
    with pytest.raises(program.MutmutError, match="p: mutmut ended with 1; its last words are above"):
        program.make_mutants(AREA, TESTS)
    said = capfd.readouterr().err
    assert "tests/p/test_a.py::test_half fails without a mutant" in said
    assert "assert 2.0 == 3" in said


def results_with_undecided(root):
    return {name: code for name, (_, code, *_) in kept.read(root / "kept/p.json")[0].items()}


@pytest.mark.slow
def test_a_mutant_gets_its_long_tests_after_all_have_had_their_short_ones(checkout):
    """The test that kills the mutants of `half` takes longer than a first turn, and one that never fails does not."""
    test, log = checkout / "tests/p/test_a.py", checkout.parent / "log"
    slow = test.read_text().replace("assert half(4)", "import time\n    time.sleep(2.2)\n    assert half(4)")
    test.write_text(slow + "\n\ndef test_any():\n    note()\n    half(4)\n")
    found = dict.fromkeys(HALVES, 1) | dict.fromkeys(TWICES, 0)
    assert run(checkout, HALVES + TWICES) == (HALVES + TWICES, found)
    ran = [word for word in log.read_text().split() if word.startswith("p.")]
    assert [ran.count(name) for name in HALVES + TWICES] == [2, 2, 1, 1]
    assert set(ran[:4]) == {*HALVES, *TWICES}  # the first turns
    assert set(ran[4:]) == set(HALVES)


@pytest.mark.slow
def test_a_mutant_whose_second_turn_did_not_come_is_undecided(checkout):
    """It counts as one that lives, and is tested anew."""
    test, log = checkout / "tests/p/test_a.py", checkout.parent / "log"
    test.write_text(
        test.read_text().replace("assert half(4)", "import time\n    time.sleep(2.2)\n    assert half(4)")
        + "\n\ndef test_any():\n    note()\n    half(4)\n"
    )

    def interrupt():
        while not (log.exists() and log.read_text().split().count(HALVES[0]) == 2):
            time.sleep(0.05)
        _thread.interrupt_main()

    Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        run(checkout, HALVES[:1])
    assert results_with_undecided(checkout) == {HALVES[0]: kept.UNDECIDED}
    assert results(checkout) == {}
    found = program.tally(AREA, ["p.*"], [], lambda *_: False)
    assert (found.undecided, found.killed, found.total) == (1, 0, 1)
    assert not program.show(AREA, found)
    assert run(checkout, HALVES[:1])[1] == {HALVES[0]: 1}


@pytest.mark.slow
def test_an_undecided_mutant_that_the_type_check_refuses_is_dead_and_a_listed_one_is_decided(checkout):
    """`two` may be another number, and never None."""
    typed = "def half(x: float) -> float:\n    two: float = 2.0\n    return x / two\n"
    (checkout / "p/a.py").write_text(MODULE.replace("def half(x):\n    return x / 2\n", typed))
    program.make_mutants(AREA, TESTS)
    pattern = ["p.a.x_half__*"]
    names = program.mutants_of(AREA, pattern, [])
    kept.put(program.copy_of(AREA), AREA, dict.fromkeys(names, kept.UNDECIDED), [])
    found = program.tally(AREA, pattern, [], lambda *_: False)
    assert (found.refused, found.undecided, found.total) == (1, len(names) - 1, len(names))
    found = program.tally(AREA, pattern, [], lambda *_: True)
    assert (found.listed, found.refused, found.undecided, found.total) == (len(names), 0, 0, len(names))
