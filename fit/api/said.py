"""Say which command comes after a fit, or why none does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from formats.errors import ResultError
from formats.plain_text import as_typed
from formats.results import load_diagnosis

if TYPE_CHECKING:
    from fit.recordings.ready import Ready
    from formats.garment import Garment


def next_step(prepared: Ready, command: str) -> str:
    """Return the sentence on the command that diagnoses, or why these takes do not serve for a diagnosis."""
    from fit.gap.gates import data_gates

    failed = [gate.sentence for gate in data_gates(prepared.training, prepared.held_out) if not gate.passed]
    return f"`hangtime diagnose` would name no effect from these takes. {failed[0]}" if failed else command


def next_command(
    takes: Sequence[Path], held_out: Sequence[Path], motions: Sequence[str], spacing: float | None, out: Path, *,
    model: str = "", anyway: bool = False,
) -> str:  # fmt: skip
    """Return the command that diagnoses the takes of a fit, in a sentence; arguments as `hangtime fit` got them.

    model: the base model, '' for the default one of the garment
    """
    words = ["hangtime", "diagnose", *map(_path, takes)]
    words += [word for take in held_out for word in ("--held-out", _path(take))]
    words += [word for kind in motions for word in ("--held-out-motion", kind)]
    words += ["--model", model] if model else []
    words += ["--spacing", repr(spacing)] if spacing is not None else []  # every digit, as a person typed it
    words += ["--anyway"] if anyway else []
    return f"Next: `{as_typed([*words, '--out', _path(out)])}` looks for missing physics."


def _path(path: Path) -> str:
    """Return a path as an argument that no command takes for an option, nor a shell for a home folder."""
    return f"./{path}" if str(path).startswith(("-", "~")) else str(path)


def model_to_name(method: str, garment: Garment) -> str:
    """Return the base model of a diagnosis that a fit's method is, '' where it is the default one or no base model."""
    from fit.methods import BASE_MODELS, base_model_of

    return method if method in BASE_MODELS and method != base_model_of(garment).name else ""


def is_diagnosed(folder: Path, prepared: Ready) -> bool:
    """Return whether a folder of results holds a diagnosis of these takes."""
    file = folder / "diagnosis.json"
    try:
        return file.exists() and prepared.are_of(load_diagnosis(file))
    except ResultError:  # a diagnosis keeps such a file aside
        return False
