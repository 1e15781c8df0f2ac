"""The whole diagnosis, in the order of `docs/diagnosis.md`: gates, base fit, floor, screening, refits, verdict."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from fit.cloth.simulator import Resolution
from fit.effects import LIBRARY
from fit.effects.base import Effect
from fit.errors import FitError
from fit.gap import gates as gate
from fit.gap.closure import BlockErrors, block_errors, bootstrap_picks, closure, error_interval
from fit.gap.fitting import Fitted, amplitude_interval, fit
from fit.gap.floor import noise_floor
from fit.gap.missing_force import find_missing_force
from fit.gap.observer import Observer
from fit.gap.screening import Screened, groups, screen
from fit.gap.verdict import decide
from fit.gap.where import find_where
from fit.parameterisations import SI
from fit.recording import Recording, prepare
from formats.results import Cost, Diagnosis, EffectFinding, Figure, FitParameter, Gap, Gate
from formats.take import Take

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]

FIRST_FREQUENCY = 3.0  # Hz: strong enough that every start finds the basin


@dataclass(frozen=True)
class Findings:
    """A diagnosis and the two fits it rests on, for the report."""

    diagnosis: Diagnosis
    base: Fitted
    best: Fitted | None
    effects: tuple[Effect, ...]


def diagnose(
    training: list[Take],
    held_out: list[Take],
    *,
    effects: tuple[Effect, ...] = LIBRARY,
    resolution: Resolution | None = None,
    seed: int = 0,
    progress: Progress = lambda stage, share: None,
) -> Findings:
    """Diagnose the gap between takes and the base model.

    Raises:
        FitError: no take, or takes of different garments.
    """
    started = clock.monotonic()
    _check_same_garment(training + held_out)
    rng = np.random.default_rng(seed)
    progress("reading takes", 0.0)
    train = [prepare(t) for t in training]
    test = [prepare(t) for t in held_out]
    found_gates = gate.data_gates(train + test)
    observer = Observer(train, SI, effects, frequency=FIRST_FREQUENCY, resolution=resolution)
    judge = Observer(test, SI, effects, frequency=FIRST_FREQUENCY, resolution=resolution) if test else observer

    base, fits, observer, predictability = _fit_base(observer, progress)
    judge = judge.with_frequency(observer.frequency)
    progress("refitting with each effect", 0.45)
    screened = screen(observer, base, rng)
    refits = _refit_each(observer, base, screened, progress)
    fits = _fair_base(observer, fits, refits)
    base = min(fits, key=lambda f: f.cost)
    found_gates += [predictability, gate.convergence_gate(fits)]

    progress("judging on held-out motion" if test else "judging", 0.9)
    off = np.zeros(len(effects))
    floor, floor_error = noise_floor(judge, base.vector, off, rng)
    base_errors = _errors(judge, base)
    effect_errors = [_errors(judge, f) for f in refits]
    picks = bootstrap_picks(base_errors, rng)
    findings = _findings(observer, screened, refits, base_errors, effect_errors, floor, picks)
    progress("checking mesh and step", 0.93)
    fine_errors, fine_simulations = _refined(train, test, effects, observer, base)
    mesh_closure = closure(base_errors, fine_errors, floor, picks)
    found_gates.append(gate.numerics_gate(mesh_closure[0] if mesh_closure else None))
    order = sorted(range(len(effects)), key=lambda k: effect_errors[k].squared_mm)
    best = order[0] if order else None
    gap = _gap(base_errors, effect_errors, best, findings, floor, floor_error, picks, bool(test))
    verdict = decide(gap, findings, _win_shares(effects, effect_errors, picks), found_gates, effects)
    if verdict.verdict not in {"effect", "ambiguous"}:
        gap = replace_gap(gap)
    progress("drawing maps", 0.95)
    residual = judge.residuals(base.vector[None], off[None])[0]
    force = find_missing_force(judge, base.vector)
    progress("done", 1.0)
    diagnosis = Diagnosis(
        format="hangtime-diagnosis/1",
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        take_ids=[t.take_id for t in training],
        held_out_ids=[t.take_id for t in held_out],
        verdict=verdict.verdict,  # type: ignore[arg-type]
        sentence=verdict.sentence,
        named=verdict.named,
        gap=gap,
        effects=sorted(findings, key=lambda f: -(f.closure.value if f.closure else -1.0)),
        where=find_where(judge, residual),
        missing_force=force,
        next_experiment=None,
        gates=found_gates,
        cost=Cost(
            simulations=observer.simulations + (judge.simulations if test else 0) + fine_simulations,
            seconds=clock.monotonic() - started,
        ),
        base_parameters=base_parameters(observer, base),
        notes=_notes(training, held_out, observer),
    )
    return Findings(diagnosis, base, refits[best] if best is not None else None, effects)


def _check_same_garment(takes: list[Take]) -> None:
    if not takes:
        raise FitError("no take was given", advice="name at least one take archive")
    for take in takes[1:]:
        if take.garment != takes[0].garment:
            raise FitError(
                f"takes of different garments: {takes[0].garment.name!r} and {take.garment.name!r}",
                where=take.take_id,
                advice="diagnose one garment at a time",
            )


def _fit_base(observer: Observer, progress: Progress) -> tuple[Fitted, list[Fitted], Observer, Gate]:
    """Fit the base model from several starts, then under the weakest pull that keeps the takes predictable."""
    initial = SI.initial
    starts = [initial]
    for bending, damping in ((4.0, 3.0), (0.3, 2.0)):
        start = initial.copy()
        start[2] *= bending
        start[4] *= damping
        starts.append(start)
    off = np.zeros(len(observer.effects))
    rough = []
    for k, start in enumerate(starts):
        progress(f"base fit, start {k + 1} of {len(starts)}", 0.02 + 0.08 * k)
        rough.append(fit(observer, start, off, iterations=4))
    best = min(rough, key=lambda f: f.cost)
    frequency, predictability = gate.choose_frequency(observer, best.vector)
    weaker = observer.with_frequency(frequency)
    fits = []
    for k, one in enumerate(rough):
        progress(f"base fit, start {k + 1} of {len(rough)}, pull {frequency:g} Hz", 0.25 + 0.06 * k)
        fits.append(fit(weaker, one.vector, off))
    base = min(fits, key=lambda f: f.cost)
    # A take can be predictable at the rough fit and not at the final one.
    frequency, predictability = gate.choose_frequency(observer, base.vector)
    if frequency > weaker.frequency:
        weaker = observer.with_frequency(frequency)
        fits = [fit(weaker, one.vector, off) for one in fits]
        base = min(fits, key=lambda f: f.cost)
    return base, fits, weaker, predictability


def _refit_each(observer: Observer, base: Fitted, screened: Screened, progress: Progress) -> list[Fitted]:
    """Refit base parameters jointly with each effect, from the screened amplitude or a third of the typical one."""
    refits = []
    for k, effect in enumerate(observer.effects):
        progress(f"refitting with {effect.title}", 0.45 + 0.4 * k / len(observer.effects))
        guess = float(np.clip(screened.amplitude[k], effect.low, effect.high))
        start = np.zeros(len(observer.effects))
        start[k] = np.copysign(max(abs(guess), 0.3 * effect.typical), guess)
        refits.append(fit(observer, base.vector, start, (k,)))
    return refits


def _fair_base(observer: Observer, fits: list[Fitted], refits: list[Fitted]) -> list[Fitted]:
    """Give the base model the same second chance: refit it from where the best effect's refit ended."""
    best = min(refits, key=lambda f: f.cost)
    return [*fits, fit(observer, best.vector, np.zeros(len(observer.effects)))]


def _errors(judge: Observer, fitted: Fitted) -> BlockErrors:
    return block_errors(judge, judge.residuals(fitted.vector[None], fitted.amplitudes[None])[0])


def _findings(
    observer: Observer, screened: Screened, refits: list[Fitted], base_errors: BlockErrors,
    effect_errors: list[BlockErrors], floor: float, picks: NDArray[np.int64],
) -> list[EffectFinding]:  # fmt: skip
    group = groups(screened.cosines)
    shares = _win_shares(observer.effects, effect_errors, picks)
    findings = []
    for k, effect in enumerate(observer.effects):
        closed = closure(base_errors, effect_errors[k], floor, picks)
        findings.append(
            EffectFinding(
                id=effect.name,
                group=observer.effects[group[k]].name,
                tested=True,
                probability=None,
                amplitude=float(refits[k].amplitudes[k]),
                amplitude_interval=amplitude_interval(refits[k], observer, k),
                unit=effect.unit,
                closure=Figure(value=closed[0], interval=closed[1]) if closed else None,
                p_value=float(screened.p_value[k]),
                minimum_detectable=float(screened.minimum_detectable[k]),
                explained=float(screened.explained[k]),
                absorbed=float(screened.absorbed[k]),
                note=f"best effect in {100 * shares[effect.name]:.0f} % of bootstrap draws",
            )
        )
    return findings


def _win_shares(effects: tuple[Effect, ...], errors: list[BlockErrors], picks: NDArray[np.int64]) -> dict[str, float]:
    """Share of bootstrap draws of the held-out blocks in which each effect leaves the smallest error."""
    drawn = np.stack([e.draw(picks) for e in errors])
    winners = np.argmin(drawn, axis=0)
    return {e.name: float(np.mean(winners == k)) for k, e in enumerate(effects)}


def _refined(
    train: list[Recording], test: list[Recording], effects: tuple[Effect, ...], observer: Observer, base: Fitted
) -> tuple[BlockErrors, int]:
    """Refit the base model on a finer mesh and judge it on the same motion; also return the simulations it took."""
    resolution = gate.finer(observer.resolution)
    fine = Observer(train, SI, effects, frequency=observer.frequency, resolution=resolution)
    fitted = fit(fine, base.vector, base.amplitudes, iterations=3)
    judge = Observer(test, SI, effects, frequency=observer.frequency, resolution=resolution) if test else fine
    return _errors(judge, fitted), fine.simulations + (judge.simulations if test else 0)


def _gap(
    base: BlockErrors, errors: list[BlockErrors], best: int | None, findings: list[EffectFinding],
    floor: float, floor_error: float, picks: NDArray[np.int64], is_held_out: bool,
) -> Gap:  # fmt: skip
    after = errors[best] if best is not None else None
    return Gap(
        base_mm=Figure(value=float(np.sqrt(base.squared_mm)), interval=error_interval(base, picks)),
        with_effect_mm=Figure(value=float(np.sqrt(after.squared_mm)), interval=error_interval(after, picks))
        if after
        else None,
        floor_mm=Figure(value=floor, interval=(max(floor - 1.645 * floor_error, 0.0), floor + 1.645 * floor_error)),
        closure=findings[best].closure if best is not None else None,
        is_held_out=is_held_out,
    )


def replace_gap(gap: Gap) -> Gap:
    """Return the gap without the figures of an effect that the verdict does not name."""
    return Gap(
        base_mm=gap.base_mm, with_effect_mm=None, floor_mm=gap.floor_mm, closure=None, is_held_out=gap.is_held_out
    )


def base_parameters(observer: Observer, fitted: Fitted) -> list[FitParameter]:
    """Describe the fitted base parameters with 90 % intervals."""
    described = []
    for k, parameter in enumerate(SI.parameters):
        value, spread = float(fitted.vector[k]), 1.645 * float(fitted.deviation[k])
        low, high = (
            (value * np.exp(-spread), value * np.exp(spread)) if parameter.is_log else (value - spread, value + spread)
        )
        low, high = max(low, parameter.minimum), min(high, parameter.maximum)
        is_identified = bool(spread < 0.7) if parameter.is_log else None
        described.append(
            FitParameter(
                name=parameter.name,
                unit=parameter.unit,
                initial=parameter.initial,
                fitted=value,
                minimum=parameter.minimum,
                maximum=parameter.maximum,
                interval_low=float(low),
                interval_high=float(high),
                is_identified=is_identified,
                note=parameter.meaning,
            )
        )
    return described


def _notes(training: list[Take], held_out: list[Take], observer: Observer) -> list[str]:
    how = (
        f"Observer pull of {observer.frequency:g} Hz"
        if observer.frequency
        else "Free rollouts, predictable as they are"
    )
    notes = [
        f"{how}; mesh of {1e3 * observer.resolution.spacing:.0f} mm.",
        f"Effects in the library: {', '.join(e.name for e in observer.effects)}. Others were not looked for.",
        "Errors are root mean square distances of the tracked points after each point's constant offset was taken out.",
        "Probabilities are not given: they need a calibration that has not been done.",
    ]
    if not held_out:
        notes.append("No held-out take: closure is measured on the motion it was fitted to and flatters.")
    if len(training) + len(held_out) < 3:
        notes.append("Too few takes to see how a recording differs from its own repetition.")
    return notes
