"""The option `--anyway` of every command that refuses implausible numbers."""

from __future__ import annotations

from typing import Annotated

import typer

Anyway = Annotated[
    bool, typer.Option("--anyway", help="Accept sizes, weights, times and jumps that no cloth, hanger or camera has.")
]
