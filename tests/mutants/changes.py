"""What each mutant changes, read from the lines of mutmut's files without parsing them."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence
from difflib import unified_diff
from pathlib import Path

HEAD = 2  # lines of a diff that name its files


def named(mutant: str) -> tuple[str, str]:
    """Return the module of a mutant and the name of its function, by mutmut's name for it."""
    module, _, mangled = mutant.rsplit("__mutmut_", 1)[0].rpartition(".")
    return module, mangled[2:].replace("ǁ", ".")


class Functions:
    """The functions of one module and their mutants, by the file of mutmut that holds them all."""

    def __init__(self, mutated: Path) -> None:
        self.lines = mutated.read_text().split("\n")
        self.spans = json.loads(mutated.with_name(f"{mutated.name}.spans").read_text())["spans"]

    def source(self, mutant: str) -> str:
        """Return a mutant's function under its own name."""
        return self._source(mutant, mutant.rpartition(".")[2])

    def original(self, mutant: str) -> str:
        """Return the function that a mutant changes."""
        return self._source(mutant, f"{mutant.rpartition('.')[2].rsplit('__mutmut_', 1)[0]}__mutmut_orig")

    def _source(self, mutant: str, mangled: str) -> str:
        begin, end = self.spans[mangled]
        function = named(mutant)[1].rpartition(".")[2]
        return textwrap.dedent("\n".join(self.lines[begin - 1 : end])).replace(mangled, function, 1).strip()

    def diff(self, mutant: str) -> list[str]:
        """Return the lines of the diff from the function to the mutant."""
        both = (self.original(mutant).split("\n"), self.source(mutant).split("\n"))
        return list(unified_diff(*both, lineterm=""))[HEAD:]


def change_of(diff: Sequence[str]) -> str:
    """Return a diff as an entry of `survivors.toml` has it: the removed and the added lines, without indentation."""
    return "\n".join(f"{line[0]} {line[1:].strip()}" for line in diff if line[:1] in "+-" and line.strip())


def is_wording(lines: Sequence[str]) -> bool:
    """Whether a change, the lines of a diff, only puts XX about a sentence, or turns its case.

    Tests of a sentence ask for its gist, and not for its capitals. A text without a space is a name, which counts.
    """
    removed, added = ("\n".join(line[1:] for line in lines if line[:1] == sign) for sign in "-+")
    if removed == added or removed.lower() != added.replace("XX", "").lower():
        return False
    changed = [a for a, b in zip(removed.split('"'), added.split('"'), strict=True) if a != b]
    return bool(changed) and all(" " in text.strip() for text in changed)
