"""Group a batch's takes by garment, and split each group into fitted and held-out takes if there are enough.

A diagnosis fits to some motions and judges on another one of the same garment. Two rules choose the held-out motion:

- Of a kind of motion (`formats.motion`) at three strengths or more, the middle strength is judged on. A fit to one
  strength cannot tell drag, which grows with the square of speed, from linear damping. So both ends are fitted to.
- Else the takes need two kinds. The one that shows least of the cloth is judged on. A kind counts by its seconds, times
  the share of the error that a fit to this kind removes (`ERROR_REMOVED`).

Takes whose hanger stands still show nothing to fit, and a sensor whose rig was never calibrated cannot be diagnosed.
One take that is too short would end the diagnosis of all, so it is left out as well. So would two takes that share
frames of one recording, such as a take and a cut or filtered copy of it. `fit.batch.twins` chooses which one stays.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

from fit.batch.jobs import DiagnosisJob, diagnosis_key, diagnosis_name, failure_name, report_name
from fit.batch.kept import has_diagnosis, known_outcome
from fit.batch.runner import Survey, kept_sentence
from fit.batch.store import Store
from fit.batch.summary import Row, short_name
from fit.batch.twins import Twins, left_out, sharing
from fit.provenance import physics_version
from formats.archive import take_of
from formats.findings import SHORTEST_DIAGNOSED
from formats.garment import Garment
from formats.motion import kind_of, reach_of

if TYPE_CHECKING:
    from fit.recordings.copies import Track

# Fits of the skirt remove this share of the mean error on motion of each kind. Source: `benchmarks/skirt.py`, with
# 72 to 85 % on swings, 60 % on mixed motion, and 10 to 40 % on twists. The two other kinds were not measured; they bend
# cloth as little as twists. Of kinds that count alike, the first one is judged on.
ERROR_REMOVED = {"sideways": 0.25, "up-and-down": 0.25, "twist": 0.25, "mixed": 0.6, "face-on": 0.8}
STRONGER = 1.3  # ratio of amplitudes from which two motions differ in strength; hands repeat a swing within a fifth
FEWEST_STRENGTHS = 3  # strengths of one kind: a middle one to judge on, and one on either side to fit to
OTHER_MOTION = (
    "swing it face-on gently, widely, and in between; or record another kind of motion, such as sideways or a twist"
)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A take of the batch.

    - `name`, and `digest`: the sha256 of its bytes
    - `kind` of motion, and `reach` [m]: root mean square of the hanger's motion in all ways
    - `seconds` [s]: its length
    - `is_calibrated`: whether its rig was
    - `damage`: the take's missing parts and damage, with the next step; '' for a whole take
    - `copy_of`: name of an earlier file with the same recording; '' without one
    - `twin_of`: names of takes that hold frames of the same recording, and stay
    """

    name: str
    digest: str
    kind: str
    reach: float
    seconds: float
    is_calibrated: bool
    damage: str = ""
    copy_of: str = ""
    twin_of: tuple[str, ...] = ()

    @property
    def why_left_out(self) -> str:
        """The reason why a diagnosis leaves this take out; '' for a take that can be used."""
        if self.copy_of:
            return f"{self.copy_of} is the same recording"
        if self.twin_of:
            return sharing(self.twin_of)
        if not self.is_calibrated:
            return "its rig was never calibrated"
        if self.kind == "still":
            return "its hanger stands still"
        if self.seconds < SHORTEST_DIAGNOSED:
            return (
                f"it lasts {math.floor(100 * self.seconds) / 100:g} s, and a diagnosis needs {SHORTEST_DIAGNOSED:g} s"
            )
        return ""


@dataclass(frozen=True, kw_only=True)
class Wardrobe:
    """A garment with its takes, split into fitted and held-out ones, or the reason why it cannot be diagnosed.

    copies: files whose recording another file contains, such as recovered and cut files; they are not among `takes`
    """

    name: str
    takes: tuple[Seen, ...]
    training: tuple[Seen, ...] = ()
    held_out: tuple[Seen, ...] = ()
    missing: str = ""
    copies: tuple[Seen, ...] = ()


def wardrobe_of(name: str, takes: Sequence[Seen]) -> Wardrobe:
    """Return a garment's takes, split into fitted and held-out ones if there are enough."""
    every = tuple(takes)
    calibrated = [take for take in every if take.is_calibrated]
    swung = [take for take in calibrated if take.kind != "still"]
    moving = [take for take in swung if not take.why_left_out]
    kinds: defaultdict[str, float] = defaultdict(float)
    for take in moving:
        kinds[take.kind] += take.seconds
    if not calibrated:
        lack = "its rig was never calibrated; run `hangtime calibrate`, then record again with the calibrated rig"
        return Wardrobe(name=name, takes=every, missing=lack)
    if not swung:
        lack = f"in no take does its hanger move; {OTHER_MOTION}"
        return Wardrobe(name=name, takes=every, missing=_with_damage(lack, calibrated))
    if not moving:
        lack = f"no take in which its hanger moves lasts {SHORTEST_DIAGNOSED:g} s; record longer"
        return Wardrobe(name=name, takes=every, missing=_with_damage(lack, calibrated))
    middle = _middle_strength(moving)
    if len(kinds) == 1 and not middle:
        (kind,) = kinds
        count = f"its {len(moving)} takes all move" if len(moving) > 1 else "its only take moves"
        lack = f"{count} {kind}, and none is left to judge on; {OTHER_MOTION}"
        return Wardrobe(name=name, takes=every, missing=_with_damage(lack, calibrated))
    judged = min(kinds, key=lambda kind: (ERROR_REMOVED[kind] * kinds[kind], list(ERROR_REMOVED).index(kind)))
    held_out = middle or [take for take in moving if take.kind == judged]
    return Wardrobe(
        name=name, takes=every, training=tuple(take for take in moving if take not in held_out),
        held_out=tuple(held_out),
    )  # fmt: skip


def _with_damage(lack: str, takes: Sequence[Seen]) -> str:
    """Return why takes cannot be diagnosed, and their damage, which may be the cause."""
    return "; ".join([lack, *(take.damage for take in takes if take.damage)])


def _middle_strength(takes: Sequence[Seen]) -> list[Seen]:
    """Return the takes of middle strength, of the most informative kind of motion with enough strengths."""
    for kind in sorted({take.kind for take in takes}, key=list(ERROR_REMOVED).index, reverse=True):
        strengths: list[list[Seen]] = []
        for take in sorted((take for take in takes if take.kind == kind), key=lambda take: take.reach):
            if not strengths or take.reach > STRONGER * strengths[-1][0].reach:
                strengths.append([])
            strengths[-1].append(take)
        if len(strengths) >= FEWEST_STRENGTHS:
            return strengths[len(strengths) // 2]
    return []


def wardrobes(
    rows: Sequence[Row], found: Survey, takes: Store, is_known: Callable[[Wardrobe], bool] = lambda _: False
) -> list[Wardrobe]:
    """Return the garments of the takes that were fitted, in the order in which they first appear.

    A take whose recording an earlier file contains, such as a recovered file, is left out, as it adds no information.
    So is one of two takes of a garment that share frames (`fit.batch.twins`).

    is_known: whether the results hold the diagnosis of a garment's takes

    Raises:
        BatchError, UnreachableError: a take cannot be read any more.
    """
    from fit.recordings.copies import Track
    from fit.recordings.intact import damage_of
    from fit.recordings.selection import content_of

    by_garment: list[tuple[Garment, list[tuple[Seen, Track]]]] = []
    first_of: dict[str, str] = {}  # the first file by its digest, and by the content of its take
    for row in rows:
        if row.state not in ("fitted", "known"):
            continue
        digest = found.digests.get(row.take, "")
        take = take_of(takes.read(row.take), row.take)
        first = first_of.get(digest) or first_of.get(content_of(take)) or row.take
        first_of |= {digest: first, content_of(take): first}
        is_calibrated = take.rig.sensor is None or take.rig.calibration is not None
        seconds = float(take.time[-1] - take.time[0]) if len(take.time) else 0.0
        seen = Seen(
            name=row.take, digest=digest, kind=kind_of(take), reach=math.hypot(*reach_of(take).values()),
            seconds=seconds, is_calibrated=is_calibrated, damage=damage_of([take]),
            copy_of=short_name(first) if first != row.take else "",
        )  # fmt: skip
        same = next((others for garment, others in by_garment if garment.as_meant == take.garment.as_meant), None)
        if same is None:
            by_garment.append((take.garment, [(seen, Track(take))]))
        else:
            same.append((seen, Track(take)))
    names = _distinct([garment.name for garment, _ in by_garment])
    return [_wardrobe(name, twins_named(pairs, is_known)) for name, (_, pairs) in zip(names, by_garment, strict=True)]


def twins_named(pairs: Sequence[tuple[Seen, Track]], is_known: Callable[[Wardrobe], bool]) -> list[Seen]:
    """Return a garment's takes, in their order; each that shares frames with ones that stay names these."""
    from fit.recordings.copies import are_copies

    used = [(seen, track) for seen, track in pairs if not seen.why_left_out]
    twins: Twins = {seen.name: set() for seen, _ in used}
    for (one, its), (other, others) in combinations(used, 2):
        if are_copies(its, others):
            twins[one.name].add(other.name)
            twins[other.name].add(one.name)
    out = left_out(
        [seen for seen, _ in used], twins, can=lambda some: not wardrobe_of("", some).missing,
        known=lambda some: is_known(wardrobe_of("", some)),
    )  # fmt: skip
    return [replace(seen, twin_of=tuple(out.get(seen.name, ()))) for seen, _ in pairs]


def _wardrobe(name: str, every: Sequence[Seen]) -> Wardrobe:
    """Return a garment's takes without copies and twins; a twin is named where too few takes are left."""
    copies = tuple(take for take in every if take.copy_of or take.twin_of)
    made = wardrobe_of(name, [take for take in every if take not in copies])
    twins = [f"{short_name(take.name)} is left out: {take.why_left_out}" for take in copies if take.twin_of]
    return replace(made, copies=copies, missing="; ".join([made.missing, *twins]) if made.missing else "")


def is_diagnosed(one: Wardrobe, results: Store, seed: int) -> bool:
    """Return whether the results hold the diagnosis of a garment's takes, or the reason why it failed.

    Raises:
        UnreachableError: the results cannot be reached now.
    """
    key = _key_of(one, seed, physics_version())
    return not one.missing and any(results.has(name) for name in (diagnosis_name(key), failure_name(key)))


def _key_of(one: Wardrobe, seed: int, physics: str) -> str:
    training, held_out = ([take.digest for take in part] for part in (one.training, one.held_out))
    return diagnosis_key(training, held_out, seed, physics)


def diagnoses_of(
    every: Sequence[Wardrobe],
    takes: Store,
    results: Store,
    seed: int,
    *,
    retry_failed: bool = False,
    anyway: bool = False,
) -> Survey:
    """Return the finished, the failed and the outstanding diagnoses, by the garment's name.

    Raises:
        UnreachableError: the results cannot be reached now.
    """
    from fit.batch.diagnosing import run_diagnosis

    physics, found = physics_version(), Survey(work=run_diagnosis)
    for one in every:
        if one.missing:
            continue
        key = _key_of(one, seed, physics)
        found.keys[one.name] = key
        why = kept_sentence(results, key) if results.has(failure_name(key)) and not retry_failed else None
        known = known_outcome(results, key, has_diagnosis, "diagnosed", why, [diagnosis_name(key), report_name(key)])
        if known is not None:
            found.outcomes[key] = known
        else:
            found.jobs.append(
                DiagnosisJob(
                    key=key, takes_url=takes.url, results_url=results.url, physics=physics, seed=seed,
                    anyway=anyway,
                    training=tuple(take.name for take in one.training),
                    held_out=tuple(take.name for take in one.held_out),
                    digests=tuple(take.digest for take in (*one.training, *one.held_out)),
                )
            )  # fmt: skip
    return found


def _distinct(names: list[str]) -> list[str]:
    """Number garments of one name, whose descriptions differ."""
    counts, met = Counter(names), Counter[str]()
    shown = []
    for name in names:
        met[name] += 1
        shown.append(f"{name} ({met[name]})" if counts[name] > 1 else name)
    return shown
