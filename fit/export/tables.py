"""Export of a fit as tables: CSV of every number, and a sheet of values for garment design programs.

The sheet gives SI values, and the fabric's readings in common textile tests. 1 gf = 9.80665 mN.

    strip       F = k e w: a strip of width w, stretched by the strain e
    cantilever  B = g rho c^3: half the length c that hangs over an edge when its end is 41.5 degrees below

Sources: F. T. Peirce, "The Handle of Cloth as a Measurable Quantity", Journal of the Textile Institute 21 (1930);
ASTM D1388, option A, for the angle; S. Kawabata, "The Standardization and Analysis of Hand Evaluation" (2nd edition
1980) for the units of `fit.virtual_tests.kes`.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Sequence

from fit.export.about import caution_lines, flat_provenance, origin_lines
from fit.export.fabric import Fabric, Quantity, status_of
from fit.virtual_tests.kes import BENDING_UNIT, GRAM_FORCE, SHEAR_UNIT
from formats.figures import short, span_of, without_noise
from formats.fit_records import FitResult
from formats.nature import GRAVITY
from formats.rows import aligned, csv_text

STRIP_WIDTH, STRIP_STRAIN = 0.05, 0.05  # m, 1: a strip 5 cm wide at 5 %, small enough for a straight law
# characters per line of text. Our choice: as this project's prose; longer lines would be cut off in a terminal.
LINE_LENGTH = 100


PARAMETER_HEADS = (
    "kind", "name", "value", "interval_low", "interval_high", "unit", "status", "one_of_many", "meaning",
)  # fmt: skip


def parameters_csv(result: FitResult, fabric: Fabric | None) -> str:
    """Return `parameter_rows` as CSV; lines of provenance come last."""
    origin = [("provenance", k, v, None, None, "", "", None, "") for k, v in flat_provenance(result).items()]
    return csv_text(PARAMETER_HEADS, [*parameter_rows(result, fabric), *origin])


def parameter_rows(result: FitResult, fabric: Fabric | None) -> list[Sequence[object]]:
    """Return a row per parameter and per quantity of the fabric, SI units, under `PARAMETER_HEADS`.

    A parameter that is not identified keeps its value in its own column, `one_of_many`, and leaves `value` empty.
    """
    rows: list[Sequence[object]] = [
        ("parameter", p.name, p.fitted, p.interval_low, p.interval_high, p.unit, status_of([p], result), p.note)
        for p in result.parameters
    ]
    for q in fabric.quantities if fabric is not None else ():
        rows.append(("fabric", q.name, q.value, q.low, q.high, q.unit, q.status, q.meaning))
    for c in result.combinations:
        rows.append(
            ("combination", c.name, c.fitted, c.interval_low, c.interval_high, c.unit, status_of([c], result), "")
        )
    plain = ([without_noise(one) if isinstance(one, float) else one for one in row] for row in rows)
    return list(map(_set_apart, plain))


def _set_apart(row: Sequence[object]) -> Sequence[object]:
    """Return a row; a value that the takes do not identify is in the column `one_of_many`."""
    kind, name, value, low, high, unit, status, meaning = row
    known, other = (None, value) if status == "not identified" else (value, None)
    return kind, name, known, low, high, unit, status, other, meaning


def software_table(result: FitResult, fabric: Fabric) -> str:
    """Return a sheet for the fabric windows of CLO, Marvelous Designer and Browzwear."""
    density = fabric["areal_density"].value
    rows = [
        _row("Weight", fabric["areal_density"], "g/m2", lambda v: 1e3 * v, "type it in: all three mean this unit"),
        ("Thickness", "-", "", "mm", "no motion tells it: measure it"),
        *(
            _row(f"Stretch {way}", fabric[f"stretch_{way}"], "N/m", lambda v: v, "no field has this unit: see below")
            for way in ("warp", "weft")
        ),
        *(
            _row(
                f"  force at {100 * STRIP_STRAIN:.0f} %, {way}", fabric[f"stretch_{way}"], "gf",
                lambda v: v * STRIP_STRAIN * STRIP_WIDTH / GRAM_FORCE, f"of a strip {100 * STRIP_WIDTH:.0f} cm wide",
            )
            for way in ("warp", "weft")
        ),
        _row("Shear", fabric["shear"], "N/m", lambda v: v, "no field has this unit: see below"),
        _row("  KES G", fabric["shear"], "gf/(cm deg)", lambda v: v / SHEAR_UNIT, ""),
        *(
            _row(f"Bending {way}", fabric[f"bending_{way}"], "µN m", lambda v: 1e6 * v, "no field has this unit")
            for way in ("warp", "weft")
        ),
        *(
            _row(
                f"  overhang at 41.5 deg, {way}", fabric[f"bending_{way}"], "mm",
                lambda v: 2e3 * (v / (GRAVITY * density)) ** (1 / 3), "cantilever test, ASTM D1388",
            )
            for way in ("warp", "weft")
        ),
        *(
            _row(f"  KES B, {way}", fabric[f"bending_{way}"], "gf cm2/cm", lambda v: v / BENDING_UNIT, "")
            for way in ("warp", "weft")
        ),
        _row("Bending damping", fabric["bending_damping_time"], "ms", lambda v: 1e3 * v, "no field means this"),
        _row("Air and linear damping", fabric["velocity_damping"], "1/s", lambda v: v, "no field means this"),
    ]  # fmt: skip
    if fabric.get("drag_coefficient"):
        rows.append(_row("Drag coefficient", fabric["drag_coefficient"], "1", lambda v: v, "no field means this"))
    heads = ("quantity", "value", "90 % interval", "unit", "how sure, and what to do with it")
    lines = ["Fabric for CLO, Marvelous Designer and Browzwear", "", *origin_lines(result), ""]
    lines += aligned([heads, *rows], right=(1,))
    lines += ["", *_wrapped(UNIT_WORDS)]
    if cautions := caution_lines(result, fabric):
        lines += ["", "Doubtful, not measured, or not identified by these takes:", *_wrapped(cautions)]
    return "\n".join(lines) + "\n"


UNIT_WORDS = (
    "CLO and Marvelous Designer show stretch, shear and bending as numbers without a unit. Their scale is not "
    "published, so no formula here would be honest.",
    "In CLO and Marvelous Designer, enter weight and thickness, then use the emulator of the fabric window, which "
    "takes forces and lengths of strips. The rows `force` and `overhang` are such readings, computed from motion.",
    "Browzwear takes the readings of a fabric analyser. Give the same rows to whoever fills in its fabric editor.",
    "Motion loads cloth with its own weight, hundreds of times less than a strip test. A fabric that stiffens as it "
    "stretches shows a higher force there than this table.",
    "Check by eye: hang a swatch of the size that was recorded, and compare its folds with the report.",
)


def _row(
    name: str, quantity: Quantity, unit: str, scale: Callable[[float], float], words: str
) -> tuple[str, str, str, str, str]:
    ends = ""
    if quantity.low is not None and quantity.high is not None:
        low, high = sorted((scale(quantity.low), scale(quantity.high)))
        ends = span_of((low, high))
    value = short(scale(quantity.value)) if quantity.status != "not identified" else "-"
    told: dict[str, str] = {"not identified": "NOT IDENTIFIED: only the interval is known"}
    how = told.get(quantity.status, quantity.status)
    return name, value, ends, unit, f"{how}; {words}" if words else how


def _wrapped(paragraphs: Iterable[str]) -> list[str]:
    return [
        line
        for text in paragraphs
        for line in textwrap.wrap(
            text, LINE_LENGTH, initial_indent="- ", subsequent_indent="  ", break_long_words=False
        )
    ]
