"""Convert a diagnosis into the result records of `formats.results`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from fit.cloth.effect import Effect, size_of
from fit.gap.closure import block_errors, gain_p_value, share_of
from fit.gap.detectable import smallest_detectable
from fit.gap.evidence import STUDENT_95, Evidence, is_at_bound
from fit.gap.fitting import Fitted
from fit.gap.floor import Floor
from fit.gap.gates import CONVERGED
from fit.gap.hypotheses import Hypothesis
from fit.gap.probabilities import probabilities
from fit.gap.screening import groups
from fit.methods import Parameter, Parameterisation
from fit.observer.residuals import Observer, has_static
from fit.search.intervals import NEAR_BOUND
from formats.diagnosis_records import EffectFinding, Figure, Gap, NextExperiment
from formats.figures import short, short_beside, with_unit
from formats.fit_records import AT_BOUND, FitParameter
from formats.nature import NORMAL_90
from formats.plain_text import first_few, joined

ONE_END = 0.05  # level of one end of a 90 % interval, and of the tests that agree with it
MOST_IDENTIFIED = 0.7  # half of a 90 % interval in logarithms: a factor of two each way; our choice, as before
NOT_SHOWN = "these takes could not have shown the effect"
NO_SIZE = "no size of it fits the takes better than none, so it closes nothing"
MAY_BE_NOTHING = "its size may be 0, and its closure the difference of two refits, which may end at other local minima"
CHOICE_FLATTERS = " Probabilities flatter too, because only the p-values allow for the choice among all effects."
BASE_FIT = "The base model is fitted by a search of the diagnosis' own, so its values may differ from those of a fit."
FROM_EFFECT = "One of its starts is the best refit with an effect. So another library may end it elsewhere."
WITH_ALL_ENDS = (
    "The intervals of its parameters cover the takes' noise, the ends of those starts that are as good, and a further "
    "end by their scatter."
)
FLOOR = (
    "The sensor's noise in this diagnosis is a distance in space, measured on the judged takes. The hanger's noise, "
    "which shakes the simulated cloth, is part of it. `hangtime takes show` gives a point's noise in one coordinate."
)
LISTED_EFFECTS = 3  # left-out effects that a sentence names; our choice: a sentence is read at a glance
PROBABILITIES = {
    "rules": "Probabilities follow from the share of draws in which an effect is best and worth naming. A draw chooses "
    "judged half-second blocks and an error of mesh and solver. docs/reference/blind-check.md says how well this holds "
    "on held-out takes. Probabilities rank the library's effects as causes of the gap. The p-values test each effect, "
    "and allow for the number of those tried.",
    "evidence": "Probabilities are masses of the sets of effects that hold an effect, weighed on the takes fitted to.",
}


def describe_gap(evidence: Evidence, best: Hypothesis | None, held_by_edge: Hypothesis | None) -> Gap:
    """Describe the gap: base error, floor, and the figures of the named hypothesis and of the held edge."""
    floor, error = evidence.floor_mm, STUDENT_95 * evidence.floor_error_mm
    return Gap(
        base_mm=evidence.error_of(evidence.base),
        with_effect_mm=evidence.error_of(best) if best else None,
        floor_mm=Figure(value=floor, interval=(max(floor - error, 0.0), floor + error)),
        numerics_mm=evidence.numerics_mm,
        closure=evidence.closure_of(best) if best else None,
        is_held_out=evidence.is_held_out,
        edge_mm=evidence.base.errors.edge.mm if evidence.base.errors.edge.count else None,
        edge_with_effect_mm=best.errors.edge.mm if best and best.errors.edge.count else None,
        held_by_edge_mm=evidence.error_of(held_by_edge) if held_by_edge else None,
        closure_held_by_edge=evidence.closure_of(held_by_edge) if held_by_edge else None,
    )


def describe_effects(
    evidence: Evidence, best: Hypothesis | None, effects: tuple[Effect, ...], model: Parameterisation,
    weighed: dict[str, float] | None = None, *, shows_gap: bool = True,
) -> list[EffectFinding]:  # fmt: skip
    """Describe every effect of the library, largest closure first.

    - best: the hypothesis that the verdict names, if any
    - weighed: probabilities, if evidence decided the verdict
    - shows_gap: whether the verdict sees a gap; without one no effect has a closure

    The amplitudes of effects that are named together come from their joint fit.
    """
    screened, shares = evidence.screened, evidence.win_shares()
    several = best if best is not None and len(best.effects) > 1 else None
    group = groups(screened)
    likely = probabilities(evidence, several) if weighed is None else weighed
    smallest = smallest_detectable(evidence)
    found = []
    for effect in effects:
        if effect.name not in screened:
            found.append(
                EffectFinding(
                    id=effect.name, group=effect.name, tested=False, amplitude=0.0, unit=effect.unit,
                    note=f"part of the base model, which fits its {str(effect.in_base).replace('_', ' ')}",
                )
            )  # fmt: skip
            continue
        name, signature = effect.name, screened[effect.name]
        hypothesis = evidence.singles.get(name)
        beside = several if several is not None and name in several.effects else None
        sized = beside or hypothesis
        amplitude = sized.fitted.amplitudes[evidence.observer.columns[name]] if sized else signature.amplitude
        # Verdicts by the held edge, on several effects or by masses do not use this test.
        by_other = beside is not None or weighed is not None or name in evidence.identified_by_edge
        is_tested_by_closure = hypothesis is not None and not by_other
        is_held = sized is not None and is_at_bound(evidence.observer, sized, name)
        size, interval = evidence.amplitude(name, beside=beside) if sized else (size_of(amplitude), None)
        if is_tested_by_closure and interval is not None:
            interval = with_nothing(evidence, name, interval)
        interval = within_range(effect, interval) if interval is not None else None
        moving = smallest[name][np.isfinite(smallest[name])]
        shown = moving[moving <= max(-effect.low, effect.high)]
        can_show = len(shown) > 0
        note = (
            f"screened only: it explains {100 * signature.explained:.0f} % of the residual, and was not chosen for a "
            "refit; its size is a linear estimate"
        )
        if can_show and size >= shown.max():
            note += f", and large enough to show; --add {name} refits and tests it"
        if hypothesis:
            note = f"best effect in {100 * shares[name]:.0f} % of bootstrap draws" if weighed is None else ""
            if not beside and not is_held:
                closes_nothing = hypothesis.errors is evidence.base.errors  # as `never_worse` left it
                doubt = of_no_size(interval, closes_nothing=closes_nothing)
                note = doubt if closes_nothing else "; ".join(filter(None, [doubt, note]))
        if beside:
            rest = " and ".join(evidence.observer.library[n].title for n in beside.effects if n != name)
            note = f"size beside {rest}; closure alone" if hypothesis else f"found beside {rest} only"
        if is_held:
            note = f"{AT_BOUND}, so that its size has no interval; {note}"
        if not len(moving):
            note = f"{NOT_SHOWN}: at its typical size the effect moves none of their points"
        elif not can_show and not beside:
            ends = short_beside(float(moving.min()), max(-effect.low, effect.high))
            least, most = (with_unit(end, effect.unit) for end in ends)
            each = " in each direction" if len(moving) > 1 else ""
            beyond = f"{NOT_SHOWN}: only from {least} on would it show, and its range ends at {most}{each}"
            note = "; ".join(filter(None, [note if sized else "", beyond]))  # `has_size` reads how a note begins
        found.append(
            EffectFinding(
                id=name,
                group=group[name],
                tested=True,
                probability=likely.get(name, 0.0),
                amplitude=size,
                amplitude_interval=None if is_held else interval,
                components=dict(zip(effect.components, amplitude.tolist(), strict=True)) if len(amplitude) > 1 else {},
                regions=list(effect.regions(amplitude)),
                unit=effect.unit,
                closure=evidence.closure_of(hypothesis) if hypothesis and shows_gap else None,
                p_value=evidence.p_value(name) if is_tested_by_closure else None,
                minimum_detectable=float(shown.max()) if can_show else None,
                explained=signature.explained,
                absorbed=signature.absorbed if len(moving) else None,
                correlation=signature.correlation,
                fitted_share=1 - hypothesis.fitted.cost / evidence.base.fitted.cost if hypothesis else None,
                note=note,
            )
        )
    return sorted(found, key=lambda f: (-(f.closure.value if f.closure else -9.0), -(f.explained or 0.0)))


def within_range(effect: Effect, interval: tuple[float, float]) -> tuple[float, float]:
    """Return the part of an interval of an effect's size that lies in its range.

    The size of an effect with directions is a length: at least 0, and at most that of all its largest components.
    """
    count = len(effect.components)
    least = 0.0 if count > 1 else effect.low
    most = max(-effect.low, effect.high) * float(np.sqrt(count)) if count > 1 else effect.high
    return min(max(interval[0], least), most), max(min(interval[1], most), least)


def of_no_size(interval: tuple[float, float] | None, *, closes_nothing: bool) -> str:
    """Return what the closure of an effect is where its size may be 0, or nothing where it is surely not.

    closes_nothing: whether the base fit took the refit's place. A refit of size 0 may also end at a better minimum.
    """
    if closes_nothing:
        return NO_SIZE
    may_be_nothing = interval is not None and interval[0] <= 0.0 <= interval[1]
    return MAY_BE_NOTHING if may_be_nothing else ""


def with_nothing(evidence: Evidence, effect: str, interval: tuple[float, float]) -> tuple[float, float]:
    """Return an effect's 90 % interval, up to 0 where the judged takes do not reject that the effect closes nothing.

    An end of a 90 % interval is a test at 5 %. So is the test of the closure, of this effect alone. A fit may find a
    size for an effect that does not lower the judged error. The judged takes then do not confirm the effect.
    """
    if gain_p_value(evidence.base.errors, evidence.singles[effect].errors, evidence.floor_mm) < ONE_END:
        return interval
    return min(interval[0], 0.0), max(interval[1], 0.0)


def alike_ends(observer: Observer, best: Fitted, fits: Sequence[Fitted]) -> list[Fitted]:
    """Return the best base fit, and the ends of other starts that are as good as it, least cost first.

    They agree with it in cost (`fit.gap.gates.CONVERGED`). Or its smaller error may be chance: the p-value of a paired
    test over half-second blocks is at least 5 %. The test may tell ends apart that agree in cost. That is no reason to
    leave one out, because chance decided which minima the search met, and the truth's may be none of them. Where no end
    is as good, the second best counts, since one end alone shows no agreement.
    """
    most, errors = (1.0 + CONVERGED) * best.cost, block_errors(observer, best.residual)
    others = sorted((one for one in fits if one is not best), key=lambda one: one.cost)
    alike = [
        one for one in others
        if one.cost <= most or share_of(block_errors(observer, one.residual), errors, 0.0).p_value >= ONE_END
    ]  # fmt: skip
    return [best, *(alike or others[:1])]


def base_parameters(model: Parameterisation, ends: Sequence[Fitted]) -> list[FitParameter]:
    """Describe the parameters of the best base fit with 90 % intervals, which cover `alike_ends` and a further end.

    An interval holds the intervals of all ends. Let m be the mean and s the standard deviation of the K ends, and h the
    half width of the widest end's interval. The interval then also holds

        m - w to m + w,   w^2 = h^2 + t^2 s^2 (1 + 1/K),   t: 95 % of Student's distribution, K - 1 degrees of freedom

    This predicts the minimum that a further start would meet. Source: G. J. Hahn, "Factors for calculating two-sided
    prediction intervals ...", J. American Stat. Assoc. 64 (1969).
    """
    described, fitted = [], ends[0]
    for k, parameter in enumerate(model.parameters):
        value = float(fitted.vector[k])
        low, high = _of_a_further_end(parameter, ends, k)
        half = NORMAL_90 * float(fitted.deviation[k])
        if parameter.is_log and len(ends) > 1:
            half = max(half, float(np.log(high / low)) / 2)
        stopped = _stopped(parameter, value)
        described.append(
            FitParameter(
                name=parameter.name,
                unit=parameter.unit,
                initial=parameter.initial,
                fitted=value,
                minimum=parameter.minimum,
                maximum=parameter.maximum,
                interval_low=low,
                interval_high=high,
                is_identified=bool(half < MOST_IDENTIFIED and not stopped) if parameter.is_log or stopped else None,
                is_at_bound=stopped,
                note=parameter.meaning,
            )
        )
    return described


def _of_a_further_end(parameter: Parameter, ends: Sequence[Fitted], k: int) -> tuple[float, float]:
    """Return the 90 % interval of parameter `k` that covers ends and predicts a further one."""
    lows, highs = np.array([_interval(parameter, one, k) for one in ends]).T
    low, high, count = float(lows.min()), float(highs.max()), len(ends)
    if count == 1:
        return low, high
    scale, back = (np.log, np.exp) if parameter.is_log else (np.asarray, np.asarray)
    values = scale(np.array([float(one.vector[k]) for one in ends]))
    half = NORMAL_90 * max(float(one.deviation[k]) for one in ends)
    apart = float(stdtrit(count - 1, 0.95)) * float(values.std(ddof=1)) * np.sqrt(1 + 1 / count)
    wide = float(np.hypot(half, apart))
    low, high = min(low, float(back(values.mean() - wide))), max(high, float(back(values.mean() + wide)))
    return max(low, parameter.minimum), min(high, parameter.maximum)


def _interval(parameter: Parameter, fitted: Fitted, k: int) -> tuple[float, float]:
    """Return the 90 % interval of parameter `k` of one fit: its whole range where the fit ended at its bound."""
    value, spread = float(fitted.vector[k]), NORMAL_90 * float(fitted.deviation[k])
    if _stopped(parameter, value):  # the fit gives no value beyond the bound
        return parameter.minimum, parameter.maximum
    low, high = (
        (value * np.exp(-spread), value * np.exp(spread)) if parameter.is_log else (value - spread, value + spread)
    )
    return max(low, parameter.minimum), min(high, parameter.maximum)


def _stopped(parameter: Parameter, value: float) -> bool:
    """Return whether a base parameter is at its bound."""
    low, high, at = parameter.minimum, parameter.maximum, value
    if parameter.is_log:
        low, high, at = float(np.log(low)), float(np.log(high)), float(np.log(value))
    reach = NEAR_BOUND * (high - low)
    return at < low + reach or at > high - reach


def at_bounds(model: Parameterisation, fitted: Fitted) -> str:
    """Return a sentence that names the base parameters at their bounds, or nothing if there are none."""
    names = [
        f"{p.name.replace('_', ' ')} ({_reached(p, value)})"
        for p, value in zip(model.parameters, fitted.vector.tolist(), strict=True)
        if _stopped(p, value)
    ]
    if not names:
        return ""
    where = f"is {AT_BOUND}" if len(names) == 1 else "are at their bounds"
    return f" In the base fit, {joined(names)} {where}. The takes identify no value of a parameter at its bound."


def _reached(parameter: Parameter, value: float) -> str:
    """Return in words the bound that a base parameter is at, which is no fitted value."""
    is_low = value - parameter.minimum < parameter.maximum - value
    end = parameter.minimum if is_low else parameter.maximum
    return f"range {'from' if is_low else 'up to'} {with_unit(short(end), parameter.unit)}"


def left_out(effects: tuple[Effect, ...], library: tuple[Effect, ...]) -> str:
    """Return a sentence that says which effects of the library were not looked for, if any."""
    absent = [effect.title for effect in library if effect not in effects]
    return f" Not looked for, as asked: {first_few(absent, most=LISTED_EFFECTS)}." if absent else ""


def notes(
    training: int, held_out: int, observer: Observer, floor: Floor, *, is_predictable: bool, by: str = "rules",
    is_from_effect: bool = True,
) -> list[str]:  # fmt: skip
    """Return notes on the limits of the diagnosis' figures.

    is_from_effect: whether the base model was fitted again from the best refit with an effect
    """
    free = (
        "Free rollouts, predictable as they are" if is_predictable else "Free rollouts, which no pull makes predictable"
    )
    how = f"Observer pull of {observer.frequency:g} Hz" if observer.frequency else free
    said = [
        f"{how}; mesh of {1e3 * observer.resolution.spacing:.0f} mm.",
        "Errors are root mean square distances of the tracked points that are not on the held edge. Points on the held "
        "edge tell how the cloth is held and timed.",
        PROBABILITIES[by],
        " ".join([BASE_FIT, *([FROM_EFFECT] if is_from_effect else []), WITH_ALL_ENDS]),
        FLOOR,
    ]
    if floor.is_contradicted:
        said.append(
            f"The takes state that their points are off by {floor.stated_mm:.1f} mm. The diagnosis measured "
            f"{floor.measured_mm:.1f} mm, and takes the noise floor from that."
        )
    if not any(map(has_static, observer.recordings)):
        said.append(
            "Points of a silhouette sit constantly a little beside the material, so each point's mean offset was taken "
            "out. Effects that only move the cloth's resting position cannot be seen."
        )
    if not held_out:
        flatters = "No held-out take: closure is measured on the motion it was fitted to and flatters."
        said.append(flatters + (CHOICE_FLATTERS if by == "rules" else ""))
    if training + held_out < 3:
        said.append("One or two takes: the same cloth, hung anew, may differ from them by more than their noise.")
    return said


def unseparated(verdict: str, proposal: NextExperiment | None) -> list[str]:
    """Return the note on named effects that no motion of the menu would tell apart, if these takes do not."""
    if verdict != "ambiguous" or proposal is not None:
        return []
    return [
        "No motion of the menu would separate the named effects by one standard deviation more than these takes do."
    ]
