"""Notes of a result on the parameters that the takes do not identify, and on those at their bounds."""

from __future__ import annotations

from collections.abc import Sequence

from formats.fit_records import BOUND_NOTE, FitParameter

FREE_PARAMETERS = (
    "Not identified: {names}. Read the 90 % interval{of_each}. The fitted value is one of many that follow the takes "
    "equally well, and rounding may decide which."
)
STOPPED_AT_BOUND = (
    f"{BOUND_NOTE} {{names}}. Its range stopped the fit there, so the value says more of the range than of the cloth. "
    "--bounds only narrows the range. A missing effect may drive it there: hangtime diagnose looks for one."
)
STOPPED_AT_BOUNDS = (  # where they are several
    f"{BOUND_NOTE} {{names}}. Their ranges stopped the fit there, so the values say more of the ranges than of the "
    "cloth. --bounds only narrows a range. A missing effect may drive them there: hangtime diagnose looks for one."
)


def notes_on_values(described: Sequence[FitParameter]) -> list[str]:
    """Return what a result says of the parameters that the takes do not identify, and of those at their bounds."""
    notes = []
    if free := [p.name for p in described if not (p.is_identified or p.is_at_bound)]:
        notes.append(FREE_PARAMETERS.format(names=", ".join(free), of_each=" of each" if len(free) > 1 else ""))
    if stopped := [p.name for p in described if p.is_at_bound]:
        said = STOPPED_AT_BOUNDS if len(stopped) > 1 else STOPPED_AT_BOUND
        notes.append(said.format(names=", ".join(stopped)))
    return notes
