"""`--anyway`: the option of every command that refuses numbers that no cloth, hanger or camera has."""

from __future__ import annotations

from typing import Annotated

import typer

Anyway = Annotated[
    bool, typer.Option("--anyway", help="Accept sizes, weights, times and leaps that no cloth, hanger or camera has.")
]
