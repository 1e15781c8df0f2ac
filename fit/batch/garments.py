"""Sort the takes of a night by garment, and say which garments can be diagnosed and what the others lack.

A diagnosis fits to some motions and judges on another one, so it needs takes of two kinds of motion of one garment
(`formats.motion`). The kind with the fewest takes is held out, so that as many as possible are fitted to. Takes whose
hanger stands still show nothing to fit, and a sensor whose rig was never calibrated cannot be diagnosed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from fit.batch.jobs import DiagnosisJob, Outcome, diagnosis_key, failure_name
from fit.batch.kept import has_diagnosis
from fit.batch.runner import Survey, kept_sentence
from fit.batch.store import Store
from fit.batch.summary import Row
from fit.provenance import physics_version
from formats.archive import take_of
from formats.garment import Garment
from formats.motion import kind_of

# Of kinds with as few takes: cloth that is swung face-on is bent and slowed most, so such takes are fitted to.
JUDGED_FIRST = ("sideways", "up-and-down", "twist", "mixed", "face-on")
OTHER_MOTION = (
    "record another kind of motion: swing it sideways, face-on, up and down, or twist it, at two strengths each"
)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A take of the night: its name, the sha256 of its bytes, its kind of motion, whether its rig was calibrated."""

    name: str
    digest: str
    kind: str
    is_calibrated: bool


@dataclass(frozen=True, kw_only=True)
class Wardrobe:
    """A garment with its takes, and with the takes to fit to and to judge on, or what it lacks for a diagnosis."""

    name: str
    takes: tuple[Seen, ...]
    training: tuple[Seen, ...] = ()
    held_out: tuple[Seen, ...] = ()
    missing: str = ""


def wardrobe_of(name: str, takes: Sequence[Seen]) -> Wardrobe:
    """Return a garment's takes, sorted into those to fit to and those to judge on where there are enough."""
    every = tuple(takes)
    calibrated = [take for take in every if take.is_calibrated]
    moving = [take for take in calibrated if take.kind != "still"]
    kinds = Counter(take.kind for take in moving)
    if not calibrated:
        lack = "its rig was never calibrated; run `hangtime calibrate`, then record again with the calibrated rig"
        return Wardrobe(name=name, takes=every, missing=lack)
    if not moving:
        return Wardrobe(name=name, takes=every, missing=f"in no take does its hanger move; {OTHER_MOTION}")
    if len(kinds) == 1:
        (kind,) = kinds
        count = f"its {len(moving)} takes all move" if len(moving) > 1 else "its only take moves"
        return Wardrobe(name=name, takes=every, missing=f"{count} {kind}, and none is left to judge on; {OTHER_MOTION}")
    judged = min(kinds, key=lambda kind: (kinds[kind], JUDGED_FIRST.index(kind)))
    return Wardrobe(
        name=name, takes=every,
        training=tuple(take for take in moving if take.kind != judged),
        held_out=tuple(take for take in moving if take.kind == judged),
    )  # fmt: skip


def wardrobes(rows: Sequence[Row], found: Survey, takes: Store) -> list[Wardrobe]:
    """Return the garments of the takes that were fitted, in the order in which they first appear.

    Raises:
        BatchError, UnreachableError: a take cannot be read any more.
    """
    by_garment: list[tuple[Garment, list[Seen]]] = []
    digests = set()
    for row in rows:
        digest = found.digests.get(row.take, "")
        if row.state not in ("fitted", "known") or digest in digests:
            continue
        digests.add(digest)
        take = take_of(takes.read(row.take), row.take)
        is_calibrated = take.rig.sensor is None or take.rig.calibration is not None
        seen = Seen(name=row.take, digest=digest, kind=kind_of(take), is_calibrated=is_calibrated)
        same = next((others for garment, others in by_garment if garment == take.garment), None)
        if same is None:
            by_garment.append((take.garment, [seen]))
        else:
            same.append(seen)
    names = _distinct([garment.name for garment, _ in by_garment])
    return [wardrobe_of(name, seen) for name, (_, seen) in zip(names, by_garment, strict=True)]


def diagnoses_of(
    every: Sequence[Wardrobe],
    takes: Store,
    results: Store,
    seed: int,
    *,
    retry_failed: bool = False,
    anyway: bool = False,
) -> Survey:
    """Return the diagnoses that are known, that failed, and that are still to be made, by the garment's name.

    Raises:
        UnreachableError: the results cannot be reached now.
    """
    from fit.batch.diagnosing import run_diagnosis

    physics, found = physics_version(), Survey(work=run_diagnosis)
    for one in every:
        if one.missing:
            continue
        training, held_out = ([take.digest for take in part] for part in (one.training, one.held_out))
        key = diagnosis_key(training, held_out, seed, physics)
        found.keys[one.name] = key
        why = kept_sentence(results, key) if results.has(failure_name(key)) and not retry_failed else None
        if has_diagnosis(results, key):
            found.outcomes[key] = Outcome(key=key, state="diagnosed")
        elif why is not None:
            found.outcomes[key] = Outcome(key=key, state="failed", sentence=why)
        else:
            found.jobs.append(
                DiagnosisJob(
                    key=key, takes_url=takes.url, results_url=results.url, physics=physics, seed=seed,
                    anyway=anyway,
                    training=tuple(take.name for take in one.training),
                    held_out=tuple(take.name for take in one.held_out), digests=(*training, *held_out),
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
