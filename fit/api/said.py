"""Say which command comes after a fit, or why none does."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from formats.plain_text import plain

if TYPE_CHECKING:
    from fit.recordings.ready import Ready


def next_step(prepared: Ready, command: str) -> str:
    """Return the sentence on the command that diagnoses, or why these takes do not serve for a diagnosis."""
    from fit.gap.gates import data_gates

    failed = [gate.sentence for gate in data_gates(prepared.training, prepared.held_out) if not gate.passed]
    return f"`hangtime diagnose` would name no effect from these takes. {failed[0]}" if failed else command


def next_command(
    takes: Sequence[Path], held_out: Sequence[Path], motions: Sequence[str], spacing: float | None, out: Path
) -> str:
    """Return the command that diagnoses the takes of a fit, in a sentence; arguments as `hangtime fit` got them."""
    words = ["hangtime", "diagnose", *map(str, takes)]
    words += [word for take in held_out for word in ("--held-out", str(take))]
    words += [word for kind in motions for word in ("--held-out-motion", kind)]
    words += ["--spacing", f"{spacing:g}"] if spacing is not None else []
    command = shlex.join([*words, "--out", str(out)])
    return plain(f"Next: `{command}` looks for missing physics.")
