"""The mutation tester's rules: which changes count, and which survivors are accepted."""

from __future__ import annotations

import ast
import json
import tomllib
from pathlib import Path

import pytest

from tests.mutants.__main__ import SURVIVORS, is_listed
from tests.mutants.changes import Functions, change_of, is_wording, named
from tests.mutants.types import Change, refused


@pytest.mark.parametrize(
    ("lines", "is_only_wording"),
    [
        (['-  advice="move it inside"', '+  advice="MOVE IT INSIDE"'], True),
        (['-  f("the {x} is odd, so")', '+  f("XXthe {x} is odd, soXX")'], True),
        (['-  "radius_m",', '+  "XXradius_mXX",'], False),
        (['-  where="annealing", advice="move it"', '+  where="ANNEALING", advice="move it"'], False),
        (['-  advice="move it"', "+  advice=None"], False),
        (["-  a < b", "+  a <= b"], False),
        (["-  a = 1", "+  a = 1"], False),
    ],
)
def test_only_a_sentence_in_other_letters_is_no_mutant_that_counts(lines, is_only_wording):
    assert is_wording(lines) is is_only_wording


def zipped(rest):
    return f"for a, b in zip(own, other{rest}):"


@pytest.mark.parametrize(
    ("function", "removed", "added", "may_live"),
    [
        ("fit.gap.gates.of", zipped(", strict=True"), zipped(", "), True),
        ("fit.gap.gates.of", zipped(", strict=True"), zipped(", strict=False"), True),
        ("fit.gap.gates.of", zipped(", strict=True"), zipped(", strict=None"), True),
        ("fit.gap.gates.of", zipped(", strict=True"), "for a, b in zip(own, strict=True):", False),
        ("capture.hanger.pose.of", zipped(", strict=True"), zipped(", strict=False"), True),
        ("capture.recording.session.of", zipped(", strict=True"), zipped(", strict=False"), False),
        ("formats.blocks.of", zipped(", strict=True"), zipped(", "), True),
        ("firmware_host.camera.of", zipped(", strict=True"), zipped(", "), False),
        ("formats.blocks.of", "f'{1e3 * apart:.0f} mm'", "f'{1001.0 * apart:.0f} mm'", True),
        ("formats.blocks.of", "rest.astype(float)", "rest.astype(None)", True),
        ("formats.blocks.of", "rest.astype(int)", "rest.astype(None)", False),
        ("formats.blocks.of", "np.array(rest, float)", "np.array(rest, None)", False),
        ("formats.blocks.of", "rest.astype(np.float64)", "rest.astype(None)", True),
        ("formats.blocks.of", "rest.astype(np.float32)", "rest.astype(None)", False),
        ("capture.hanger.pose.of", "places[wrong] = np.nan", "places[wrong] = None", True),
        ("capture.hanger.pose.of", "places = np.nan", "places = None", False),
        ("capture.hanger.pose.of", 'float("nan")', 'float("NAN")', True),
        ("capture.hanger.pose.of", 'float("nan")', 'float("XXnanXX")', False),
        (
            "capture.garment.a.of",
            "cv2.connectedComponentsWithStats(mask, connectivity=8)",
            "cv2.connectedComponentsWithStats(mask, )",
            True,
        ),
        (
            "capture.garment.a.of",
            "cv2.connectedComponentsWithStats(mask, connectivity=4)",
            "cv2.connectedComponentsWithStats(mask, connectivity=None)",
            False,
        ),
        (
            "capture.garment.a.of",
            "cv2.erode(mask, CORE, borderType=cv2.BORDER_CONSTANT, borderValue=0)",
            "cv2.erode(mask, CORE, borderType=None, borderValue=0)",
            True,
        ),
        (
            "capture.garment.a.of",
            "cv2.erode(mask, CORE, borderType=cv2.BORDER_CONSTANT, borderValue=0)",
            "cv2.erode(mask, CORE, borderType=cv2.BORDER_CONSTANT, )",
            False,
        ),
        (
            "capture.garment.a.of",
            "cv2.blur(mask, (3, 3), borderType=cv2.BORDER_CONSTANT)",
            "cv2.blur(mask, (3, 3), borderType=None)",
            False,
        ),
        ("fit.gap.gates.of", "f'{1e3 * apart:.0f} mm'", "f'{1001.0 * apart:.0f} mm'", True),
        ("fit.gap.gates.of", "f'{1e3 * apart:.3f} mm'", "f'{1001.0 * apart:.3f} mm'", False),
        ("fit.gap.gates.of", "f'{1e3 * apart:.0f} mm'", "f'{1e3 * other:.0f} mm'", False),
        ("fit.gap.gates.of", "1e3 * apart", "1001.0 * apart", False),
        ("fit.gap.gates.of", "a.reshape(len(a), -1) + 1", "a.reshape(len(a), -2) + 1", True),
        ("fit.gap.gates.of", "a.reshape(len(a), -1) + 1", "a.reshape(len(a), +1) + 1", False),
        ("fit.gap.gates.of", "a.reshape(len(a), -1)", "a.reshape(len(b), -1)", False),
        ("fit.gap.gates.of", "a.reshape(len(a), -1).sum(-1)", "a.reshape(len(a), -1).sum(-2)", False),
    ],
)
def test_a_rule_lists_the_changes_of_its_kind_and_no_other(function, removed, added, may_live):
    assert is_listed(SURVIVORS.read_text())(function, f"- {removed}\n+ {added}") is may_live


@pytest.mark.parametrize(
    ("mutant", "module", "function"),
    [
        ("formats.rows.x__max_of__mutmut_12", "formats.rows", "_max_of"),
        ("fit.gap.a.xǁIndex_ǁx_of__mutmut_1", "fit.gap.a", "Index_.x_of"),
    ],
)
def test_a_mutant_has_the_name_of_its_function(mutant, module, function):
    assert named(mutant) == (module, function)


MUTATED = """class Of:
    def xǁOfǁtwice__mutmut_orig(self, x):
        \"\"\"Return twice.\"\"\"
        if x:
            return 2 * x
        return 0
    def xǁOfǁtwice__mutmut_1(self, x):
        \"\"\"Return twice.\"\"\"
        if x:
            return 3 * x
        return 0
"""


def test_a_change_is_read_from_the_lines_of_both_functions(tmp_path):
    """The lines of a method lose the indentation of their class, and mutmut's name gives way to the function's."""
    (tmp_path / "a.py").write_text(MUTATED)
    spans = {"xǁOfǁtwice__mutmut_orig": [2, 6], "xǁOfǁtwice__mutmut_1": [7, 11]}
    (tmp_path / "a.py.spans").write_text(json.dumps({"spans": spans}))
    mutant, functions = "p.a.xǁOfǁtwice__mutmut_1", Functions(tmp_path / "a.py")
    whole = 'def twice(self, x):\n    """Return twice."""\n    if x:\n        return {} * x\n    return 0'
    assert functions.original(mutant) == whole.format(2)
    assert functions.source(mutant) == whole.format(3)
    assert change_of(functions.diff(mutant)) == "- return 2 * x\n+ return 3 * x"


MODULE = """import functools


@functools.cache
def half(x: float) -> float:
    return x / 2


class Of:
    @property
    def one(self) -> float:
        return half(1.0)


def two() -> str:
    return "a"
"""


def test_the_type_check_refuses_changes_in_the_function_of_its_error(tmp_path):
    """Two changes of one function need two rounds; the other functions stay as they were."""
    (tmp_path / "p").mkdir()
    (tmp_path / "p/__init__.py").touch()
    (tmp_path / "p/a.py").write_text(MODULE)
    (tmp_path / "pyproject.toml").write_text("[tool.mypy]\nstrict = true\n")
    changes = [
        ("half", "def half(x: float) -> float:\n    return x / None\n"),
        ("half", "def half(x: float) -> float:\n    return x / 3\n"),
        ("Of.one", "    @property\n    def one(self) -> float:\n\n        return None\n"),
        ("Of.one", "    def one(self) -> float:\n        return half(2.0)\n"),
        ("two", 'def two() -> str:\n    return "b"\n'),
        ("half", "def half(x: float) -> float:\n    return None\n"),
    ]
    found = refused(tmp_path, [Change("p/a.py", function, text) for function, text in changes])
    assert found == [True, False, True, False, False, True]
    assert (tmp_path / "p/a.py").read_text() == MODULE


def test_an_entry_lists_one_change_of_one_function():
    listed = is_listed('[[survivor]]\nfunction = "a.b"\nchange = """\n- x\n+ y\n"""\nreason = "equivalent"\n')
    assert listed("a.b", "- x\n+ y")
    assert not listed("a.c", "- x\n+ y")
    assert not listed("a.b", "- x\n+ z")


ROOT = Path(__file__).parents[1]


def lines_of(function: str) -> set[str]:
    """The lines of a function, or of a method, by its whole name; none where there is no such function."""
    names = function.split(".")
    depth = next((n for n in range(len(names), 0, -1) if ROOT.joinpath(*names[:n]).with_suffix(".py").exists()), 0)
    if not depth:
        return set()
    text = ROOT.joinpath(*names[:depth]).with_suffix(".py").read_text()
    node: ast.AST = ast.parse(text)
    for name in names[depth:]:
        below = (n for n in ast.iter_child_nodes(node) if getattr(n, "name", None) == name)
        if (found := next(below, None)) is None:
            return set()
        node = found
    assert isinstance(node, ast.FunctionDef)
    return {line.strip() for line in text.splitlines()[node.lineno - 1 : node.end_lineno]}


def stale_entries(text: str) -> list[str]:
    """The entries whose removed lines are not in the function that they name."""
    return [
        f"{one['function']}: {line}"
        for one in tomllib.loads(text)["survivor"]
        for line in one["change"].strip().splitlines()
        if line.startswith("-") and line[1:].strip() not in lines_of(one["function"])
    ]


def test_every_listed_survivor_changes_a_line_that_is_there():
    assert stale_entries(SURVIVORS.read_text()) == []


@pytest.mark.parametrize(
    "function", ["fit.search.bounds.redrawn", "fit.search.intervals.jackknife", "fit.bounds.redraw", "fits.redraw"]
)
def test_an_entry_of_a_line_that_moved_or_nowhere_is_stale(function):
    line = "return np.clip(centre + spread * np.tan(np.pi * (below + uniform * (above - below))), low, high)"
    entry = '[[survivor]]\nfunction = "{}"\nchange = """\n- {}\n+ pass\n"""\nreason = "equivalent"\n'
    assert stale_entries(entry.format("fit.search.bounds.redraw", line)) == []
    assert stale_entries(entry.format(function, line)) == [f"{function}: - {line}"]
