"""The mutation tester keeps results while a mutant's module and tests are the same, and goes on where it ended."""

from __future__ import annotations

import _thread
import json
import shutil
import time
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import psutil
import pytest

from tests.mutants import __main__ as program
from tests.mutants import kept, plugin

AREA, TESTS = "p", ["tests/p"]
HALF, TWICE = "p.a.x_half__mutmut_1", "p.a.x_twice__mutmut_1"
REACHED = {
    "p.a.x_half": ["tests/p/test_half.py::test_of_2[1-2]"],
    "p.a.x_twice": ["tests/p/test_twice.py::test"],
}


@pytest.fixture
def copy(tmp_path):
    """A checkout's copy: two functions of one module, each with one mutant and one file of tests, and a file beside."""
    texts = {
        "p/a.py": "code",
        "tests/p/test_half.py": "tests of half",
        "tests/p/test_twice.py": "tests of twice",
        "tests/p/truth.py": "numbers",
        "mutants/p/a.py": "code with mutants",
        "mutants/p/a.py.meta": json.dumps({"exit_code_by_key": {HALF: 1, TWICE: None}, "durations_by_key": {}}),
        "mutants/mutmut-stats.json": json.dumps({"tests_by_mangled_function_name": REACHED}),
    }  # fmt: skip
    for name, text in texts.items():
        path = tmp_path / "copy" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "copy"


@pytest.mark.parametrize(
    ("changed", "stay"),
    [
        ("p/a.py", set()),
        ("tests/p/test_half.py", {TWICE}),
        ("tests/p/test_twice.py", {HALF}),
        ("tests/p/truth.py", set()),
        ("p/b.py", {HALF, TWICE}),
        ("tests/p/test_third.py", {HALF, TWICE}),
    ],
)
def test_a_result_is_known_until_its_module_or_a_test_that_reaches_it_changes(copy, changed, stay):
    before = kept.keys(copy, AREA, TESTS)
    kept.put(copy, AREA, {HALF: 1, TWICE: 0}, [])
    kept.keep(copy / "kept/p.json", copy, AREA, before)
    (copy / changed).write_text("changed")
    after = kept.keys(copy, AREA, TESTS)
    assert {name for name in before if before[name] == after[name]} == stay
    assert kept.known(copy / "kept/p.json", after) == {
        name: code for name, code in ((HALF, 1), (TWICE, 0)) if name in stay
    }


def test_results_of_two_runs_add_up(copy):
    keys, store = kept.keys(copy, AREA, TESTS), copy / "kept/p.json"
    assert kept.known(store, keys) == {}
    kept.keep(store, copy, AREA, keys)
    assert kept.known(store, keys) == {HALF: 1}
    kept.put(copy, AREA, {TWICE: 0}, [])
    kept.keep(store, copy, AREA, keys)
    assert kept.known(store, keys) == {HALF: 1, TWICE: 0}


def test_results_of_mutants_that_are_gone_go_too(copy):
    store = copy / "p.json"
    store.write_text(json.dumps({"p.a.x_gone__mutmut_1": ["key", 1]}))
    kept.keep(store, copy, AREA, kept.keys(copy, AREA, TESTS))
    assert list(json.loads(store.read_text())) == [HALF]


def test_mutmut_gets_what_is_known_and_tests_only_what_is_missing(copy):
    meta = copy / "mutants/p/a.py.meta"
    kept.put(copy, AREA, {}, [TWICE])
    assert json.loads(meta.read_text()) == {
        "exit_code_by_key": {HALF: kept.SKIPPED, TWICE: None}, "durations_by_key": {},
    }  # fmt: skip
    assert kept.exit_codes(meta) == {HALF: None, TWICE: None}
    kept.put(copy, AREA, {HALF: 0}, [TWICE])
    assert kept.exit_codes(meta) == {HALF: 0, TWICE: None}


def test_results_cut_off_while_they_were_written_are_made_anew(copy):
    meta = copy / "mutants/p/a.py.meta"
    meta.write_text(meta.read_text()[:-5])
    assert kept.exit_codes(meta) == {}
    kept.tidy(copy, copy, ["p"])
    assert not meta.exists()
    assert not (copy / "mutants/p/a.py").exists()


def test_the_copy_loses_what_the_checkout_lost(copy, tmp_path):
    root = tmp_path / "checkout"
    shutil.copytree(copy / "tests", root / "tests")
    (root / "tests/p/test_twice.py").unlink()
    (copy / "setup.cfg").touch()
    kept.tidy(copy, root, ["p", "tests"])
    left = {str(path.relative_to(copy)) for path in copy.rglob("*") if path.is_file()}
    assert left == {"setup.cfg", "mutants/mutmut-stats.json", "tests/p/test_half.py", "tests/p/truth.py"}


def test_short_tests_come_first_and_those_of_a_file_together(tmp_path, monkeypatch):
    took = {"long::a": 3.0, "long::b": 1.0, "short::a": 1.5, "short::b": 0.5}
    (tmp_path / "mutmut-stats.json").write_text(json.dumps({"duration_by_test": took}))
    monkeypatch.chdir(tmp_path)
    plugin.durations.cache_clear()
    items = [SimpleNamespace(nodeid=name, path=Path(name.partition("::")[0])) for name in [*took, "new::a"]]
    plugin.pytest_collection_modifyitems(items)
    plugin.durations.cache_clear()
    assert [item.nodeid for item in items] == ["new::a", "short::b", "short::a", "long::b", "long::a"]


# --- with mutmut itself ---------------------------------------------------------------------------

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
    shutil.copy(plugin.__file__, root / "tests/mutants")
    monkeypatch.setattr(program, "ROOT", root)
    monkeypatch.setattr(program, "COPIES", root / "build")
    monkeypatch.setattr(program, "COPIED", ("p", "tests"))
    return root


def run(root, names, end=float("inf")):
    """Test mutants; return those whose tests ran, and the results that are kept."""
    log = root.parent / "log"
    program.make_mutants(AREA, TESTS)
    assert program.mutants_of(AREA, ["p.*"], []) == HALVES + TWICES
    log.write_text("")
    program.test_mutants(AREA, TESTS, names, 1, root / "kept", end)
    return sorted({word for word in log.read_text().split() if word.startswith("p.")}), results(root)


def results(root):
    return kept.known(root / "kept/p.json", kept.keys(program.copy_of(AREA), AREA, TESTS))


@pytest.mark.slow
def test_a_second_run_tests_what_the_first_left_out_and_a_third_nothing(checkout, monkeypatch):
    every = dict.fromkeys(HALVES, 1) | dict.fromkeys(TWICES, 0)
    assert run(checkout, HALVES + TWICES, end=time.monotonic()) == ([], {})
    assert run(checkout, HALVES) == (HALVES, dict.fromkeys(HALVES, 1))
    monkeypatch.setattr(program, "NAMED", 1)  # so that mutmut is not told any name
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
        run(checkout, HALVES + TWICES)
    assert results(checkout) == dict.fromkeys(HALVES, 1)
    asleep = int(log.read_text().split()[-1])
    for _ in range(600):
        if not psutil.pid_exists(asleep):
            break
        time.sleep(0.1)
    assert not psutil.pid_exists(asleep)


@pytest.mark.slow
def test_a_test_that_fails_without_a_mutant_is_named(checkout, capfd):
    test = checkout / "tests/p/test_a.py"
    test.write_text(test.read_text().replace("== 2", "== 3"))
    with pytest.raises(program.MutmutError, match="p: mutmut ended with 1; its last words are above"):
        program.make_mutants(AREA, TESTS)
    said = capfd.readouterr().err
    assert "tests/p/test_a.py::test_half fails without a mutant" in said
    assert "assert 2.0 == 3" in said


@pytest.mark.parametrize("path", ["fit/folders.py", "fit", "fit/search/no_such_module.py", "fit/search_words.py"])
def test_a_path_that_no_folder_of_mutants_holds_is_refused(path, monkeypatch, capsys):
    """It was left out without a word, and the program ended with 0, as if its mutants had died."""
    monkeypatch.setattr("sys.argv", ["mutants", path])
    with pytest.raises(SystemExit, match="2"):
        program.main()
    assert f"{path}: is no tested folder or module; name one of, or one within, " in capsys.readouterr().err


@pytest.mark.parametrize("minutes", ["nan", "-3", "0"])
def test_a_time_that_is_none_is_refused(minutes, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["mutants", "--minutes", minutes])
    with pytest.raises(SystemExit, match="2"):
        program.main()
    assert f"--minutes: {minutes} is no time; give a number above 0" in capsys.readouterr().err


def test_a_report_before_the_first_run_says_that_there_is_none(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["mutants", "--report", "fit/search"])
    monkeypatch.setattr(program, "COPIES", tmp_path)
    assert program.main() == 1
    assert capsys.readouterr().out == "\nfit/search: no run has tested it yet\n"
