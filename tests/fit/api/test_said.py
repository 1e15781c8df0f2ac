"""The words of a fit that name the next command."""

from __future__ import annotations

from pathlib import Path

from fit.api.said import next_command


def test_the_next_command_has_the_takes_of_the_fit_and_quotes_their_names():
    said = next_command([Path("a.mcap"), Path("my take.mcap")], [Path("b.mcap")], ["twist"], Path("out"))
    assert said == (
        "Next: `hangtime diagnose a.mcap 'my take.mcap' --held-out b.mcap --held-out-motion twist --out out` looks for "
        "missing physics."
    )
