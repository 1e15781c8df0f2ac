"""Choose among takes of a garment that share frames of one recording, so that the most independent evidence stays.

Takes that share frames form groups. An option of a group is a set of its takes that share none, to which no further one
can be added. These rules choose an option of each group, in this order:

- The takes that stay can be diagnosed.
- They last longest, within `SAME_SECONDS`: a whole take stays, and a cut copy of it does not.
- They were diagnosed before, so that a new copy costs no second diagnosis.
- They show most kinds of motion: two takes stay, and a file that joins them does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain, combinations, islice, product
from typing import Protocol, TypeVar

from fit.batch.summary import short_name
from formats.plain_text import joined

SAME_SECONDS = 0.9  # of the longest option; our choice: a file that joins two takes lasts an interval longer than both
MOST_TOGETHER = 10  # takes of a group whose options are all looked at; our choice: bounds time, 1024 sets
MOST_CHOICES = 256  # options of all groups together that are tried; our choice: bounds time; eight copies of two takes


class Shown(Protocol):
    """A take with its name, its length [s] and its kind of motion."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def seconds(self) -> float: ...  # noqa: D102
    @property
    def kind(self) -> str: ...  # noqa: D102


Taken = TypeVar("Taken", bound=Shown)
Twins = dict[str, set[str]]  # the takes that share frames with each take, by name


def left_out(
    every: Sequence[Taken],
    twins: Twins,
    can: Callable[[Sequence[Taken]], bool],
    known: Callable[[Sequence[Taken]], bool],
) -> dict[str, list[str]]:
    """Return the takes to leave out, each with those that stay and share its frames.

    - `twins`: of each take, the others that share frames
    - `can`, `known`: whether takes can be diagnosed, and whether they were
    """
    groups = _groups(every, twins)
    if not groups:
        return {}
    options = [_options([one for one in every if one.name in group], twins) for group in groups]
    in_groups = set[str]().union(*groups)

    def stays(choice: Sequence[Sequence[Taken]]) -> list[Taken]:
        chosen = {one.name for option in choice for one in option}
        return [one for one in every if one.name in chosen or one.name not in in_groups]

    longest = [[option for option in group if _lasts(option) >= _least(group)] for group in options]
    alike = [stays(choice) for choice in islice(product(*longest), MOST_CHOICES)]
    others = (stays(choice) for choice in islice(product(*options), MOST_CHOICES))
    able = [one for one in alike if can(one)]
    staying = next(chain(filter(known, able), able, filter(can, others)), alike[0])
    names = {one.name for one in staying}
    return {
        one.name: [other.name for other in staying if other.name in twins[one.name]]
        for one in every if one.name not in names
    }  # fmt: skip


def sharing(names: Sequence[str]) -> str:
    """Return that a take shares frames with those of some names."""
    told = joined(list(map(short_name, names)))
    held_by = f"recording that {told} holds" if len(names) == 1 else f"recordings that {told} hold"
    return f"it holds frames of the {held_by}"


def _groups(every: Sequence[Taken], twins: Twins) -> list[set[str]]:
    """Return the groups of takes that share frames, directly or by others."""
    groups = list[set[str]]()
    for one in every:
        if twins.get(one.name) and not any(one.name in group for group in groups):
            group, ahead = set[str](), [one.name]
            while ahead:
                name = ahead.pop()
                ahead += twins[name] - group
                group.add(name)
            groups.append(group)
    return groups


def _lasts(option: Sequence[Shown]) -> float:
    return sum(one.seconds for one in option)


def _least(options: Sequence[Sequence[Shown]]) -> float:
    """Return the least length of options that count as long as the longest one [s]."""
    return SAME_SECONDS * max(map(_lasts, options))


def _options(group: Sequence[Taken], twins: Twins) -> list[tuple[Taken, ...]]:
    """Return the options of a group: the longest ones first, those with most kinds of motion before others."""
    found = list(_every_option(group, twins) if len(group) <= MOST_TOGETHER else _few_options(group, twins))
    least = _least(found)

    def rank(option: tuple[Taken, ...]) -> tuple[bool, int, float, list[str]]:
        kinds = len({one.kind for one in option})
        return _lasts(option) < least, -kinds, -_lasts(option), [one.name for one in option]

    return sorted(found, key=rank)


def _every_option(group: Sequence[Taken], twins: Twins) -> Iterator[tuple[Taken, ...]]:
    for count in range(1, len(group) + 1):
        for some in combinations(group, count):
            names = {one.name for one in some}
            if all(bool(twins[one.name] & names) is (one.name not in names) for one in group):
                yield some


def _few_options(group: Sequence[Taken], twins: Twins) -> Iterator[tuple[Taken, ...]]:
    """Yield two options of many takes: the longest takes first, and the shortest first."""
    for sign in (-1, 1):
        some = list[Taken]()
        for one in sorted(group, key=lambda one: sign * one.seconds):
            if twins[one.name].isdisjoint(other.name for other in some):
                some.append(one)
        yield tuple(some)
