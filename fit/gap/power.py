"""Power of takes without a gap: whether the effects that may be missing would have made a gap.

The absence of a gap is evidence only where a missing effect would have made one. A component of an effect would not
show at its typical size where this is below the smallest detectable one (`fit.gap.detectable`). Such components are of
two kinds. Let s be the signature at the typical size, and P s the part that no base parameter imitates. The verdict's
rules require the mean square N^2:

    faint      |s|^2 < N^2              the motion hardly excites the effect
    imitated   |P s|^2 < N^2 <= |s|^2   the motion excites it, and wrong base parameters make up for it

Where an imitated effect is at work, the base model fits these takes and errs on other motion. So these takes do not
show that nothing is missing. Neither do takes whose noise makes most effects of the library faint.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from fit.cloth.effect import Effect
from fit.gap.detectable import needed_mm2, smallest_detectable, unseen
from fit.gap.evidence import Evidence
from formats.arrays import Floats
from formats.plain_text import first_few

# Of the effects that move the cloth: the share that must be detectable at typical sizes, or else a missing gap says
# nothing. Our choice: most, as no takes show all (a clock's drift needs long ones). Half and double were not tried.
LEAST_SHOWN = 0.5
LISTED_COMPONENTS = 4  # components that a sentence names; our choice: a sentence is read at a glance


@dataclass(frozen=True)
class Power:
    """Power of takes without a gap.

    - `reason`: why the missing gap says nothing, or empty
    - `unseen`: the undetectable components
    - `advice`: the next step where there is a reason
    """

    reason: str
    unseen: list[str]
    advice: str = ""

    @property
    def listed(self) -> str:
        """Return a sentence's list of the first undetectable components, with the number of the others."""
        return first_few(self.unseen, most=LISTED_COMPONENTS)


def power_of(evidence: Evidence) -> Power:
    """Return whether effects of typical size would have made a gap in these takes."""
    library, pull, smallest = evidence.observer.library, evidence.observer.frequency, smallest_detectable(evidence)
    missed = unseen(library, smallest)
    if pull and missed:
        return Power(f"a pull of {pull:g} Hz, which these takes need to be predictable, hides small effects", missed)
    if alike := unseen(library, imitated(evidence, smallest)):
        advice = " Add takes that swing faster and slower, and hold one of them out."
        return Power("in these takes wrong cloth parameters imitate some effects of usual size", alike, advice)
    if shown_share(library, smallest) < LEAST_SHOWN:
        advice = " Swing faster, or come nearer to the sensor."
        return Power("beside the noise of these takes most effects of usual size would not show", missed, advice)
    return Power("", missed)


def hidden_beside(evidence: Evidence, named: Collection[str]) -> list[str]:
    """Return the note on effects that these takes could not have shown beside named ones; nothing if none is named."""
    if not named:
        return []
    sizes = smallest_detectable(evidence)
    left = unseen(evidence.observer.library, {name: one for name, one in sizes.items() if name not in named})
    if not left:
        return []
    listed = first_few(left, most=LISTED_COMPONENTS)
    return [f"At their usual sizes these takes could not have shown: {listed}. So these may be missing too."]


def imitated(evidence: Evidence, smallest: dict[str, Floats]) -> dict[str, Floats]:
    """Return `smallest` of the components that base parameters imitate at their typical sizes, and nan of the others.

    Effects without such a component are left out.
    """
    found = {}
    for name, sizes in smallest.items():
        one, needed = evidence.screened[name], needed_mm2(evidence, name)
        whole, own = (
            np.array([float(evidence.observer.in_mm(row)) ** 2 for row in rows]) for rows in (one.raw, one.projected)
        )
        is_alike = (own < needed) & (needed <= whole)
        is_hidden = np.isfinite(sizes) & (sizes > evidence.observer.library[name].typical)  # from the held edge, too
        if (is_alike & is_hidden).any():
            found[name] = np.where(is_alike, sizes, np.nan)
    return found


def shown_share(library: dict[str, Effect], smallest: dict[str, Floats]) -> float:
    """Return the share of effects that are detectable at their typical sizes, of those that move the cloth; 1 of none.

    An effect counts if each of its components that moves anything is detectable.
    """
    moving = {name: sizes[np.isfinite(sizes)] for name, sizes in smallest.items() if np.isfinite(sizes).any()}
    shown = [bool((sizes <= library[name].typical).all()) for name, sizes in moving.items()]
    return sum(shown) / len(shown) if shown else 1.0
