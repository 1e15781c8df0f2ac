"""Messages, notes, help texts, verdicts and the report's templates follow the rules of text in CONTRIBUTING.md.

Every string of the program that is no docstring is measured, except for markup and programs of several lines. A value
that is filled in counts as one word.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from tests.repository import PACKAGES, ROOT, tree_of
from tests.sentences import faults_of

MARKUP = re.compile(r"\n.*(?:<\w|import )")  # in lines behind the first: a template or a program
DEFINITION = re.compile(r"(?<=\.) (?=[a-z][\w-]*(?:, [a-z][\w-]*)*: )")  # "own: ours. blender: Blender's."


def strings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Return strings other than docstrings, with their lines; a formatted value becomes one word."""
    passed: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):  # a docstring
            passed.add(id(node.value))
        if isinstance(node, ast.JoinedStr):
            passed |= {id(part) for part in node.values}
            yield (
                node.lineno,
                "".join(str(part.value) if isinstance(part, ast.Constant) else "Value" for part in node.values),
            )
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in passed:
            yield node.lineno, node.value


def texts_of_template(source: str) -> Iterator[tuple[int, str]]:
    """Texts of a template without its tags, and texts that a screen reader speaks."""
    spoken = re.findall(r'aria-label="([^"]*)"', source)
    plain = re.sub(r"(?s)\{%.*?%\}|\{#.*?#\}|<(?:script|style).*?</(?:script|style)>", "", source)
    for text in (*spoken, *re.split(r"<[^>]*>", plain)):
        yield 0, " ".join(re.sub(r"\{\{.*?\}\}", "Value", text).split())


def faults_shown(texts: Iterator[tuple[int, str]]) -> list[str]:
    """Lines and beginnings of the sentences that break a rule, in texts that are no markup.

    An error's words begin behind its place, in lower case, and may not begin with a "what" clause either.
    """
    plain = [(line, DEFINITION.sub("\n\n", text)) for line, text in texts if not MARKUP.search(text)]
    clauses = [f"line {line}, a clause: {text[:60]}" for line, text in plain if re.match(r"what(?:ever)? \S", text)]
    return faults_of(plain) + clauses


@pytest.mark.parametrize("package", PACKAGES)
def test_no_sentence_that_the_program_shows_is_long_or_has_a_clause_as_its_subject(package: str) -> None:
    found = []
    for path in sorted((ROOT / package).rglob("*.py")):
        found += [f"{path.relative_to(ROOT)}: {fault}" for fault in faults_shown(strings(tree_of(path)))]
    for path in sorted([*(ROOT / package).rglob("*.html"), *(ROOT / package).rglob("*.j2")]):
        found += [f"{path.relative_to(ROOT)}: {fault}" for fault in faults_shown(texts_of_template(path.read_text()))]
    assert found == []


def test_the_appliances_process_has_the_name_recorder_in_messages_and_pages() -> None:
    """`hangtime daemon` stays the command's name."""
    texts = [
        (path, text) for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))
        for _, text in strings(tree_of(path)) if " " in text
    ]  # fmt: skip
    pages = [
        page for kind in ("tutorial", "how-to", "reference", "explanation") for page in ROOT.glob(f"docs/{kind}/*")
    ]
    texts += [(page, page.read_text()) for page in [*pages, ROOT / "README.md"]]
    names = re.compile(r"hangtime daemon|daemon-reload")
    found = [path.relative_to(ROOT) for path, text in texts if re.search(r"\bdaemons?\b", names.sub("", text))]
    assert len(texts) > 1000
    assert found == []


def test_a_long_message_a_clause_and_a_long_note_of_a_template_are_found() -> None:
    many = " ".join(["word"] * 23)
    source = (
        f'"""{many} {many}"""\nA = "What is cut."\nB = f"{many} {{A}} and" " on."\nC = "own: {many}. none: {many}."\n'
        f'D = "Go on; what is cut stays."\nG = "what was cut can be read"\nH = "what"\n'
        f'E = "{many}\\nto the end."\nF = "import re\\n{many} <p>{many}"\n'
    )
    assert faults_shown(strings(ast.parse(source))) == [
        "line 2, 3 words: What is cut.", f"line 3, 26 words: {many[:60]}",
        "line 5, 6 words: Go on; what is cut stays.", f"line 8, 26 words: {many[:60]}",
        "line 6, a clause: what was cut can be read",
    ]  # fmt: skip
    template = f'<p aria-label="{many} {{{{ a }}}} and on.">{{% if b %}}What is cut.{{% endif %}}</p>'
    assert [fault.split(":")[0] for fault in faults_shown(texts_of_template(template))] == [
        "line 0, 26 words", "line 0, 3 words",
    ]  # fmt: skip
