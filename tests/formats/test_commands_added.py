"""What this package adds to `hangtime`, to an app of its own: commands, their short help, headings, and groups."""

from __future__ import annotations

import pytest
import typer
from typer.main import get_command

from formats import cli, export_cli, takes_cli
from formats.command_groups import FIT, HELP, TAKES, group_of

ADDED = {
    "takes list": ("List takes with length, motion and garment.", takes_cli.list_takes),
    "takes show": ("Show what a take holds.", takes_cli.show_takes),
    "takes verify": ("Read takes whole, checksums and all.", takes_cli.verify_takes),
    "takes recover": ("Make a sound file of what a damaged take holds.", takes_cli.recover_takes),
    "takes export": ("Write takes for other programs.", export_cli.export_takes),
    "takes labels": ("List the markers of motion capture files.", cli.list_labels),
    "import": ("Turn other people's recordings into takes.", cli.import_recordings),
    "swatch": ("Describe a square swatch with markers.", cli.describe_swatch),
}


@pytest.fixture
def app():
    return typer.Typer()


def test_every_command_is_added_with_its_short_help(app):
    cli.add_commands(app)
    root = get_command(app)
    found = {f"takes {name}": command for name, command in root.commands["takes"].commands.items()}
    found |= {name: command for name, command in root.commands.items() if name != "takes"}
    assert list(found) == list(ADDED)
    for name, (words, work) in ADDED.items():
        assert found[name].get_short_help_str(66).startswith(words.rstrip(".")), name
        assert found[name].callback.__wrapped__ is work or found[name].callback.__name__ == work.__name__
    assert {root.commands[name].rich_help_panel for name in ("takes", "import", "swatch")} == {TAKES}
    assert root.commands["takes"].help == HELP["takes"]


def test_a_group_is_made_once_and_has_the_shared_words_or_its_own(app):
    takes = group_of(app, "takes", "other words", FIT)
    assert group_of(app, "takes") is takes
    blind = group_of(app, "blind", "Check the check.", FIT)
    assert blind is not takes
    assert group_of(app, "blind") is blind
    assert [(group.name, group.rich_help_panel) for group in app.registered_groups] == [
        ("takes", TAKES),
        ("blind", FIT),
    ]
    assert (takes.info.help, blind.info.help) == (HELP["takes"], "Check the check.")
    assert takes.info.no_args_is_help is blind.info.no_args_is_help is True
    assert group_of(app, "last").info.help is None
