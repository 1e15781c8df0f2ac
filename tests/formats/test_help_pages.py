"""Help pages and refusals of a small program that is built in each test, as the program's own are at its start."""

from __future__ import annotations

import io
import re
import sys
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.main import get_command

from formats import help_pages
from formats.command_groups import COMMAND_GROUPS


def program(seen):
    """A program with two commands and a group; what a command got goes into a list."""
    app, group = typer.Typer(add_completion=False), typer.Typer()

    @app.command(rich_help_panel=COMMAND_GROUPS[0])
    def record(
        place: Annotated[Path, typer.Argument(metavar="[FILE]", help="A place.", readable=True)],
        out: Annotated[str, typer.Option("--out", metavar="DIR", help="Where.")] = "here",
        name: Annotated[str, typer.Option("--name", help="Its name.")] = "",
        seed: Annotated[int, typer.Option("--seed", help="A seed.")] = 0,
        gamma: Annotated[float, typer.Option("--gamma", help="A number.")] = 0.5,
        mass: Annotated[float | None, typer.Option("--mass", metavar="KG", help="Its weight.")] = None,
        many: Annotated[list[str] | None, typer.Option("--many", help="Some.")] = None,
        kind: Annotated[str, typer.Option("--kind", metavar="KIND", help="Needed.")] = ...,  # type: ignore[assignment]
    ) -> None:
        """Record one take. The rest is told here."""
        seen.append((str(place), out, name, seed, gamma, mass, many, kind))

    @app.command()
    def watch(by: Annotated[str, typer.Option("--by", help="By what.")] = "x") -> None:
        """Watch it."""

    @app.command()
    def daemon(seed: Annotated[int, typer.Option("--seed", help="A seed.")] = 0) -> None:
        """Serve it."""

    @app.command(hidden=True)
    def secret() -> None:
        """Hide it."""

    @group.command("prune")
    def prune() -> None:
        """Prune the takes of which there are so many that their sentence is too long for one line of a narrow page."""

    @group.command("list")
    def all_of(json: Annotated[bool, typer.Option("--json", help="Its own.")] = False) -> None:
        """List them."""
        seen.append(json)

    app.add_typer(group, name="takes", help="Takes.")
    help_pages.add_pages(app)
    root = get_command(app)
    help_pages.finish(root)
    return root


def shown(*words, width=100):
    """The page of a command, as plain text."""
    command, context = program([]), None
    for word in ("p", *words):
        command = command if context is None else command.get_command(context, word)
        context = command.context_class(command, parent=context, info_name=word, terminal_width=width)
    return command.get_help(context)


def told(words):
    """What a command got, or the error's words."""
    seen = []
    try:
        program(seen).main(words, prog_name="p", standalone_mode=False)
    except typer.BadParameter as error:
        return error.message if error.param and error.ctx else "an error of no parameter"
    return seen[0]


KIND = ["--kind", "k"]


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["a", *KIND], ("a", "here", "", 0, 0.5, None, None, "k")),
        (["a", *KIND, "--name", ""], ("a", "here", "", 0, 0.5, None, None, "k")),
        (["a_b", *KIND, "--name", "1_0"], ("a_b", "here", "1_0", 0, 0.5, None, None, "k")),
        (["a", *KIND, "--many", "1_0", "--many", "b"], ("a", "here", "", 0, 0.5, None, ["1_0", "b"], "k")),
        ([""], "the text is empty; give FILE, or set the variable that stands for it"),
        (["a", "--kind", ""], "the text is empty; give --kind KIND"),
        (["a", *KIND, "--out", ""], "the text is empty; give --out DIR, or leave it out"),
        (["a", *KIND, "--many", "b", "--many", ""], "the text is empty; give --many with a value, or leave it out"),
        (["a", *KIND, "--seed", "1_0"], "'1_0' is no whole number; write it without an underscore"),
        (["a", *KIND, "--gamma", "1_0"], "'1_0' is no number; write it without an underscore"),
        (["a", *KIND, "--mass", "1_0"], "'1_0' is no number; write it without an underscore"),
        (["a", *KIND, "--gamma", "x"], "'x' is no number"),
        (["a", *KIND, "--gamma", "5cm"], "'5cm' is no number"),
        (["a", *KIND, "--mass", "5g"], "'5g' is no number; was 0.005 meant?"),
        (["a", *KIND, "--seed", "2.5"], "'2.5' is no whole number"),
        (["nowhere/a", *KIND], ("nowhere/a", "here", "", 0, 0.5, None, None, "k")),
    ],
)
def test_a_value_is_taken_or_refused_with_its_cause(words, found):
    assert told(["record", *words]) == found


def test_a_list_of_words_beside_json_keeps_its_own_option():
    assert told(["takes", "list", "--json"]) is True
    assert told(["takes", "list"]) is False


def test_a_page_groups_its_options_and_names_their_values():
    page = shown("record")
    assert re.findall(r"^(\S[^:\n]*):$", page, re.MULTILINE)[:1] == ["Arguments"]
    headings = [line[:-1] for line in page.splitlines() if re.fullmatch(r"[A-Z][a-z ]+:", line)]
    assert headings == ["Arguments", "Search", "Files written", "Options", "Output"]
    assert re.search(r"^  --seed N ", page, re.MULTILINE)
    assert re.search(r"^  --gamma NUMBER ", page, re.MULTILINE)
    assert re.search(r"^  --name NAME ", page, re.MULTILINE)
    assert re.search(r"^  --mass KG ", page, re.MULTILINE)
    assert re.search(r"^  --json +Print JSON instead of words\.", page, re.MULTILINE)
    assert re.search(r"^  (-q, --quiet|--quiet, -q) +Print no words and no progress, only errors\.", page, re.MULTILINE)
    assert "Usage: p record [OPTIONS] [FILE]" in page


@pytest.mark.parametrize(
    ("name", "has_json", "has_quiet"), [("record", True, True), ("watch", True, False), ("daemon", False, False)]
)
def test_commands_that_go_on_and_on_report_nothing(name, has_json, has_quiet):
    page = shown(name)
    assert ("--json" in page, "--quiet" in page) == (has_json, has_quiet)
    assert ("Search:" in page, "Model:" in page) == (name == "record", False)


def test_the_list_of_commands_has_their_headings_and_first_sentences():
    page = shown()
    assert page.endswith(
        "Record a garment:\n  record  Record one take.\n\n"
        "Commands:\n  watch   Watch it.\n  daemon  Serve it.\n  takes   Takes."
    ), page
    names = [name for name, _ in help_pages.every_part(program([]))]
    assert names == ["", "record", "watch", "daemon", "secret", "takes", "takes list", "takes prune"]


@pytest.mark.parametrize("width", [40, 60, 80])
def test_a_sentence_that_is_too_long_for_a_line_is_cut_at_its_end(width):
    lines = shown("takes", width=width).splitlines()
    (long,) = [line for line in lines if line.startswith("  prune")]
    assert long.endswith("...")
    assert width - 15 < len(long) <= width
    assert lines.index("  list   List them.") == lines.index(long) - 1


class Output(io.StringIO):
    def __init__(self, is_terminal):
        super().__init__()
        self.is_terminal = is_terminal

    def isatty(self):
        return self.is_terminal


@pytest.mark.parametrize(
    ("is_terminal", "term", "mode"),
    [(True, "xterm", "markdown"), (True, "dumb", None), (False, "xterm", None), (None, "xterm", None)],
)
def test_pages_are_drawn_on_a_terminal_that_can_draw(monkeypatch, is_terminal, term, mode):
    """A process without standard output has None for it."""
    monkeypatch.setenv("TERM", term)
    monkeypatch.setattr(sys, "stdout", None if is_terminal is None else Output(is_terminal))
    found = help_pages.drawing()
    command = program([]).commands["watch"]
    monkeypatch.undo()
    assert (found, command.rich_markup_mode) == (mode, mode)
