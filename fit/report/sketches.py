"""SVG sketches of every effect of the library, for the report.

A sketch has 80 by 56 units. Blue is the cloth, dashed grey the cloth or reading without the effect, orange the effect.
A stroke has a style, which is a class of `page.css`, and an SVG path.
"""

from __future__ import annotations

import math

ARROW_HEAD = 5.0  # units: length of an arrow's head

Stroke = tuple[str, str]


def _arrow(x: float, y: float, to_x: float, to_y: float) -> Stroke:
    along, side = math.atan2(to_y - y, to_x - x), 0.5
    ends = [(to_x - ARROW_HEAD * math.cos(along + s), to_y - ARROW_HEAD * math.sin(along + s)) for s in (side, -side)]
    (a, b), (c, d) = ends
    return "hot", f"M{x:g} {y:g}L{to_x:g} {to_y:g}M{a:.1f} {b:.1f}L{to_x:g} {to_y:g}L{c:.1f} {d:.1f}"


# Radius in units of the sketch; our choice: to be seen beside its lines.
def _dots(style: str, *places: tuple[float, float], radius: float = 2.0) -> Stroke:
    half = f"a{radius:g} {radius:g} 0 1 0 "
    return style, "".join(f"M{x - radius:g} {y:g}{half}{2 * radius:g} 0{half}{-2 * radius:g} 0" for x, y in places)


def _ticks(style: str, y: float, *places: float) -> Stroke:
    return style, "".join(f"M{x:g} {y - 6:g}v12" for x in places)


BAR: Stroke = ("bar", "M12 9H68")
HUNG: Stroke = ("bar", "M33 7H47")  # a hanger seen from the side
FLAT_CLOTH: Stroke = ("cloth", "M20 9H60V47H20Z")
WAS_FLAT: Stroke = ("was", "M20 9H60V47H20Z")
AXES: Stroke = ("thin", "M14 6V50H70")
PLUMB: Stroke = ("was", "M40 7V51")

SKETCHES: dict[str, tuple[Stroke, ...]] = {
    "shear_stiffness": (WAS_FLAT, ("cloth", "M20 9H60L70 47H30Z"), BAR, _arrow(34, 53, 54, 53)),
    "bending_hysteresis": (
        AXES,
        ("cloth", "M20 45C26 28 46 16 64 11C58 28 38 42 20 45Z"),
        _arrow(34, 26, 44, 19),
        _arrow(48, 34, 38, 40),
    ),
    "rest_curvature": (PLUMB, ("cloth", "M40 7V32C40 48 58 50 60 39C61 33 53 31 51 36"), HUNG),
    "hem": (FLAT_CLOTH, BAR, ("thick", "M20 46H60"), _arrow(30, 33, 30, 42), _arrow(50, 33, 50, 42)),
    "anisotropy": (
        FLAT_CLOTH,
        BAR,
        ("hot", "M26 14V42M33 14V42M40 14V42M47 14V42M54 14V42"),
        ("thin", "M20 20H60M20 28H60M20 36H60"),
    ),
    "strain_stiffening": (AXES, ("was", "M14 50L68 30"), ("hot", "M14 50C40 42 56 34 64 8")),
    "bending_viscosity": (
        ("was", "M8 28C12 8 18 8 22 28S32 48 36 28S46 8 50 28S60 48 64 28"),
        ("hot", "M8 28C12 8 18 8 22 28S32 42 36 28S46 20 50 28S60 31 64 28H72"),
    ),
    "stretch_viscosity": (
        ("cloth", "M40 6V12M22 12H58M22 12V18L17 21L27 25L17 29L27 33L22 36V44M22 44H58M40 44V50"),
        ("hot", "M58 12V26M52 26H64M50 22V36H66V22M58 36V44"),
    ),
    "mass_distribution": (
        FLAT_CLOTH,
        BAR,
        *(_dots("dot", *((x, y) for x in (28, 40, 52)), radius=r) for y, r in ((16, 1.2), (27, 2.2), (39, 3.6))),
    ),
    "self_contact": (("cloth", "M36 7V40C36 50 46 50 46 40V20"), HUNG, _arrow(22, 30, 33, 30), _arrow(60, 30, 49, 30)),
    "hanger_compliance": (
        ("was", "M40 4V24"),
        ("hot", "M40 4C40 14 44 20 50 24"),
        ("cloth", "M50 24C50 36 52 44 58 52"),
        _arrow(52, 12, 34, 12),
    ),
    "hanger_rotation": (
        ("was", "M14 20H66"),
        ("bar", "M15 26L65 14"),
        ("cloth", "M18 26L22 50M62 15L60 50"),
        _arrow(70, 22, 69, 12),
    ),
    "attachment_offset": (BAR, WAS_FLAT, ("cloth", "M28 16H68V52H28Z"), _arrow(20, 9, 28, 16), _arrow(60, 9, 68, 16)),
    "clip_slip": (BAR, WAS_FLAT, ("cloth", "M20 18L60 9V47H20Z"), ("bar", "M17 6V13M63 6V13"), _arrow(13, 10, 13, 20)),
    "clip_slack": (
        ("was", "M22 9H58"),
        ("cloth", "M22 9Q40 26 58 9V47H22Z"),
        ("bar", "M22 5V13M58 5V13"),
        _arrow(12, 9, 20, 9),
        _arrow(68, 9, 60, 9),
    ),
    "air_drag": (
        HUNG,
        ("cloth", "M40 7C40 24 46 38 54 50"),
        _arrow(70, 20, 50, 20),
        _arrow(74, 32, 53, 32),
        _arrow(78, 44, 57, 44),
    ),
    "added_mass": (
        HUNG,
        ("was", "M40 10C56 16 62 40 50 50M40 10C28 18 30 42 50 50"),
        ("cloth", "M40 7C41 24 45 38 50 50"),
        _arrow(48, 30, 70, 30),
    ),
    "draught": (
        HUNG,
        PLUMB,
        ("cloth", "M40 7C40 24 46 38 54 50"),
        _arrow(8, 18, 30, 18),
        _arrow(8, 30, 32, 30),
        _arrow(8, 42, 36, 42),
    ),
    "air_lift": (("cloth", "M18 14L58 42"), ("was", "M24 5L68 36M8 20L52 51"), _arrow(38, 28, 50, 10)),
    "time_offset": (
        ("was", "M6 36C14 4 24 4 32 30S50 56 58 26"),
        ("cloth", "M20 36C28 4 38 4 46 30S64 56 72 26"),
        _arrow(22, 50, 36, 50),
    ),
    "gravity_tilt": (
        PLUMB,
        ("hot", "M40 7L54 48"),
        _dots("dot", (54, 48), radius=3),
        ("thin", "M40 40Q46 41 51 38"),
        HUNG,
    ),
    "depth_scale": (
        ("bar", "M6 22H18V34H6ZM18 25L24 22V34L18 31"),
        ("was", "M48 10V46"),
        ("hot", "M60 6V50"),
        ("thin", "M24 28L60 6M24 28L60 50"),
        _arrow(48, 28, 59, 28),
    ),
    "filter_lag": (("was", "M6 46H24V12H50V46H74"), ("hot", "M6 46H24C28 20 36 14 50 13C54 36 62 44 74 45")),
    "corner_erosion": (
        WAS_FLAT,
        ("cloth", "M22 10H58V36Q57 44 49 45H31Q23 44 22 36Z"),
        _arrow(16, 51, 26, 42),
        _arrow(64, 51, 54, 42),
    ),
    "clock_drift": (
        ("thin", "M6 16H74M6 40H74"),
        _ticks("cloth", 16, 8, 20, 32, 44, 56, 68),
        _ticks("hot", 40, 8, 21.5, 35, 48.5, 62, 74),
    ),
    "tracker_smoothing": (
        ("was", "M6 28Q12 4 18 28T30 28T42 28T54 28T66 28T74 24"),
        ("hot", "M6 28Q12 20 18 28T30 28T42 28T54 28T66 28T74 26"),
        _dots("dot", (12, 24), (24, 32), (36, 24), (48, 32), (60, 24)),
    ),
    "sliding_points": (
        HUNG,
        ("cloth", "M40 7C40 20 30 26 34 38C36 44 44 46 50 50"),
        _dots("ghost", (40, 12), (36, 24), (33, 34)),
        _dots("dot", (39, 18), (33, 31), (38, 43)),
        _arrow(48, 20, 44, 32),
    ),
    "eroded_outline": (HUNG, ("cloth", "M40 7C42 20 48 30 54 38"), ("was", "M54 38L64 50"), _arrow(70, 44, 60, 36)),
    "frame_timing": (
        ("thin", "M6 16H74M6 40H74"),
        _ticks("cloth", 16, 10, 24, 38, 52, 66),
        _ticks("hot", 40, 12, 32, 42, 62, 70),
        _arrow(25, 24, 31, 31),
        _arrow(53, 24, 61, 31),
    ),
}
