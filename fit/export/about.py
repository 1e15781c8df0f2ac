"""Provenance and cautions of an exported file, in words and as plain values."""

from __future__ import annotations

from importlib import metadata
from typing import Any

from fit.export.fabric import MEANING_OF_STATUS, Fabric, Quantity, Status, status_of
from fit.folders import notes_of_diagnosis, own_warnings
from fit.recordings.intact import describe_flaws, flaw_notes
from fit.recordings.selection import content_of, content_of_garment
from formats.figures import short, span_of, with_unit
from formats.fit_records import WARNING, FitResult
from formats.plain_text import joined, plain, shortened
from formats.take import Take

SAME_WEIGHT = 0.01  # relative difference of weight: scales are more precise, but fits to several takes store their mean


def provenance(result: FitResult) -> dict[str, Any]:
    """Return the provenance of the fit: version, method, takes and error."""
    error = result.error.held_out_after or result.error.train_after
    return {
        "generator": f"hangtime {metadata.version('hangtime')}",
        "created": result.created,
        "method": result.method,
        "search": result.search,
        "seed": result.seed,
        "takes": list(result.take_ids),
        "take_sha256": list(result.take_contents),
        "held_out_takes": list(result.held_out_ids),
        "mean_error_m": error.mean_m,
        "take_warnings": flaw_notes(result.notes),
        "missing_effects": notes_of_diagnosis(result.notes),
        "fit_warnings": own_warnings(result.notes),
        "error_is_held_out": result.error.held_out_after is not None,
    }


def flat_provenance(result: FitResult) -> dict[str, Any]:
    """Return the provenance with each list as one text, for formats that hold no lists."""
    return {k: " ".join(map(str, v)) if isinstance(v, list) else v for k, v in provenance(result).items()}


def quantity_record(quantity: Quantity) -> dict[str, Any]:
    """Return a quantity as plain values for JSON."""
    interval = None if quantity.low is None else [quantity.low, quantity.high]
    return {
        "value": quantity.value, "unit": quantity.unit, "interval_90": interval, "status": quantity.status,
        "is_identified": quantity.is_known, "meaning": quantity.meaning,
    }  # fmt: skip


def origin_lines(result: FitResult) -> list[str]:
    """Return the provenance in sentences."""
    error = result.error.held_out_after or result.error.train_after
    judged = "on takes held out" if result.error.held_out_after is not None else "on the takes fitted to"
    return [
        f"Fitted by hangtime {metadata.version('hangtime')} with the method {plain(result.method)} on "
        f"{plain(result.created)}.",
        plain(f"Takes: {', '.join(result.take_ids)}."),
        f"Mean distance of the tracked points: {1e3 * error.mean_m:.1f} mm {judged}.",
    ]


def caution_lines(result: FitResult, fabric: Fabric | None) -> list[str]:
    """Return a sentence for each missing effect, warning, flaw of a take, and quantity that needs a caution."""
    lines = [plain(note) for note in _warnings(result)]
    if fabric is not None:
        for q in fabric.quantities:
            if not q.is_known:
                number = _number(q.value, q.low, q.high, q.unit, q.status)
                lines.append(f"{q.name}: {number}; {MEANING_OF_STATUS[q.status]}.")
        if fabric.layers > 1:
            lines.append(f"The garment has {fabric.layers} layers; the numbers are of one of them.")
        return lines
    for p in result.parameters:
        if p.is_identified is not True:
            status = status_of([p], result)
            number = _number(p.fitted, p.interval_low, p.interval_high, p.unit, status)
            lines.append(plain(f"{p.name}: {number}; {MEANING_OF_STATUS[status]}."))
    return lines


def doubts(result: FitResult, fabric: Fabric | None) -> list[str]:
    """Return the warnings that an export prints: those of the fit, then the numbers that its takes do not identify."""
    told = [plain(note) for note in _warnings(result)]
    found = [(q.name, q.status) for q in fabric.quantities] if fabric is not None else [
        (p.name, status_of([p], result)) for p in result.parameters
    ]  # fmt: skip
    for status, words in NOT_SURE.items():
        if names := [plain(name.replace("_", " ")) for name, one in found if one == status]:
            told.append(f"{WARNING} {words.format(names=joined(names))}")
    return told


NOT_SURE: dict[Status, str] = {
    "not identified": "the takes do not identify {names}. Other values within the intervals follow them as well.",
    "no interval": "nothing tells how sure {names} may be. The fit computed no interval.",
}


def _warnings(result: FitResult) -> list[str]:
    """Return what a fit warns of: an effect that it lacks, its own numbers, flaws of its takes."""
    return [*notes_of_diagnosis(result.notes), *own_warnings(result.notes), *flaw_notes(result.notes)]


def remarks_on_take(result: FitResult, take: Take | None) -> list[str]:
    """Return remarks on an animated take: of another garment, incomplete, damaged or doubtful."""
    if take is None:
        return []
    other = other_garment(result, take)
    return ([other] if other else []) + [plain(note) for note in describe_flaws([take])]


def other_garment(result: FitResult, take: Take) -> str:
    """Return a remark if a take is of another garment than the fit.

    Return an empty text if the garments agree. An old fit may state no garment. Then its takes, layers and weight
    decide.
    """
    garment = take.garment
    if result.garment_content:
        own = {content_of_garment(one) for one in (garment, garment.as_meant)}  # earlier fits used the spelling
        is_other = result.garment_content not in own
    else:
        fitted = result.material.get("areal_density", garment.areal_density)
        is_other = content_of(take) not in result.take_contents and (
            garment.layers != result.layers or abs(garment.areal_density / fitted - 1) > SAME_WEIGHT
        )
    if not is_other:
        return ""
    whose = f" ({shortened(result.garment)})" if result.garment else ""
    return plain(
        f"The take {shortened(take.take_id)} is of another garment ({shortened(garment.name)}) than the fit{whose}. "
        f"The take's cut and weight, {1e3 * garment.areal_density:.0f} g/m2, go with the stiffness of the fitted "
        "garment."
    )


def _number(value: float, low: float | None, high: float | None, unit: str, status: Status) -> str:
    """Return a quantity with its interval; only the interval if it is not identified."""
    ends = "" if low is None or high is None else f"90 % interval {with_unit(span_of((low, high)), unit)}"
    if status == "not identified":
        return ends or "no interval"
    number = with_unit(short(value), unit)
    return f"{number}, {ends}" if ends else number
