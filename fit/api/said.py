"""Say which command comes after a fit."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from formats.plain_text import plain


def next_command(takes: Sequence[Path], held_out: Sequence[Path], motions: Sequence[str], out: Path) -> str:
    """Return the command that diagnoses the takes of a fit, in a sentence; arguments as `hangtime fit` got them."""
    words = ["hangtime", "diagnose", *map(str, takes)]
    words += [word for take in held_out for word in ("--held-out", str(take))]
    words += [word for kind in motions for word in ("--held-out-motion", kind)]
    command = shlex.join([*words, "--out", str(out)])
    return plain(f"Next: `{command}` looks for missing physics.")
