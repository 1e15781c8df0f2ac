"""Find the known names that a wrong name probably means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

NEAR_NAMES = 2  # names that an error suggests; our choice: a suggestion is read at a glance
# Of a word that stands for a whole name: its letters at least, and its likeness (difflib's ratio). Our choice: two
# letters that changed places leave 0.88 of eight, and shorter words resemble too many others.
LEAST_LETTERS, NEAR_WORD = 4, 0.75
NEAR_WHOLE = 0.6  # likeness of a whole name; difflib's own choice
AS_LIKELY = 0.15  # likeness below the best one's, of a second suggestion; our choice: `drg` is 0.86 drag, 0.6 draught


def near_names(name: str, known: Sequence[str], titles: Mapping[str, str] | None = None) -> list[str]:
    """Return the known names that a wrong one probably means, likeliest first.

    These are names of the same words in any order, else those that have it as a word. Else they are the most similar
    ones. Names are compared as a whole, with their words in order, and by single words of a name or title (`titles`).
    """
    asked = _plain(str(name))  # calls from Python may name anything
    if not asked:
        return []
    plain = {one: _plain(one) for one in known}
    same = [one for one, words in plain.items() if _in_order(words) == _in_order(asked)]
    parts = [one for one, words in plain.items() if f"_{asked}_" in f"_{words}_"]
    if same or parts:
        return (same or parts)[:NEAR_NAMES]
    found = {one: _likeness(asked, words, _plain((titles or {}).get(one, ""))) for one, words in plain.items()}
    best = sorted((one for one in known if found[one] > 0.0), key=lambda one: -found[one])
    return [one for one in best if found[one] >= found[best[0]] - AS_LIKELY][:NEAR_NAMES]


def _likeness(asked: str, words: str, title: str) -> float:
    """Return how like a known name is to one that was asked for, up to 1. A name too unlike to be meant has 0."""
    from difflib import SequenceMatcher  # here: no right name needs it

    def ratio(one: str, other: str) -> float:
        return SequenceMatcher(None, one, other).ratio()

    whole = max(ratio(asked, words), ratio(_in_order(asked), _in_order(words)))
    single = [word for word in f"{words}_{title}".split("_") if len(word) >= LEAST_LETTERS]
    of_words = [max((ratio(part, word) for word in single), default=0.0) for part in asked.split("_")]
    by_word = min(of_words)
    return max(whole if whole >= NEAR_WHOLE else 0.0, by_word if by_word >= NEAR_WORD else 0.0)


def _in_order(words: str) -> str:
    return "_".join(sorted(words.split("_")))


def _plain(name: str) -> str:
    return name.strip().lower().replace("-", "_").replace(" ", "_")
