"""Notes of a result on parameters that are not identified or at their bounds, and on a fit worse than its start.

Every search returns the candidate with the least of its own figure, and its start is one of the candidates. Least
squares and short windows minimise other figures than the distance that a result reports. So this distance may grow, and
it may grow on held-out takes after any search.
"""

from __future__ import annotations

from collections.abc import Sequence

from formats.diagnosis_records import Diagnosis
from formats.fit_records import BOUND_NOTE, FitError, FitParameter, FitResult

FREE_PARAMETERS = (
    "Not identified: {names}. Read the 90 % interval{of_each}. Many values in it follow the takes equally well, and "
    "rounding may decide at which of them a search ends. So tables show none."
)
LOOKS_FOR_ONE = "hangtime diagnose looks for one"
STOPPED_AT_BOUND = (
    f"{BOUND_NOTE} {{names}}. Its range stopped the fit there, so the value says more of the range than of the cloth. "
    f"--bounds only narrows the range. A missing effect may drive it there: {{cause}}."
)
STOPPED_AT_BOUNDS = (  # where they are several
    f"{BOUND_NOTE} {{names}}. Their ranges stopped the fit there, so the values say more of the ranges than of the "
    f"cloth. --bounds only narrows a range. A missing effect may drive them there: {{cause}}."
)
NEVER_MOVED = (
    "Warning: {search} found no candidate better than its start, so every value is the start's. Give more "
    "--iterations, or use --search least-squares."
)
WORSE_THAN_START = (
    "Warning: the fit follows {takes} worse than its initial parameters do: {after:.1f} mm instead of {before:.1f} mm "
    "(mean distance of all points). The search lowered another figure: {lowered}. "
    "Its parameters tell little of the cloth; {advice}."
)
LOWERED_FIGURE = {
    "least-squares": "the sum of the points' squared residuals on the takes it was fitted to",
    "short-windows": (
        "the points' residuals on the takes it was fitted to, while a pull leads the cloth back every two seconds"
    ),
}
LOOK_FOR_PHYSICS = "`hangtime diagnose` looks for missing physics"
MORE_TAKES = "fit to takes of this kind of motion as well"


def note_on_start(error: FitError, search: str, physics: str = LOOK_FOR_PHYSICS) -> str:
    """Return a warning if a fit's error exceeds that of its initial parameters, on fitted or else on held-out takes.

    physics: what is known of missing physics, or how to look for it
    """
    before, after, takes = error.train_before, error.train_after, "the takes it was fitted to"
    advice = "use --search least-squares" if search == "short-windows" else physics
    if after.mean_m <= before.mean_m:
        if error.held_out_before is None or error.held_out_after is None:
            return ""
        before, after, takes, advice = error.held_out_before, error.held_out_after, "the held-out takes", MORE_TAKES
    if after.mean_m <= before.mean_m:
        return ""
    lowered = LOWERED_FIGURE.get(search, "the method's objective on the takes it was fitted to")
    return WORSE_THAN_START.format(
        takes=takes, after=1e3 * after.mean_m, before=1e3 * before.mean_m, lowered=lowered, advice=advice
    )


def notes_beside(fit: FitResult, diagnosis: Diagnosis) -> list[str]:
    """Return a fit's notes where a diagnosis of its takes is known: its finding replaces the advice to diagnose.

    The notes with this advice are worded again from the fit's parameters and errors. Notes that an older version worded
    otherwise stay as they are.
    """
    found = f"the diagnosis beside this fit names {named_in_words(diagnosis, diagnosis.named) or 'none'}"
    advised = [*notes_on_values(fit.parameters), note_on_start(fit.error, fit.search)]
    told = [*notes_on_values(fit.parameters, found), note_on_start(fit.error, fit.search, found)]
    instead = dict(zip(advised, told, strict=True))
    return [instead.get(note, note) for note in fit.notes]


def named_in_words(diagnosis: Diagnosis, among: Sequence[str]) -> str:
    """Return some of the effects that a diagnosis names, in words: joined by `or` where it cannot tell them apart."""
    return (" or " if diagnosis.verdict == "ambiguous" else " and ").join(name.replace("_", " ") for name in among)


def notes_on_values(described: Sequence[FitParameter], cause: str = LOOKS_FOR_ONE) -> list[str]:
    """Return what a result says of the parameters that the takes do not identify, and of those at their bounds.

    cause: what is known of the effect that may drive them to a bound, or how to look for it
    """
    notes = []
    if free := [p.name for p in described if not (p.is_identified or p.is_at_bound)]:
        notes.append(FREE_PARAMETERS.format(names=", ".join(free), of_each=" of each" if len(free) > 1 else ""))
    if stopped := [p.name for p in described if p.is_at_bound]:
        said = STOPPED_AT_BOUNDS if len(stopped) > 1 else STOPPED_AT_BOUND
        notes.append(said.format(names=", ".join(stopped), cause=cause))
    return notes
