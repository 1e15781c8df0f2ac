"""The mutation tester keeps results while a mutant's module and tests are the same, and goes on where it ended."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

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


def keep(copy, killed_by=None):
    kept.keep(copy / "kept/p.json", copy, AREA, kept.now(copy, AREA, TESTS), killed_by or {})


def known(copy):
    return kept.known(copy / "kept/p.json", kept.now(copy, AREA, TESTS))


def left(copy):
    return kept.left(copy / "kept/p.json", kept.now(copy, AREA, TESTS))


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
def test_a_result_is_known_until_its_module_or_a_test_that_it_rests_on_changes(copy, changed, stay):
    kept.put(copy, AREA, {HALF: 1, TWICE: 0}, [])
    keep(copy, {HALF: REACHED["p.a.x_half"][0]})
    (copy / changed).write_text("changed")
    assert known(copy) == {name: code for name, code in ((HALF, 1), (TWICE, 0)) if name in stay}
    assert left(copy) == {name: REACHED[kept.function_of(name)] for name in {HALF, TWICE} - stay}


def test_one_that_lived_is_tested_again_with_the_tests_that_have_changed_and_one_that_died_not_at_all(copy):
    """A file comes to test both functions, though it did not kill `half`."""
    reached = {"p.a.x_half": [*REACHED["p.a.x_half"], "tests/p/test_other.py::test"],
               "p.a.x_twice": [*REACHED["p.a.x_twice"], "tests/p/test_other.py::test"]}  # fmt: skip
    (copy / "tests/p/test_other.py").write_text("other")
    kept.put(copy, AREA, {HALF: 1, TWICE: 0}, [])
    keep(copy, {HALF: REACHED["p.a.x_half"][0]})
    (copy / "mutants/mutmut-stats.json").write_text(json.dumps({"tests_by_mangled_function_name": reached}))
    assert known(copy) == {HALF: 1}
    assert left(copy) == {TWICE: ["tests/p/test_other.py::test"]}


def test_a_mutant_is_tested_again_when_the_test_that_killed_it_is_gone(copy):
    kept.put(copy, AREA, {HALF: 1, TWICE: 0}, [])
    keep(copy, {HALF: "tests/p/test_half.py::test_that_was"})
    assert known(copy) == {TWICE: 0}
    assert left(copy) == {HALF: REACHED["p.a.x_half"]}


def test_a_mutant_that_no_test_reached_is_tested_once_a_test_does(copy):
    stats = copy / "mutants/mutmut-stats.json"
    stats.write_text(json.dumps({"tests_by_mangled_function_name": {}}))
    kept.put(copy, AREA, {HALF: kept.WITHOUT_TESTS, TWICE: kept.WITHOUT_TESTS}, [])
    keep(copy)
    assert (left(copy), set(known(copy))) == ({}, {HALF, TWICE})
    stats.write_text(json.dumps({"tests_by_mangled_function_name": {"p.a.x_half": REACHED["p.a.x_half"]}}))
    assert (left(copy), set(known(copy))) == ({HALF: REACHED["p.a.x_half"]}, {TWICE})


def test_results_of_two_runs_add_up(copy):
    killed_by = {HALF: REACHED["p.a.x_half"][0]}
    assert known(copy) == {}
    assert left(copy) == {HALF: REACHED["p.a.x_half"], TWICE: REACHED["p.a.x_twice"]}
    keep(copy, killed_by)
    assert known(copy) == {HALF: 1}
    kept.put(copy, AREA, {TWICE: 0}, [])
    keep(copy, killed_by)
    assert known(copy) == {HALF: 1, TWICE: 0}


def test_the_test_that_killed_a_mutant_is_known_whatever_has_changed(copy):
    kept.put(copy, AREA, {HALF: 1, TWICE: 0}, [])
    keep(copy, {HALF: "tests/p/test_half.py::test"})
    (copy / "p/a.py").write_text("changed")
    assert kept.killers(copy / "kept/p.json") == {HALF: "tests/p/test_half.py::test"}
    assert known(copy) == {}


def test_results_of_mutants_that_are_gone_go_too(copy):
    store = copy / "kept/p.json"
    store.parent.mkdir()
    store.write_text(json.dumps({"mutants": {"p.a.x_gone__mutmut_1": ["base", 1, None, 0]}, "states": [{}]}))
    keep(copy)
    assert list(kept.read(store)[0]) == [HALF]


def test_results_that_are_taken_leave_the_others(copy):
    kept.take(copy, AREA, {TWICE: 36})
    assert kept.exit_codes(copy / "mutants/p/a.py.meta") == {HALF: 1, TWICE: 36}


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
