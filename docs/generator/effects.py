"""The reference of the effects, as Markdown, from the docstrings and constants of their modules."""

from __future__ import annotations

import inspect
import re
import sys
import textwrap

from docs.generator.equations import GREEK, to_tex
from fit.effects import LIBRARY

GROUPS = {
    "cloth": "The cloth",
    "boundary": "The boundary: hanger, clips and held edge",
    "air": "The air",
    "measurement": "The measurement",
}

SYMBOL = re.compile(
    rf"(?<![\w.^/])(?:{'|'.join(sorted(GREEK))}|[A-Za-z]{{1,5}}_[A-Za-z0-9]+|[A-Za-z]\^\d)(?![\w(+^/-])"
)


def effects_page() -> str:
    """Return a section for every effect of the library, grouped by the thing that it acts on."""
    parts = []
    for group, title in GROUPS.items():
        parts.append(f"## {title}\n")
        parts += [_section(effect) for effect in LIBRARY if effect.acts_on == group]
    return "\n".join(parts)


def _section(effect) -> str:
    module = sys.modules[type(effect).__module__]
    text = inspect.cleandoc(module.__doc__ or "")
    components = ", ".join(f"`{name}`" for name in effect.components if name) or "one"
    facts = {
        "in sentences": effect.title,
        "unit": effect.unit,
        "range": f"{effect.low:g} to {effect.high:g}",
        "typical size": f"{effect.typical:g}",
        "components": components,
        "spread of sound laws": f"{100 * effect.law_spread:g} %",
        "in the base model as": f"`{effect.in_base}`" if effect.in_base else "",
        "file": f"`{module.__name__.replace('.', '/')}.py`",
    }
    table = "".join(f"| {name} | {value} |\n" for name, value in facts.items() if value)
    return f"### {effect.name}\n\n{to_markdown(text)}\n\n| | |\n|---|---|\n{table}"


def to_markdown(docstring: str) -> str:
    """Return a module's docstring as Markdown: indented blocks as equations, the rest as paragraphs."""
    blocks, lines = [], docstring.replace("\nSource:", "\n\nSource:").splitlines()
    for line in lines:
        indented = line.startswith("    ")
        kind = "equation" if indented else "prose" if line.strip() else "blank"
        if kind == "blank":
            blocks.append(("blank", []))
        elif blocks and blocks[-1][0] == kind:
            blocks[-1][1].append(line)
        else:
            blocks.append((kind, [line]))
    return "\n\n".join(_equations(block) if kind == "equation" else _prose(block) for kind, block in blocks if block)


def _equations(lines: list[str]) -> str:
    lines = textwrap.dedent("\n".join(lines)).splitlines()
    return "\n\n".join(f"$$\n{to_tex(line)}\n$$" for line in lines)


def _prose(lines: list[str]) -> str:
    """Return a paragraph; Greek letters by name and symbols with a script are shown as symbols."""
    pieces = re.split(r"(`[^`]*`)", " ".join(line.strip() for line in lines))
    return "".join(piece if piece.startswith("`") else _with_symbols(piece) for piece in pieces)


def _with_symbols(text: str) -> str:
    out, last = [], 0
    for match in SYMBOL.finditer(text):
        out += [_plain(text[last : match.start()]), f"${to_tex(match[0]).strip()}$"]
        last = match.end()
    return "".join([*out, _plain(text[last:])])


def _plain(text: str) -> str:
    return re.sub(r"([\\*_<>\[\]$#|~])", r"\\\1", text)
