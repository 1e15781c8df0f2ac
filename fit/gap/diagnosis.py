"""Run a diagnosis: gates, base fit, noise floor, screening, refits, verdict (`docs/reference/diagnosis.md`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from fit.cloth.effect import Effect
from fit.cloth.model import Resolution
from fit.effects import LIBRARY
from fit.errors import FitError, nearest_first
from fit.gap import edge_driven, from_raw
from fit.gap import findings as described
from fit.gap import gates as gate
from fit.gap.base_fit import fit_base
from fit.gap.checkpoint import Checkpoint, Key
from fit.gap.closure import closure, exceeds, resample
from fit.gap.fitting import Fitted
from fit.gap.floor import noise_floor
from fit.gap.missing_force import find_missing_force
from fit.gap.next_experiment import propose
from fit.gap.numerics import refine
from fit.gap.power import hidden_beside
from fit.gap.rounds import Rounds
from fit.gap.verdict import decide
from fit.gap.weighed import decide_by_mass, inclusion, weigh
from fit.gap.where import find_where
from fit.methods import SI, Parameterisation
from fit.observer.edge import is_edge_explained
from fit.observer.residuals import Observer
from fit.provenance import physics_version
from fit.recordings.camera_findings import camera_clause, describe_camera
from fit.recordings.intact import describe_flaws, naming_damage
from fit.recordings.ready import Ready, ready
from fit.recordings.recording import Recording
from fit.runtime import one_thread_of_algebra
from formats.diagnosis_records import Cost, Diagnosis
from formats.fault_words import state_of_take
from formats.fit_records import held_out_option
from formats.take import Take

Progress = Callable[[str, float], None]
Deciding = Literal["rules", "evidence"]

# Across the smaller side of the garment. Our choice: 0.36 m get 40 mm, between two meshes of decision 5. One of 50 mm
# left 4.8 to 6.0 mm where the noise is 4 mm, and one of 35 mm 4.0 to 4.3 mm. Half and double were not tried.
CELLS_ACROSS = 9
FINEST, COARSEST = 0.02, 0.06  # m, of the automatically chosen mesh


@dataclass(frozen=True)
class Findings:
    """A diagnosis with its takes, base fit and named fit, for the report."""

    diagnosis: Diagnosis
    takes: Ready
    base: Fitted
    best: Fitted | None
    effects: tuple[Effect, ...]
    model: Parameterisation
    resolution: Resolution
    frequency: float  # Hz, of the observer's pull


@one_thread_of_algebra()
def diagnose(
    training: list[Take],
    held_out: list[Take],
    *,
    effects: tuple[Effect, ...] = LIBRARY,
    model: Parameterisation = SI,
    added: tuple[str, ...] = (),
    checkpoint: Path | None = None,
    resolution: Resolution | None = None,
    seed: int = 0,
    prepared: Ready | None = None,
    by: Deciding = "rules",
    progress: Progress = lambda stage, share: None,
    begun: Callable[[], None] = lambda: None,
) -> Findings:
    """Diagnose the gap between takes and the base model.

    - `effects`: the library
    - `added`: names of effects that are refitted and shown even if screening finds nothing
    - `checkpoint`: folder of finished fits; the caller deletes it when the result is safe
    - `prepared`: the result of `ready` for these takes, if the caller has it already
    - `by`: the decision method: `rules`, or the `evidence` of every set of effects (`fit.gap.weighed`)
    - `begun`: called after all checks of the takes, before the first simulation

    Raises:
        FitError: as `ready`, every effect is part of the base model, or a checkpoint of other takes or versions.
    """
    if {effect.in_base for effect in effects} <= {parameter.name for parameter in model.parameters}:
        raise FitError(
            "no effect is left to test: the base model contains each of them", where="--without",
            advice="leave out fewer",
        )  # fmt: skip
    if prepared is None:
        progress("reading the takes", 0.0)
    takes, added = prepared or ready(training, held_out), tuple(sorted(set(added)))
    train, test = takes.training, takes.held_out
    training, held_out = takes.in_order(training, held_out)
    rng = np.random.default_rng(seed)
    found_gates = gate.data_gates(train, test)
    resolution = resolution or fine_enough(train[0])
    with naming_damage([*training, *held_out]):
        observer = simulated = Observer(train, model, effects, frequency=0.0, resolution=resolution)
        key = _key(takes, added, observer, seed, by)
        kept = Checkpoint(checkpoint, key, lambda: simulated.simulations)
        begun()
        fits, observer, predictability = fit_base(observer, progress, kept, seed)
        judge = observer.of(test) if test else observer
    search = Rounds(observer, judge, fits, progress, kept)
    progress("estimating the noise floor", 0.3)
    noise = noise_floor(judge, search.base.fitted.vector, observer.off, rng)
    before = search.base
    resampling = resample(before.errors, rng)
    is_off = exceeds(before.errors, resampling, noise.mm**2) or not is_edge_explained(before.errors.edge)
    found = refined = None
    if by == "evidence":
        refined = refine(observer, judge, before.fitted)
        found = weigh(search, noise, refined, added)
    else:
        search.first_round(added, has_gap=is_off)
    if search.base is not before:
        resampling = resample(search.base.errors, rng)
    if (quietest := search.least_chosen) is not before.fitted:
        # The same draws again: two floors then differ by the model alone.
        noise = noise_floor(judge, quietest.vector, quietest.amplitudes, np.random.default_rng(seed))
    if not predictability.passed:
        predictability = search.predictability()
    found_gates += [predictability, gate.convergence_gate(search.fits, search.least.cost)]
    progress("estimating the mesh error", 0.83)
    base = search.base.fitted
    refined = refined if refined and search.base is before else refine(observer, judge, base)
    mesh_closure = closure(search.base.errors, refined.errors, noise.mm)
    removed = mesh_closure[0] if mesh_closure else None
    found_gates.append(gate.numerics_gate(removed, refined.numerics_mm, refined.ratio))
    if found is None:
        search.sizes_by_edge(refined.numerics_mm)
    evidence = search.evidence(noise, refined, resampling, found_gates, is_held_out=bool(test))
    verdict = decide(evidence) if found is None else decide_by_mass(evidence, found)
    # Two effects may hide each other, so that neither passes alone. So pairs are tried if no single effect suffices.
    may_be_several = verdict.verdict in {"effect", "ambiguous", "unknown"} and evidence.is_predictable
    if found is None and may_be_several and search.singles:
        progress("looking for a second effect", 0.88)
        search.further_rounds(noise.mm, refined.numerics_mm)
        evidence = search.evidence(noise, refined, resampling, found_gates, is_held_out=bool(test))
        verdict = decide(evidence)
    by_edge = None
    if verdict.verdict == "unknown" and not is_edge_explained(search.base.errors.edge):
        progress("simulating from the tracked held edge", 0.92)
        by_edge = edge_driven.held_by_edge(observer, judge, base, kept)
    raw_mm = from_raw.raw_error_mm(observer, judge, training, held_out, base, kept)
    progress("choosing the next recording", 0.93)
    proposal = propose(observer, base, *search.alive(evidence, verdict))
    progress("estimating the missing force", 0.97)
    missing_force = find_missing_force(judge, base.vector)
    best, spent = search.named(verdict), kept.spent
    notes = described.notes(
        len(training), len(held_out), observer, noise, is_predictable=predictability.passed, by=by,
        is_from_effect=search.base is not before if found else bool(search.singles),
    )  # fmt: skip
    notes += describe_flaws([*training, *held_out])
    notes += described.unseparated(verdict.verdict, proposal)
    notes += hidden_beside(evidence, {*verdict.named, *(k for twins in verdict.alternatives.values() for k in twins)})
    camera = describe_camera(train + test)
    gap = from_raw.with_raw(described.describe_gap(evidence, best, by_edge), raw_mm)
    diagnosis = Diagnosis(
        format="hangtime-diagnosis/1",
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        take_ids=[t.take_id for t in training],
        held_out_ids=[t.take_id for t in held_out],
        verdict=verdict.verdict,  # type: ignore[arg-type]
        sentence=verdict.sentence
        + edge_driven.sentence(evidence, by_edge)
        + described.left_out(effects, LIBRARY)
        + described.at_bounds(model, base)
        + camera_clause(camera, verdict.sentence)
        + from_raw.sentence(gap),
        named=verdict.named,
        gap=gap,
        effects=described.describe_effects(
            evidence, best, effects, model, inclusion(found) if found else None, shows_gap=verdict.shows_gap
        ),
        where=find_where(judge, judge.residuals(base.vector[None], observer.off[None])[0]),
        missing_force=missing_force,
        next_experiment=proposal,
        gates=found_gates,
        cost=Cost(simulations=spent[0], seconds=spent[1]),
        base_parameters=described.base_parameters(model, described.alike_ends(observer, base, search.fits)),
        notes=notes,
        alternatives=verdict.alternatives,
        take_contents=takes.contents,
        camera=camera,
        take_states=[state_of_take(take) for take in (*training, *held_out)],
        options={
            "--model": model.name,
            "--by": by,
            "--spacing": resolution.spacing,
            "--seed": seed,
            "--add": " ".join(added),
            **held_out_option(takes.held_out_contents),
        },
    )
    progress("done", 1.0)
    return Findings(
        diagnosis, takes, base, best.fitted if best else None, effects, model, resolution, observer.frequency
    )


def deciding(name: str) -> Deciding:
    """Return the decision method of this name.

    Raises:
        FitError: there is no such method.
    """
    for known in get_args(Deciding):
        if name == known:
            return known  # type: ignore[no-any-return]
    raise FitError(
        f"{name} is no way to decide", where="--by", advice=nearest_first(name, get_args(Deciding), "choose one of")
    )


def fine_enough(recording: Recording) -> Resolution:
    """Return the mesh that a diagnosis needs: a ninth of the garment's smaller side.

    On cloth of an independent simulator without any effect this leaves errors at the noise
    (`docs/reference/blind-check.md`).
    """
    side = float(np.ptp(np.array(recording.garment.outline_m), axis=0).min())
    return Resolution(spacing=float(np.clip(round(side / CELLS_ACROSS, 3), FINEST, COARSEST)))


def _key(takes: Ready, added: tuple[str, ...], observer: Observer, seed: int, by: str = "rules") -> Key:
    return {
        "takes": takes.contents, "held_out": takes.held_out_contents, "model": observer.parameterisation.name,
        "added": list(added), "effects": [e.name for e in observer.effects], "seed": seed, "by": by,
        "spacing": observer.resolution.spacing, "physics": physics_version(),
    }  # fmt: skip
