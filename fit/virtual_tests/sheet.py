"""The KES-style sheet of a fit as text: the fitted fabric on a virtual fabric tester, beside measured fabrics."""

from __future__ import annotations

from fit.cloth.material import MATERIAL_NAMES
from fit.engines import OWN_ENGINE
from fit.errors import FitError
from fit.recordings.intact import incomplete_notes
from fit.virtual_tests.fabric_ranges import QUANTILES, TEN, range_of_ten, share_below
from fit.virtual_tests.kes import Sheet, make_sheet
from formats.fit_records import FitResult

HYSTERESIS = "bending_hysteresis"  # the effect that brings friction into bending
LAYER_NUMBERS = ("areal_density", "stretch_stiffness", "shear_stiffness", "bending_stiffness")  # by layers that slide


def tests_of(result: FitResult) -> Sheet:
    """Return the virtual tests of a fit: of one layer, where the garment has several that slide on one another.

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
        raise FitError(
            "does not hold its material", where=result.label, advice="it is from an older version: fit again"
        )
    material = {
        name: value / (result.layers if name in LAYER_NUMBERS else 1) for name, value in result.material.items()
    }
    return make_sheet(material, result.effects.get(HYSTERESIS, 0.0) / result.layers)


def sheet_of(result: FitResult) -> str:
    """Return the sheet of a fit result: of one layer, where the garment has several that slide on one another.

    Raises:
        FitError: the result does not hold its material, or is of another engine.
    """
    sheet = tests_of(result)
    head = f"{'quantity':<30}{'unit':<14}{'warp':>9}{'weft':>9}   {'ten fabrics':<18}618 fabrics"
    lines = [f"Virtual fabric tests of {', '.join(result.take_ids)} ({result.method})", "", head]

    def line(name: str, unit: str, values: tuple[float, ...], ten: str = "", many: str = "") -> None:
        cells = "".join(f"{value:>9.3g}" for value in values)
        lines.append(f"{name:<30}{unit:<14}{cells:<18}   {_range(ten):<18}{many}".rstrip())

    line("W, weight", "mg/cm2", (sheet.weight,), "weight", share_below("weight", sheet.weight))
    warp, weft = sheet.warp, sheet.weft
    line("first slope of tension", "gf/cm", (warp.first_slope, weft.first_slope), "slope")
    line("EMT at 500 gf/cm *", "%", (warp.extension, weft.extension))
    line("WT *", "gf cm/cm2", (warp.tensile_energy, weft.tensile_energy))
    line("LT *", "1", (warp.linearity, weft.linearity))
    line("G, shear 0.5 to 5 degrees", "gf/(cm deg)", (sheet.shear,), "shear")
    shares = ", ".join(f"{k} {share_below(f'bending {k}', d.bending)}" for k, d in (("warp", warp), ("weft", weft)))
    line("B, bending 0.5 to 1.5 1/cm", "gf cm2/cm", (warp.bending, weft.bending), "bending", shares)
    line("2HB at 1 1/cm", "gf cm/cm", (warp.bending_hysteresis, weft.bending_hysteresis))
    lines += ["", *_remarks(result)]
    return "\n".join(lines)


def _range(quantity: str) -> str:
    if not quantity:
        return ""
    low, high = range_of_ten(quantity)
    return f"{low:.3g} to {high:.3g}"


def _remarks(result: FitResult) -> list[str]:
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
    for c in result.combinations:
        if not c.is_identified:
            remarks.append(f"The takes did not tell {c.name}: what depends on it is only the start or the range.")
    return remarks + incomplete_notes(result.notes)
