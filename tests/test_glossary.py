"""The glossary: each term once and in order, and every term of the report."""

from __future__ import annotations

import ast
import re

from fit.report.page import SECTIONS
from fit.report.terms import OF_A_DIAGNOSIS, OF_PARAMETERS
from tests.repository import ROOT, tree_of

TERMS = re.findall(r"^(\S.*)\n: ", (ROOT / "docs/reference/glossary.md").read_text(), re.MULTILINE)
TERM = re.compile(r"\b(" + "|".join(re.escape(one).replace(r"\-", "[- ]") for one in TERMS) + r")s?\b")
# Titles and names of the report in everyday words alone.
PLAIN = {
    "after, mm", "along the cloth's normal", "at which frequency",
    "before", "before, mm", "by", "camera", "cost", "cost and notes", "diagnosis", "down by", "error over time",
    "errors as mean distances", "errors before and after", "fit", "fitted", "fitted parameters",
    "from minimum to maximum", "grows with speed to the power of", "held where its edge was tracked",
    "how to read this", "in which direction",
    "initial", "keeps its sign (stores energy, or is constant)", "manual", "manual against optimised", "mean distance",
    "meaning",
    "motion", "on the cloth", "optimised", "origin", "parameter", "parameters", "place", "play",
    "real against simulated motion", "record next", "size", "tells apart", "the cloth as the camera saw it",
    "the next recording", "the sensor's noise alone", "when in the motion", "where", "where this page comes from",
}  # fmt: skip


def constants_of(*nodes: ast.expr) -> set[str]:
    return {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def names_of_the_report() -> set[str]:
    """Titles, heads of tables, names of figures, explained terms and buttons, in small letters."""
    found = {name for _, *both in SECTIONS for name in both} | set(OF_A_DIAGNOSIS) | set(OF_PARAMETERS)
    for module in (ROOT / "fit/report").glob("*.py"):
        for node in ast.walk(tree_of(module)):
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "heads":
                found |= constants_of(*getattr(node.value, "elts", []))
            elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "figures":
                tuples = [one for one in getattr(node.value, "elts", []) if isinstance(one, ast.Tuple)]
                found |= constants_of(*(one.elts[0] for one in tuples))
            elif isinstance(node, ast.Call) and ast.unparse(node.func) in {"headed", "where_bars"}:
                found |= constants_of(node.args[0])
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == "figures.append":
                found |= constants_of(*getattr(node.args[0], "elts", [])[:1])
    for template in (ROOT / "fit/report/templates").glob("*.html"):
        found |= set(re.findall(r"<button[^>]*>(\w[^<{]+)<", template.read_text()))
    return {name.lower() for name in found}


def test_each_term_stands_once_and_in_the_order_of_the_alphabet() -> None:
    assert len(TERMS) > 80
    assert sorted(set(TERMS), key=lambda term: term.replace("-", " ").lower()) == TERMS


def stages_of_a_diagnosis() -> set[str]:
    """The texts with which the modules of a diagnosis report their progress; {} for each inserted value."""
    found = set()
    for module in (ROOT / "fit/gap").glob("*.py"):
        for node in ast.walk(tree_of(module)):
            if not isinstance(node, ast.Call) or not node.args:
                continue
            if ast.unparse(node.func).rpartition(".")[2] not in {"progress", "tell"}:
                continue
            match node.args[0]:
                case ast.Constant(value=str(text)):
                    found.add(text)
                case ast.JoinedStr(values=parts):
                    found.add("".join(str(one.value) if isinstance(one, ast.Constant) else "{}" for one in parts))
    return found


def test_every_stage_of_a_diagnosis_that_is_not_in_everyday_words_holds_a_term_of_the_glossary() -> None:
    stages = stages_of_a_diagnosis()
    assert {"estimating the noise floor", "base fit from {} candidates {}", "done"} <= stages
    assert {stage for stage in stages if not TERM.search(stage)} == {"choosing the next recording", "done"}


def test_every_name_of_the_report_that_is_no_everyday_word_holds_a_term_of_the_glossary() -> None:
    names = names_of_the_report()
    assert {"the gap", "worst frame", "p-value", "part of the objective", "base model misses by"} <= names
    assert {name for name in names if not TERM.search(name)} == PLAIN


def test_the_program_calls_a_parameter_at_its_bound_by_the_term_of_the_glossary_alone() -> None:
    other = re.compile(
        r"(stopped|held|limited) (by|at) (its|their|the|a) bounds?\b|ends? at (the|its|their|a) bounds?\b"
    )
    found = []
    for package in ("fit", "formats"):
        for module in (ROOT / package).rglob("*.py"):
            found += [
                f"{module.name}: {node.value}"
                for node in ast.walk(tree_of(module))
                if isinstance(node, ast.Constant) and isinstance(node.value, str) and other.search(node.value)
            ]
    assert found == []


# Technical words of the sentences that `hangtime fit` and `hangtime diagnose` print, by their terms.
PRINTED = {
    "rms": "rms", "lean": "lean", "askew": "skewed grid", "stamps": "stamp", "silhouette": "silhouette",
    "held row": "held row", "held edge": "held edge", "material position": "material point",
    "trivial predictor": "trivial predictor", "at its bound": "at its bound",
}  # fmt: skip


def test_technical_words_that_a_fit_and_a_diagnosis_print_are_in_the_glossary() -> None:
    modules = ("fit/recordings/camera_findings.py", "fit/identification/trivial.py", "formats/fit_records.py")
    printed = " ".join(
        node.value
        for module in modules
        for node in ast.walk(tree_of(ROOT / module))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
    assert [word for word in PRINTED if word not in printed] == []
    assert [term for term in PRINTED.values() if term not in TERMS] == []
