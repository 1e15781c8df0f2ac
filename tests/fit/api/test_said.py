"""The words of a fit that name the next command."""

from __future__ import annotations

from pathlib import Path

from fit.api.said import next_command


def test_the_next_command_has_the_takes_of_the_fit_and_quotes_their_names():
    said = next_command([Path("a.mcap"), Path("my take.mcap")], [Path("b.mcap")], ["twist"], None, Path("out"))
    assert said == (
        "Next: `hangtime diagnose a.mcap 'my take.mcap' --held-out b.mcap --held-out-motion twist --out out` looks for "
        "missing physics."
    )


def test_the_next_command_has_the_mesh_spacing_of_the_fit():
    said = next_command([Path("a.mcap")], [], [], 0.08, Path("out"))
    assert said == "Next: `hangtime diagnose a.mcap --spacing 0.08 --out out` looks for missing physics."
