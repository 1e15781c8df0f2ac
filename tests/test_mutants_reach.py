"""The map from functions to tests that the mutation tester keeps: what a changed file of tests costs."""

from __future__ import annotations

import json

import pytest

from tests.mutants.reach import MAP, forget_what_changed, resting_on

TEXTS = {
    "tests/p/conftest.py": "from tests.p.helper import made\n",
    "tests/p/helper.py": "made = 1\n",
    "tests/p/test_a.py": "def test_a():\n    pass\n",
    "tests/p/test_b.py": "from tests.p.test_a import test_a\n",
    "tests/p/test_c.py": "from tests.p import test_b\n",
    "tests/p/test_d.py": "from tests.p.test_a_more import x  # not test_a, nor a helper\n",
    "tests/q/test_e.py": "import tests.q.test_f\n",
    "tests/q/test_f.py": "",
}
TESTS = ["tests/p", "tests/q/test_e.py", "tests/q/test_f.py"]


@pytest.fixture
def copy(tmp_path):
    """A copy of a checkout whose map knows one test of each file, after a run."""
    for name, text in TEXTS.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    forget_what_changed(tmp_path, TESTS)
    every = [f"{name}::test_it[x::y]" for name in TEXTS if "test_" in name]
    text = {"tests_by_mangled_function_name": {"p.a.x_f": every, "p.a.x_g": every[:1]}, "other": 3,
            "duration_by_test": dict.fromkeys(every, 0.1)}  # fmt: skip
    (tmp_path / MAP).write_text(json.dumps(text))
    return tmp_path


def known(copy):
    found = json.loads((copy / MAP).read_text())
    tests = [test.partition("::")[0].rpartition("/")[2][5:-3] for test in found["duration_by_test"]]
    assert found["other"] == 3
    assert [test.partition("::")[0].rpartition("/")[2][5:-3] for test in
            found["tests_by_mangled_function_name"]["p.a.x_f"]] == tests  # fmt: skip
    return "".join(tests)


@pytest.mark.parametrize(
    ("changed", "stays"),
    [("p/test_a", "def"), ("p/test_b", "adef"), ("p/test_c", "abdef"), ("p/test_d", "abcef"), ("q/test_f", "abcd"),
     ("q/test_e", "abcdf"), ("p/helper", "ef"), ("p/conftest", "ef")],
)  # fmt: skip
def test_only_tests_that_rest_on_a_changed_file_are_learned_anew(copy, changed, stays):
    path = copy / f"tests/{changed}.py"
    path.write_text(path.read_text() + "# changed\n")
    forget_what_changed(copy, TESTS)
    assert known(copy) == stays
    forget_what_changed(copy, TESTS)
    assert known(copy) == stays


def test_a_file_that_came_costs_nothing_and_one_that_went_its_tests(copy):
    (copy / "tests/p/test_new.py").write_text("from tests.p.test_a import test_a\n")
    forget_what_changed(copy, TESTS)
    assert known(copy) == "abcdef"
    (copy / "tests/p/test_c.py").unlink()
    forget_what_changed(copy, TESTS)
    assert known(copy) == "abdef"


def test_a_map_whose_files_are_unknown_is_learned_anew(copy):
    (copy / "mutants/tests.json").unlink()
    forget_what_changed(copy, TESTS)
    assert not (copy / MAP).exists()
    forget_what_changed(copy, TESTS)


def test_files_rest_on_what_they_import_through_others():
    assert resting_on({"tests/p/test_a.py"}, TEXTS) == {f"tests/p/test_{letter}.py" for letter in "abc"}
    assert resting_on({"tests/q/test_f.py"}, TEXTS) == {"tests/q/test_e.py", "tests/q/test_f.py"}
    assert resting_on(set(), TEXTS) == set()
