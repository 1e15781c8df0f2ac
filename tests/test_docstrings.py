"""Docstrings and comments follow the rules of text in CONTRIBUTING.md, as pages do."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from tests.repository import PACKAGES, ROOT, tree_of
from tests.sentences import faults_of

ROOMS = sorted(
    {
        str(path.parent.relative_to(ROOT))
        for package in (*PACKAGES, "benchmarks", "docs")
        for path in (ROOT / package).rglob("*.py")
    }
)
# `tokenize` finds the same comments and takes 2 s for all files.
STRING_OR_COMMENT = re.compile(r'''("""|\'{3})(?:\\.|.)*?\1|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|#[^\n]*''', re.DOTALL)
WITHOUT_PROSE = re.compile(r"(?: {4,}|.*\S {3,}\S|\s*\|)")  # an equation, a row of columns or of a table


def docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text:
                yield node.body[0].lineno, text
        waiting += (one for one in ast.iter_child_nodes(node) if not isinstance(one, ast.expr))  # they hold none


def comments(source: str) -> Iterator[tuple[int, str]]:
    """Lines of comments that follow each other are one text; a comment behind code is a text of its own."""
    lines: list[str] = []
    begin = end = at = 0
    row = 1
    for found in STRING_OR_COMMENT.finditer(source) if "#" in source else ():
        if found[0][0] != "#":
            continue
        row += source.count("\n", at, found.start())
        at = found.start()
        is_alone = not source[source.rfind("\n", 0, at) + 1 : at].strip()
        if not (lines and is_alone and row == end + 1):
            if lines:
                yield begin, "\n".join(lines)
            lines, begin = [], row
        lines.append(re.sub(r"^#\s?", "", found[0]))
        end = row if is_alone else 0
    if lines:
        yield begin, "\n".join(lines)


def prose_of(text: str) -> str:
    """A text without equations, tables and rows of columns."""
    return "\n".join("" if WITHOUT_PROSE.match(line) else line for line in text.splitlines())


def faults_written(source: str, tree: ast.Module) -> list[str]:
    """Lines and beginnings of the sentences of docstrings and comments that break a rule."""
    texts = (*docstrings(tree), *comments(source))
    return faults_of((line, prose_of(text)) for line, text in texts)


@pytest.mark.parametrize("room", ROOMS)
def test_no_sentence_of_docstrings_and_comments_is_long_or_has_a_clause_as_its_subject(room: str) -> None:
    files = sorted((ROOT / room).glob("*.py"))
    assert files
    assert [
        f"{path.name}: {fault}" for path in files for fault in faults_written(path.read_text(), tree_of(path))
    ] == []


@pytest.mark.parametrize("room", ROOMS)
def test_no_docstring_begins_by_naming_another_one(room: str) -> None:
    files = {path.name: docstrings(tree_of(path)) for path in (ROOT / room).glob("*.py")}
    found = [f"{name}:{line}" for name, texts in files.items() for line, text in texts if re.match(r"See `", text)]
    assert found == []


def test_a_long_docstring_a_long_comment_and_a_clause_are_found_and_an_equation_is_not() -> None:
    long = " ".join(["word"] * 26) + "."
    source = f'"""A module.\n\n{long}\n\n    {long}\n"""\nA = 1  # What is cut\n# {long[:65]}\n# {long[65:]}\n'
    source += f'if A:\n    def go():\n        """{long}"""\n'
    assert [fault.split(":")[0] for fault in faults_written(source, ast.parse(source))] == [
        "line 1, 26 words", "line 12, 26 words", "line 7, 3 words", "line 8, 26 words",
    ]  # fmt: skip
