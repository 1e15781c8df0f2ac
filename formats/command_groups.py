"""Command groups to which several packages add commands, such as `hangtime takes`."""

from __future__ import annotations

import typer

# Headings of the list of commands
COMMAND_GROUPS = (
    "Record a garment", "Run an appliance", "Keep takes", "Fit and diagnose", "Take results away",
    "Check the diagnosis itself", "Others",
)  # fmt: skip
RECORD, APPLIANCE, TAKES, FIT, OUT, CHECK_DIAGNOSIS, OTHER_COMMANDS = COMMAND_GROUPS
HELP = {"takes": "Show, check, recover, export and prune take archives."}
PANEL_OF = {"takes": TAKES}
ORDER = {
    "takes": ("list", "show", "verify", "recover", "export", "labels", "prune")
}  # of the commands of shared groups


def group_of(app: typer.Typer, name: str, words: str | None = None, panel: str | None = None) -> typer.Typer:
    """Return the group of this name, which is made on first use.

    - words: its help text, where `HELP` has none
    - panel: its heading in the list of commands; `PANEL_OF` has the headings of shared groups
    """
    for group in app.registered_groups:
        if group.name == name and group.typer_instance is not None:
            return group.typer_instance
    made = typer.Typer(help=HELP.get(name, words), no_args_is_help=True)
    app.add_typer(made, name=name, rich_help_panel=PANEL_OF.get(name, panel))
    return made
