"""Probability that each effect is present in the recorded cloth, from draws of the held-out error.

A draw picks blocks of the held-out takes, an error of mesh and solver (`fit.gap.closure.solver_draws`), and a limit.
The limit is the share of the gap that a true cause may leave unexplained beyond noise, mesh and solver. A true cause
leaves such a share because the library's laws are not nature's. The limit is logistic about SHARE_LEFT with a width of
LEFT_WIDTH. It was chosen on cases of known truth (`docs/reference/blind-check.md`). There nearly every effect that left
less than a tenth was the cause, and about half of those that left a fifth to three fifths. Sound laws of an effect
leave some of the gap too, which is a second limit (`Evidence.most_by_law`).

In a draw an effect is present if it has the least error, is worth naming and leaves no more than both limits. Several
effects are present together if they leave no more than the limits and the last of them was worth adding. They share
that probability, and each of them may be present alone in the other draws. A twin that replaces one of them nearly as
well counts in the draws in which it leaves less error.

Effects that the held edge contradicts (`Evidence.contradicted`) are absent. An effect that the edge identifies
(`Evidence.identified_by_edge`) is present in draws without any other effect; of several, the one of least error.

Shares of draws are too low. Take cases of known truth in which any effect is present in a share S of the draws. The
odds that an effect of the library was truly present were about ODDS times S / (1 - S). All shares are scaled alike.
"""

from __future__ import annotations

import numpy as np

from fit.gap.evidence import (
    Evidence,
    are_worth_adding,
    best_of,
    is_shown_by_edge,
    least_gain,
    share_in_median_block,
)
from fit.gap.hypotheses import Hypothesis

SHARE_LEFT, LEFT_WIDTH = 0.35, 0.12  # of the gap that a cause may leave: chosen on cases of known truth, as above
ODDS = 4.0  # on development cases, seven of seven with S between 0.3 and 0.65 had their cause in the library


def probabilities(evidence: Evidence, several: Hypothesis | None) -> dict[str, float]:
    """Return the probability of each effect that was refitted alone or as one of several named effects."""
    twins = evidence.alternatives(several).values() if several else []
    teams = [several, *(h for others in twins for h in others.values())] if several else []
    base, drawn, joint = evidence.drawn(*teams)
    noise = evidence.floor_mm**2
    limit = np.maximum(np.random.default_rng(1).logistic(SHARE_LEFT, LEFT_WIDTH, len(base)), 0.0)
    most = noise + evidence.numerics_mm**2 + limit * (base - noise)
    together, winner = np.zeros(len(base), bool), np.zeros(len(base), int)
    if teams:
        least, winner = np.min(np.stack(joint), axis=0), np.argmin(np.stack(joint), axis=0)
        before = np.min(np.stack(list(drawn.values())), axis=0)
        best = best_of(evidence.observer, evidence.singles)[0]
        usual = share_in_median_block(best.errors, teams[0].errors, evidence.floor_mm)
        is_added = are_worth_adding(
            base - noise, before - noise, before - least, usual, least_gain(evidence.observer, best)
        )
        if is_shown_by_edge(evidence.observer, evidence.base, best, teams[0]):
            is_added |= before > least
        by_law = np.stack([evidence.most_by_law(team, base - noise) for team in teams])
        together = is_added & (least <= most) & (least <= by_law[winner, np.arange(len(base))])
    worth = evidence.are_worth_naming(base, drawn)
    at_work = {}
    for k, squared in drawn.items():
        limit = np.minimum(most, evidence.most_by_law(evidence.singles[k], base - noise))
        at_work[k] = worth[k] & (squared <= limit) & ~together
    identified = sorted(evidence.identified_by_edge)
    if identified:
        nothing = ~np.any([together, *(at_work[k] for k in drawn if k not in identified)], axis=0)
        nearest = np.argmin(np.stack([drawn[k] for k in identified]), axis=0)
        at_work.update({k: nothing & (nearest == n) for n, k in enumerate(identified)})
    found = {k: float(np.mean(draws)) for k, draws in at_work.items()}
    share = sum(found.values()) + float(np.mean(together))
    for n, team in enumerate(teams):
        for k in team.effects:
            found[k] = found.get(k, 0.0) + float(np.mean(together & (winner == n)))
    return {k: value * ODDS / (1 + (ODDS - 1) * share) for k, value in found.items()}
