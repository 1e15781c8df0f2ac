"""Sentences of a verdict on the held edge: what it shows, what it contradicts, and how far off it stays."""

from __future__ import annotations

from fit.gap.evidence import Evidence, edge_left_by_law, is_at_bound
from fit.gap.hypotheses import Hypothesis
from fit.observer.edge import is_edge_explained, is_favoured_by_edge
from formats.diagnosis_records import Figure
from formats.plain_text import joined


def edge_says(evidence: Evidence, effect: str, closed: Figure | None, several: Hypothesis | None = None) -> str:
    """Return the sentences on the held edge's evidence for an effect, and on a remaining unexplained gap.

    several: the nearest effects with further ones, if these explain too little
    """
    hypothesis = evidence.singles[effect]
    before, after = evidence.base.errors.edge.mm, hypothesis.errors.edge.mm
    said = (
        f" The held edge shows this effect: the model puts that edge {before:.1f} mm off without the effect and "
        f"{after:.1f} mm off with it, noise included."
    )
    if not evidence.is_predictable:
        return f"{said} These takes say nothing more of the cloth, which is not predictable in them."
    if closed is None or evidence.explains_enough(hypothesis):
        return said
    rest = f"{said} The rest of the gap, {100 - 100 * max(closed.value, 0):.0f} %, no effect in the library explains"
    return f"{rest}{_beside(evidence, effect, several) or _contradicted(evidence)}."


def _beside(evidence: Evidence, effect: str, several: Hypothesis | None) -> str:
    """Return words on further effects beside one, which leave more than true causes would, if there are any."""
    closed = evidence.closure_of(several) if several is not None and effect in several.effects else None
    if several is None or closed is None:
        return ""
    titles = " and ".join(evidence.observer.library[k].title for k in several.effects if k != effect)
    left = f"{100 - 100 * closed.value:.0f} %"
    return f": {titles} beside this effect would leave {left} of the gap, more than a true cause would"


def _contradicted(evidence: Evidence) -> str:
    """Return words on the effect that would close most of the gap and that the held edge contradicts, if any."""
    closed = {
        k: found.value for k, h in evidence.singles.items()
        if k in evidence.contradicted and not is_at_bound(evidence.observer, h) and evidence.explains_enough(h)
        and (found := evidence.closure_of(h)) is not None
    }  # fmt: skip
    if not closed:
        return ""
    best = max(closed, key=lambda k: closed[k])
    title = evidence.observer.library[best].title
    return f": {title} would close {100 * closed[best]:.0f} % of the gap, but the held edge contradicts it"


def still_off(evidence: Evidence, hypothesis: Hypothesis) -> str:
    """Return a sentence if the held edge stays in the wrong position with the named effects, beyond noise and laws."""
    edge, by_law = hypothesis.errors.edge, edge_left_by_law(evidence.observer, evidence.base, hypothesis)
    if is_edge_explained(edge, by_law):
        return ""
    it = "it" if len(hypothesis.effects) == 1 else "them"
    return f" With {it} the held edge is still {edge.mm:.1f} mm off, beyond noise."


def describe_held_edge(evidence: Evidence) -> str:
    """Return a sentence if no effect was named although the base model's held edge is in the wrong position.

    It states the refitted effect that puts the edge nearest, if the edge favours one.
    """
    edge = evidence.base.errors.edge
    if is_edge_explained(edge):
        return ""
    said = f" The base model puts the held edge {edge.mm:.1f} mm off, beyond noise"
    nearer = {k: h.errors.edge for k, h in evidence.singles.items() if is_favoured_by_edge(edge, h.errors.edge, edge)}
    if not nearer:
        return f"{said}, and no single effect in the library explains that."
    best = min(nearer, key=lambda k: nearer[k].shown)
    title = evidence.observer.library[best].title
    by_law = edge_left_by_law(evidence.observer, evidence.base, evidence.singles[best])
    is_enough = is_edge_explained(nearer[best], by_law)
    but = "which this effect alone does not explain"
    if is_enough:
        but = f"but the evidence is too weak to name it: {joined(edge_lacks(evidence, best))}"
    return f"{said}. With {title} it is {nearer[best].mm:.1f} mm off, {but}."


def edge_lacks(evidence: Evidence, effect: str) -> list[str]:
    """Return why the held edge does not identify an effect that explains it (`Evidence.identified_by_edge`)."""
    return list(evidence.edge_lacks(effect)) or ["another effect puts the edge nearer"]
