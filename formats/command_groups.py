"""Groups of commands that several packages add to, such as `hangtime takes`."""

from __future__ import annotations

import typer

HELP = {"takes": "Show, check, recover, export and prune take archives."}


def group_of(app: typer.Typer, name: str, words: str | None = None) -> typer.Typer:
    """Return the group of this name; it is made where no package made it before.

    words: its help text, where `HELP` has none
    """
    for group in app.registered_groups:
        if group.name == name and group.typer_instance is not None:
            return group.typer_instance
    made = typer.Typer(help=HELP.get(name, words), no_args_is_help=True)
    app.add_typer(made, name=name)
    return made
