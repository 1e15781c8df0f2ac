"""Split prose into sentences and count their words, for the tests of the documentation and of docstrings."""

from __future__ import annotations

import re
from collections.abc import Iterable

LONGEST_SENTENCE = 25  # words (CONTRIBUTING.md, "Text")
END = re.compile(r"(?<=[.!?])[\"*)]*\s+(?=[A-Z\d`*(\[\"“])")
# Phrases that only this project's authors understood; the glossary has the field's words
PRIVATE_WORDS = re.compile(
    r"worn Jacobian|halt is believed|corner of the box|may be had|leaves? least of|\bis told of\b|are enough of"
    r"|no vote\b|tells? of by itself|told (?:by|that) (?:itself|so)|asks? for itself|without company",
    re.IGNORECASE,
)
CLAUSE = re.compile(
    r"^(?:\*\*)?(?:What|Whatever)\b|; (?:and )?what(?:ever)?\b|\bwhat (?:is|was) [\w-]+ (?:is|was|stays)\b"
)


def blocks_of(text: str) -> list[str]:
    """Return paragraphs, list items and table cells of a page; semicolons split a cell of figures."""
    text = re.sub(r"^```.*?^```|<!--.*?-->", "", text, flags=re.DOTALL | re.MULTILINE)
    blocks: list[str] = [""]
    for line in text.splitlines():
        if line.startswith("|"):
            blocks += [part for cell in re.split(r"(?<!\\)\|", line) for part in cell.split("; ")] + [""]
        elif not line.strip() or line.startswith("#"):
            blocks.append("")
        elif re.match(r"\s*(?:[-*]|\d+\.) ", line):
            blocks.append(re.sub(r"^\s*(?:[-*]|\d+\.) ", "", line))
        else:
            blocks[-1] += " " + line.strip()
    return [block.strip() for block in blocks if block.strip()]


def sentences_of(text: str) -> list[str]:
    """Return the sentences of a page; a piece of code and an equation count as one word each."""
    found = []
    for block in blocks_of(text):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"`[^`]*`|\$[^$]+\$", "Code", block))
        found += [sentence.strip() for sentence in END.split(plain)]
    return [sentence for sentence in found if re.search(r"[A-Za-z]{2}", sentence)]


def words_of(sentence: str) -> int:
    return sum(bool(re.search(r"\w", word)) for word in sentence.split())


def faults_of(texts: Iterable[tuple[int, str]]) -> list[str]:
    """Return line and beginning of every sentence that breaks a rule, from texts with their lines."""
    found = []
    for line, text in texts:
        for sentence in sentences_of(text):
            count = words_of(sentence)
            if count > LONGEST_SENTENCE or has_clause_as_subject(sentence) or PRIVATE_WORDS.search(sentence):
                found.append(f"line {line}, {count} words: {sentence[:60]}")
    return found


def has_clause_as_subject(sentence: str) -> bool:
    """Return whether a "what" clause begins a sentence or its second half; a question may begin so."""
    return bool(CLAUSE.search(sentence)) and not sentence.endswith("?")
