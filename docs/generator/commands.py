"""The reference of the commands, as Markdown, from the Typer app itself."""

from __future__ import annotations

import re
from collections.abc import Iterator

import typer

from formats import command

Part = typer.core.TyperCommand | typer.core.TyperGroup


def whole_command() -> Part:
    """Return the `hangtime` command with the commands of every installed package."""
    return command.whole()


def every_command(part: Part, name: str = "hangtime") -> Iterator[tuple[str, Part]]:
    """Yield each command below a group with its whole name, groups left out."""
    below = getattr(part, "commands", None)
    if below is None:
        yield name, part
        return
    for word, inner in below.items():
        if not inner.hidden:
            yield from every_command(inner, f"{name} {word}")


def commands_page() -> str:
    """Return a section for every command: usage, text, arguments and options."""
    return "\n".join(_section(name, part) for name, part in sorted(every_command(whole_command())))


def _section(name: str, part: Part) -> str:
    context = typer.Context(part, info_name=name)
    usage = part.get_usage(context).removeprefix("Usage: ")
    rows = [record for parameter in part.params if (record := parameter.get_help_record(context))]
    table = "".join(f"| `{_cell(shown)}` | {_cell(_prose(text))} |\n" for shown, text in rows)
    paragraphs = "\n\n".join(_prose(" ".join(p.split())) for p in (part.help or "").split("\n\n"))
    return (
        f"## {name}\n\n```text\n{' '.join(usage.split())}\n```\n\n{paragraphs}\n\n"
        f"| argument or option | meaning |\n|---|---|\n{table}"
    )


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _prose(text: str) -> str:
    """Return a help text as Markdown: signs that Markdown would read are shown, but for code in backticks."""
    pieces = re.split(r"(`[^`]*`)", text)
    return "".join(p if p.startswith("`") else re.sub(r"([\\*_<>\[\]$#])", r"\\\1", p) for p in pieces)
