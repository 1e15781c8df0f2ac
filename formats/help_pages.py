"""Lay out the pages of `--help`: commands under headings of their purpose, options under headings of their subject.

Rich draws the pages on a terminal. A pipe, a file and a dumb terminal get the same groups as plain text. `--json` and
`--quiet` are added here, to every command that reports something.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from formats import telling
from formats.command_groups import COMMAND_GROUPS, ORDER, OTHER_COMMANDS
from formats.plain_text import as_typed, plain
from formats.typed_values import reword

OUTPUT = "Output"
# Headings of options that several commands have; others stand under "Options".
HEADINGS = {
    "Judge on": ("--held-out", "--held-out-motion"),
    "Model": ("--method", "--model", "--fabric", "--engine", "--effect", "--add", "--without", "--by", "--spacing"),
    "Search": ("--search", "--iterations", "--gamma", "--bounds", "--seed"),
    "Files written": ("--out", "--plot", "--png", "--arrows", "--preview", "--overwrite"),
}
HEADING_OF = {option: heading for heading, options in HEADINGS.items() for option in options}
# Placeholders of values by type; an option that takes no value has none.
VALUE_WORDS = {bool: "", int: "N", float: "NUMBER", str: "NAME"}
NUMERIC = {float: "number", int: "whole number", "float": "number", "integer": "whole number"}  # by type or its name
# Commands that report nothing at their end: services, and commands that run until they are stopped.
WITHOUT_QUIET = ("daemon", "watch", "sync run")
WITHOUT_JSON = ("daemon", "sync run")
JSON_IN_LINES = ("watch",)  # commands whose `--json` prints one object a line, that of an error too
FEWEST_OPTIONS = {"Model": 2, "Search": 2}  # options under such a heading; a lone one stands under "Options"


class Contents(TyperGroup):
    """A list of commands under the headings of their panels."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, each with a word for its value."""
        return [_worded(parameter) for parameter in super().get_params(ctx)]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands of each panel under its heading, in their order."""
        shown = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        known = [(name, command) for name, command in shown if command is not None and not command.hidden]
        width = formatter.width - 6 - max((len(name) for name, _ in known), default=0)
        for panel in dict.fromkeys(_panel_of(command, "Commands") for _, command in known):
            with formatter.section(panel):
                formatter.write_dl(
                    [(name, c.get_short_help_str(width)) for name, c in known if _panel_of(c, "Commands") == panel]
                )


class Page(TyperCommand):
    """A command's help page, with options under the headings of their panels."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line; an error describes the value by a word of `VALUE_WORDS`."""
        try:
            return super().parse_args(ctx, args)
        except Exception as error:
            reword(error)
            raise

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, each with a word for its value."""
        return [_worded(parameter) for parameter in super().get_params(ctx)]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the parts of the usage line; a required argument stands without braces."""
        return [re.sub(r"^\{([^|]*)\}", r"\1", piece) for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments first, then the options of each panel under its heading."""
        records: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            found = parameter.get_help_record(ctx)
            if found is not None:
                kind = "Arguments" if parameter.param_type_name == "argument" else _panel_of(parameter, "Options")
                records.setdefault(kind, []).append(found)
        order = ["Arguments", *HEADINGS, "Options", OUTPUT]
        for panel in sorted(records, key=order.index):
            with formatter.section(panel):
                formatter.write_dl(records[panel])


def add_pages(app: typer.Typer) -> None:
    """Make every command and group of an app use these help pages."""
    app.info.cls = Contents
    for command in app.registered_commands:
        command.cls = Page
    for group in app.registered_groups:
        group.cls = Contents
        if group.typer_instance is not None:
            add_pages(group.typer_instance)


def finish(root: Any) -> None:
    """Add `--json` and `--quiet` to every command, and the drawing mode that suits the output to all."""
    mode, common = drawing(), _common_options()
    root.commands = dict(
        sorted(root.commands.items(), key=lambda item: COMMAND_GROUPS.index(_panel_of(item[1], OTHER_COMMANDS)))
    )
    for name, command in every_part(root):
        command.rich_markup_mode = mode
        if getattr(command, "commands", None) is not None:
            if name in ORDER:
                command.commands = dict(sorted(command.commands.items(), key=lambda item: ORDER[name].index(item[0])))
            continue
        headings = [_heading_of(parameter) for parameter in command.params]
        for parameter, heading in zip(command.params, headings, strict=True):
            _worded(parameter)
            _leave_to_the_reader(parameter)
            _refuse_odd_texts(parameter)
            is_enough = headings.count(heading) >= FEWEST_OPTIONS.get(heading, 1)
            if heading and is_enough and parameter.rich_help_panel is None:
                parameter.rich_help_panel = heading
        taken = {option for parameter in command.params for option in parameter.opts}
        if name not in WITHOUT_JSON and "--json" not in taken:
            command.params.append(common["json"])
        if name not in WITHOUT_QUIET:
            command.params.append(common["quiet"])


def _heading_of(parameter: Any) -> str:
    """Return the heading that options of this name stand under, '' for none."""
    return next((HEADING_OF[option] for option in parameter.opts if option in HEADING_OF), "")


def every_part(part: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every group and command below a part, with its name without the program's name."""
    yield name, part
    for word, inner in (getattr(part, "commands", None) or {}).items():
        yield from every_part(inner, f"{name} {word}".strip())


def drawing() -> Literal["markdown"] | None:
    """Return Typer's mode for help and errors: Rich on a terminal, else plain text."""
    is_terminal = sys.stdout is not None and sys.stdout.isatty() and os.environ.get("TERM") != "dumb"
    return "markdown" if is_terminal else None


def _common_options() -> dict[str, Any]:
    """Return the options that every command gets, by name, taken from a command that never runs."""
    donor = typer.Typer(add_completion=False)

    @donor.command()
    def common(
        json: Annotated[
            bool,
            typer.Option("--json", callback=telling.ask_json, expose_value=False, rich_help_panel=OUTPUT,
                         help="Print JSON instead of words."),
        ] = False,
        quiet: Annotated[
            bool,
            typer.Option("--quiet", "-q", callback=telling.ask_quiet, expose_value=False, is_eager=True,
                         rich_help_panel=OUTPUT, help="Print no words and no progress, only errors."),
        ] = False,
    ) -> None:  # fmt: skip
        """Tell."""

    return {parameter.name or "": parameter for parameter in get_command(donor).params}


def _worded(parameter: Any) -> Any:
    """Return a parameter whose help names its value by a word of `VALUE_WORDS` instead of a Python type."""
    described = getattr(parameter, "type_descriptor", None)  # of Typer from 0.27 on; before, it showed TEXT
    if described is None:
        return parameter
    if parameter.param_type_name == "argument":
        parameter.display_type_rich = lambda ctx: ""  # its name says what to give
    elif parameter.metavar is None and not described.is_choice:
        parameter.metavar = VALUE_WORDS.get(described.annotation)
    return parameter


def _leave_to_the_reader(parameter: Any) -> None:
    """Disable Typer's check that a file is readable, so that the code that reads the file reports the reason."""
    described = getattr(parameter, "type_descriptor", None)  # as in `_worded`
    checked: Any = getattr(parameter, "type", None) if described is None else described.parameter_info
    if getattr(checked, "readable", False):
        checked.readable = False


def _refuse_odd_texts(parameter: Any) -> None:
    """Let a parameter refuse an empty text that is not its default, a path below `~`, and a number with underscores.

    An empty text often comes from a variable of the shell that is not set. As a path it would be the current folder.
    Shells leave `~` as it is in quotes, and most of them behind an equals sign. A folder of this name is a danger to
    those who remove it. To Python 1_0 is ten, and its typist may have meant 1.0.
    """
    described = getattr(parameter, "type_descriptor", None)  # as in `_worded`
    kind = getattr(parameter.type, "name", "").split(" ")[0] if described is None else described.annotation
    process = parameter.process_value

    def checked(ctx: Any, value: Any) -> Any:
        source = ctx.get_parameter_source(parameter.name)
        is_typed = source is not None and source.name == "COMMANDLINE"
        for given in value if isinstance(value, list | tuple) else [value]:
            message = ""
            if given == "" and is_typed and parameter.default != "":
                message = f"the text is empty; {_instead_of_empty(parameter)}"
            elif is_typed and _is_below_home(given):
                home, tilde = as_typed([os.path.expanduser(given)]), plain(given.split("/")[0])
                whose = "your" if tilde == "~" else f"{tilde[1:]}'s"
                message = (
                    f"the shell did not put {whose} home folder in place of {tilde} in {plain(given)}; give {home}"
                )
            elif isinstance(given, str) and "_" in given and kind in NUMERIC:
                message = f"{given!r} is no {NUMERIC[kind]}; write it without an underscore"
            if message:
                raise typer.BadParameter(message, ctx=ctx, param=parameter)
        return process(ctx, value)

    parameter.process_value = checked


def _is_below_home(given: object) -> bool:
    """Return whether a value is a path below `~`, or a user's as `~anna`, where no file or folder has this name."""
    tilde = given.split("/")[0] if isinstance(given, str) and given.startswith("~") else ""
    return (tilde == "~" or os.path.expanduser(tilde) != tilde) and not os.path.lexists(tilde)


def _instead_of_empty(parameter: Any) -> str:
    """Return the next step for a user who gave an empty text."""
    word = parameter.metavar or "with a value"
    if parameter.param_type_name == "argument":
        return f"give {word.strip('[].')}, or set the variable that stands for it"
    return f"give {parameter.opts[0]} {word}{'' if parameter.required else ', or leave it out'}"


def _panel_of(part: Any, otherwise: str) -> str:
    return getattr(part, "rich_help_panel", None) or otherwise
