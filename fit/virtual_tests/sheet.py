"""KES-style sheet of a fit as text: virtual fabric tests of the fit, with published values for comparison."""

from __future__ import annotations

import operator
from collections.abc import Mapping

from fit.cloth.material import MATERIAL_NAMES
from fit.engines import OWN_ENGINE
from fit.errors import FitError
from fit.folders import notes_of_diagnosis, own_warnings
from fit.recordings.intact import flaw_notes
from fit.virtual_tests.fabric_ranges import QUANTILES, TEN, range_of_ten, share_below
from fit.virtual_tests.fitted_rows import FittedRows
from fit.virtual_tests.kes import Sheet, make_sheet
from formats.arrays import Floats
from formats.figures import short, span_of
from formats.fit_records import NOT_IDENTIFIED, FitResult
from formats.plain_text import plain
from formats.rows import aligned

Span = tuple[float, float] | None  # a 90 % interval, where one is known

HYSTERESIS = "bending_hysteresis"  # the effect that brings friction into bending
LAYER_NUMBERS = ("areal_density", "stretch_stiffness", "shear_stiffness", "bending_stiffness")  # for layers that slide
GRAIN_WAYS = ("warp", "weft")
OF_A_WAY = ("first_slope", "extension", "tensile_energy", "linearity", "bending")
# Numbers from the material.
SHEET_NUMBERS = ("weight", "shear", *(f"{way}.{name}" for way in GRAIN_WAYS for name in OF_A_WAY))


def tests_of(result: FitResult) -> Sheet:
    """Return the virtual tests of a fit; for a garment of several sliding layers, of one layer.

    Raises:
        FitError: the result does not hold its material, or is of another engine.
    """
    if result.engine != OWN_ENGINE:
        raise FitError(
            f"its cloth is {result.engine}'s, whose numbers are not properties of a fabric",
            where=result.label,
            advice="fit with --engine own",
        )
    if not set(MATERIAL_NAMES) <= result.material.keys():
        raise FitError("does not hold its material", where=result.label, advice="its version is older: fit again")
    return _tests(result.material, result.layers, result.effects.get(HYSTERESIS, 0.0))


def _tests(material: dict[str, float], layers: int, friction: float = 0.0) -> Sheet:
    """Return the virtual tests of one layer of a material whose layers were fitted as one sheet."""
    shared = {name: value / (layers if name in LAYER_NUMBERS else 1) for name, value in material.items()}
    return make_sheet(shared, friction / layers)


def unidentified_of(result: FitResult) -> dict[str, Span]:
    """Return the 90 % interval of each unidentified number of the sheet, by its path in the sheet.

    Raises:
        FitError: as `tests_of`.
    """
    tests_of(result)  # refuses
    rows = FittedRows(result)
    found: dict[str, Span] = {}
    for place in SHEET_NUMBERS:

        def read(row: Floats, place: str = place) -> float:
            return number_of(_tests(dict(zip(MATERIAL_NAMES, row.tolist(), strict=True)), result.layers), place)

        behind = rows.parameters_behind(read)
        if any(p.is_identified is False for p in behind):
            found[place] = rows.ends(read, behind)
    friction = next((p for p in result.parameters if p.name == HYSTERESIS and p.is_identified is False), None)
    if friction is not None:
        ends = friction.interval_low, friction.interval_high
        sheets = [_tests(result.material, result.layers, end) for end in ends if end is not None]
        for place in (f"{way}.bending_hysteresis" for way in GRAIN_WAYS):
            found[place] = (number_of(sheets[0], place), number_of(sheets[1], place)) if len(sheets) == 2 else None
    return found


def number_of(sheet: Sheet, place: str) -> float:
    """Return one number of a sheet by its path `place`, one of `SHEET_NUMBERS` or a hysteresis."""
    return float(operator.attrgetter(place)(sheet))


def sheet_of(result: FitResult) -> str:
    """Return the sheet of a fit result; for a garment of several sliding layers, of one layer.

    A number that the takes do not identify is replaced by its 90 % interval.

    Raises:
        FitError: the result does not hold its material, or is of another engine.
    """
    sheet, unidentified = tests_of(result), unidentified_of(result)
    rows = [("quantity", "unit", "warp", "weft", "ten fabrics", "618 fabrics")]

    def row(name: str, unit: str, places: tuple[str, ...], ten: str = "", many: str = "") -> None:
        cells = [_interval(unidentified[p]) if p in unidentified else short(number_of(sheet, p)) for p in places]
        rows.append((name, unit, cells[0], cells[1] if len(cells) > 1 else "", _range(ten), many))

    def ways(name: str) -> tuple[str, str]:
        return f"warp.{name}", f"weft.{name}"

    def share(quantity: str, place: str) -> str:
        return NOT_IDENTIFIED if place in unidentified else share_below(quantity, number_of(sheet, place))

    row("W, weight", "mg/cm2", ("weight",), "weight", share("weight", "weight"))
    row("first slope of tension", "gf/cm", ways("first_slope"), "slope")
    row("EMT at 500 gf/cm *", "%", ways("extension"))
    row("WT *", "gf cm/cm2", ways("tensile_energy"))
    row("LT *", "1", ways("linearity"))
    row("G, shear 0.5 to 5 degrees", "gf/(cm deg)", ("shear",), "shear")
    shares = [
        f"{way} {share(f'bending {way}', f'{way}.bending')}"
        for way in GRAIN_WAYS
        if f"{way}.bending" not in unidentified
    ]
    many = ", ".join(shares) or NOT_IDENTIFIED
    row("B, bending 0.5 to 1.5 1/cm", "gf cm2/cm", ways("bending"), "bending", many)
    row("2HB at 1 1/cm", "gf cm/cm", ways("bending_hysteresis"))
    head = f"Virtual fabric tests of {plain(', '.join(result.take_ids))} ({result.method})"
    return "\n".join([head, "", *aligned(rows, right=(2, 3)), "", *_remarks(result, unidentified)])


def _interval(ends: Span) -> str:
    return NOT_IDENTIFIED if ends is None else span_of(ends)


def _range(quantity: str) -> str:
    if not quantity:
        return ""
    return span_of(range_of_ten(quantity))


def _remarks(result: FitResult, unidentified: Mapping[str, Span]) -> list[str]:
    remarks = [
        "* extrapolated: motion loads cloth with its own weight, hundreds of times less than this test.",
        f"Ten fabrics: Wang et al. 2011, {TEN[0].name} to {TEN[-1].name}. 618 fabrics: Feng et al. 2022, "
        f"{QUANTILES['weight'][0]:.0f} to {QUANTILES['weight'][-1]:.0f} mg/cm2 (5 to 95 %).",
        "RT is 100 % and 2HG is 0: the law has no friction in tension and shear.",
    ]
    if result.layers > 1:
        remarks.append(
            f"The garment is {result.layers} layers, fitted as one: weight, tension, shear and bending are of one of "
            "them, the same share each. Layers that are glued or quilted bend stiffer than they do one by one."
        )
    if "density" in {p.name for p in result.parameters} or "mass" in {p.name for p in result.parameters}:
        remarks.append(
            "The weight was fitted, which motion cannot tell: weight, tension, shear and bending may all be wrong by "
            "one and the same factor. Weigh the garment and use a method with -weighed, or si."
        )
    if unidentified:
        remarks.append("A number with two ends is a 90 % interval: the takes do not identify it.")
        names = [c.name for c in result.combinations if not c.is_identified]
        if names:
            remarks.append(f"The takes do not identify {', '.join(names)}.")
    return remarks + notes_of_diagnosis(result.notes) + own_warnings(result.notes) + flaw_notes(result.notes)
