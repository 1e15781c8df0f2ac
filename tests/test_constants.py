"""Constants and defaults: each is defined once, and none is without a comment, which states unit and origin."""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.repository import MODULES, PACKAGES, ROOT, name_of, tree_of

# Workers run in other simulators' Pythons, which lack our packages, so they repeat constants.
OF_WORKERS = {"BLIND_AIR", "BOB_STIFFNESS", "SKIN_FRICTION", "SLIDES", "THICKNESS"}


@functools.cache
def constants() -> dict[str, list[tuple[Path, object]]]:
    """The upper-case names that modules define, each with the modules and the values, or else the code of the value."""
    found: dict[str, list[tuple[Path, object]]] = {}
    for path in MODULES:
        for node in tree_of(path).body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            for target in targets:
                named = target.elts if isinstance(target, ast.Tuple) else [target]
                whole = getattr(node, "value", None)
                is_each = isinstance(target, ast.Tuple) and isinstance(whole, ast.Tuple)
                values = whole.elts if is_each else [whole] * len(named)
                for name, value in zip(named, values, strict=True):
                    if isinstance(name, ast.Name) and name.id.isupper():
                        found.setdefault(name.id, []).append((path, value_of(value)))
    return found


def value_of(node: ast.expr) -> object:
    """The value of a literal, else its code."""
    try:
        return ast.literal_eval(node)
    except ValueError:
        return ast.unparse(node)


def test_no_two_modules_of_a_room_define_one_constant() -> None:
    """A reader of the name in one module could not tell which value is meant."""
    for name, places in constants().items():
        rooms_of = [path.parent for path, _ in places]
        assert len(rooms_of) == len(set(rooms_of)), (name, [name_of(path) for path, _ in places])


def test_a_constant_of_a_package_is_defined_once() -> None:
    """The same value under the same name is a copy."""
    copies = set()
    for name, places in constants().items():
        seen = [(path.relative_to(ROOT).parts[0], repr(value)) for path, value in places]
        copies |= {name} if len(seen) != len(set(seen)) else set()
    assert copies == OF_WORKERS


# Names that a package may give two values, each with its reason.
OF_TWO_VALUES = {("capture", "LOG"): "two processes write, each under its own name: `hangtime` and `hangtime.sync`"}


def test_a_constant_has_one_value_within_a_package() -> None:
    """A name that means the same in every room is read without a look at its import."""
    values: dict[tuple[str, str], set[str]] = {}
    for name, places in constants().items():
        for path, value in places:
            values.setdefault((path.relative_to(ROOT).parts[0], name), set()).add(repr(value))
    assert {place for place, found in values.items() if len(found) > 1} == set(OF_TWO_VALUES)


def test_a_constant_is_defined_in_one_package() -> None:
    """A reader of two packages could not tell which value is meant; one meaning is imported, and two have two names."""
    packages = {name: {path.relative_to(ROOT).parts[0] for path, _ in places} for name, places in constants().items()}
    assert len(packages) > 500
    assert {name: sorted(found) for name, found in packages.items() if len(found) > 1} == {}


def test_each_array_type_is_named_in_one_module() -> None:
    named = {
        ast.unparse(node.value)
        for node in tree_of(ROOT / "formats/arrays.py").body
        if isinstance(node, ast.Assign) and node.value is not None
    }
    assert len(named) == 7
    spelt = [
        f"{name_of(path)}:{node.lineno} {ast.unparse(node)}"
        for path in [*MODULES, *sorted((ROOT / "benchmarks").glob("*.py"))]
        if name_of(path) != "formats/arrays.py"
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Subscript) and ast.unparse(node) in named
    ]
    assert spelt == []


# --- comments -----------------------------------------------------------------------------------

Number = tuple[str, ast.expr, ast.AST]  # its name, its code, and the statement or parameter that holds it


def is_numbers(node: ast.expr | None) -> bool:
    """Return whether code holds numbers alone: literals, arithmetic, tuples, and calls of NumPy or `float`."""
    inside = list(ast.walk(node)) if node is not None else []
    literals = [one.value for one in inside if isinstance(one, ast.Constant)]
    calls = [ast.unparse(one.func) for one in inside if isinstance(one, ast.Call)]
    is_plain = all(type(value) in {int, float} for value in literals)
    return bool(literals) and is_plain and all(call == "float" or call.startswith("np.") for call in calls)


def is_chosen(node: ast.expr | None, neutral: set[object]) -> bool:
    """Return whether a default is a number that somebody chose: not neutral, and no tuple of zeros and ones."""
    if node is None or isinstance(node, ast.Lambda) or not is_numbers(node):
        return False
    value = value_of(node)
    if isinstance(value, tuple):
        return not set(flat(value)) <= {0, 1}
    return (type(value), value) not in neutral


def flat(value: tuple[object, ...]) -> Iterator[object]:
    for one in value:
        yield from flat(one) if isinstance(one, tuple) else (one,)


# Of a field, 1.0 is a factor that somebody chose; of a parameter, 1.0 is the factor that changes nothing.
OFF = {(int, 0), (float, 0.0), (int, 1)}
NEUTRAL = {*OFF, (float, 1.0)}


def of_module(tree: ast.Module) -> Iterator[Number]:
    """The upper-case numbers of a module."""
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and is_numbers(node.value):
            name = ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target)
            if name.isupper():
                yield name, node.value, node


def of_fields(tree: ast.Module) -> Iterator[Number]:
    """The chosen defaults of the fields of its classes: dataclasses, structs, named tuples, effects."""
    for owner in ast.walk(tree):
        for node in owner.body if isinstance(owner, ast.ClassDef) else ():
            if isinstance(node, ast.AnnAssign) and is_chosen(value := default_of(node.value), OFF):
                yield f"{owner.name}.{ast.unparse(node.target)}", value, node


def default_of(node: ast.expr | None) -> ast.expr | None:
    """Return the default within a call of `field`."""
    if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("field"):
        return next((word.value for word in node.keywords if word.arg == "default"), None)
    return node


def of_parameters(tree: ast.Module) -> Iterator[Number]:
    """The chosen defaults of the parameters of its functions."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            known = function.args
            every = [*known.posonlyargs, *known.args]
            pairs = list(zip(every[len(every) - len(known.defaults) :], known.defaults, strict=True))
            for name, value in [*pairs, *zip(known.kwonlyargs, known.kw_defaults, strict=True)]:
                if is_chosen(value, NEUTRAL):
                    yield f"{function.name}({name.arg})", value, name


COMMENT = re.compile(r"  # (?!fmt|noqa|type)")


def bare(source: str) -> list[str]:
    """Return the numbers of a module that have no comment on their lines or on the line above."""
    lines, tree = source.splitlines(), ast.parse(source)
    return [
        name
        for name, value, place in [*of_module(tree), *of_fields(tree), *of_parameters(tree)]
        if not lines[max(place.lineno - 2, 0)].lstrip().startswith("# ")
        and not any(COMMENT.search(line) for line in lines[place.lineno - 1 : value.end_lineno])
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_number_of_a_package_has_a_comment(package: str) -> None:
    modules = [path for path in MODULES if path.is_relative_to(ROOT / package)]
    assert modules
    assert [f"{name_of(path)}: {name}" for path in modules for name in bare(path.read_text())] == []


# Whole comments that name a unit and no reason.
UNITS_ALONE = {
    "m",
    "mm",
    "m/s",
    "s",
    "1/s",
    "Hz",
    "px",
    "rad",
    "N",
    "N/m",
    "kg",
    "1",
    "bytes",
    "bits",
    "steps",
    "frames",
}
UNITS_ALONE |= {"RGB", "per cent", "characters", "points", "degrees"}


def units_alone(source: str) -> list[str]:
    """Return the numbers of a module whose comment is a unit alone, and that no line above explains."""
    lines, tree = source.splitlines(), ast.parse(source)
    return [
        name
        for name, value, place in [*of_module(tree), *of_fields(tree), *of_parameters(tree)]
        if lines[value.end_lineno - 1].rpartition("  # ")[2] in UNITS_ALONE
        and not lines[max(place.lineno - 2, 0)].lstrip().startswith("# ")
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_number_of_a_module_states_a_unit_alone(package: str) -> None:
    modules = [path for path in MODULES if path.is_relative_to(ROOT / package)]
    found = [f"{name_of(path)}: {name}" for path in modules for name in units_alone(path.read_text())]
    assert found == []


def test_a_unit_alone_is_found() -> None:
    source = "LONG = 2.0  # m\nSHORT = 1.0  # m, a step\n# Why.\nWIDE = 3  # px\nRED, BLUE = 1, (\n    2,\n)  # RGB\n"
    assert units_alone(source) == ["LONG", "(RED, BLUE)"]


BARE_CHOICE = re.compile(r"(?i:#.*our choice)(?!: |,? (?:as|because|since|so that) )|(?i:stated by us)")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_choice_of_a_package_has_a_reason(package: str) -> None:
    """The words "our choice" stand before a reason; other words for it would escape this test."""
    found = [
        f"{name_of(path)}: {line.strip()}"
        for path in MODULES
        if path.is_relative_to(ROOT / package)
        for line in path.read_text().splitlines()
        if BARE_CHOICE.search(line)
    ]
    assert found == []


def test_a_choice_without_a_reason_is_found() -> None:
    for said in ("our choice", "Our choice.", "m; our choice, 3 px", "m: stated by us", "stated by us: few"):
        assert BARE_CHOICE.search(f"LONG = 2.0  # {said}")
    for said in ("our choice: as wide as a hand", "our choice, so that it fits", "Our choice because others differ"):
        assert not BARE_CHOICE.search(f"LONG = 2.0  # {said}")


def test_a_number_is_bare_without_a_comment_of_its_own() -> None:
    source = "# m\nLONG = 2.0\nNEAR, FAR = -1.0, 1 / 3\nSHORT = 1.0  # m\nRIM = np.ones(3)\nNAME = 'x'\nIS_ON = True\n"
    assert bare(source) == ["(NEAR, FAR)", "RIM"]


def test_a_default_is_bare_without_a_comment_unless_it_switches_something_off() -> None:
    source = """
class Settings:
    width: float = 2.0
    ends: tuple[float, float] = (0.0, 0.5)
    share: float = 1.0
    # Our choice.
    depth: float = field(default=3.0)
    most: Annotated[
        int, Meta(ge=3)
    ] = 12  # our choice
    lift: float = 0.0
    seed: int = 1
    axes: tuple[int, int] = (0, 1)


def draw(size=2.0, scale=1.0, *, digits: int = 3, seed: int = 0):
    ...


def show(
    size=2.0,  # m
    *, height=3.0,
):  # fmt: skip
    ...
"""
    fields = ["Settings.width", "Settings.ends", "Settings.share"]
    assert bare(source) == [*fields, "draw(size)", "draw(digits)", "show(height)"]
