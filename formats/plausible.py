"""Check numbers that a person typed or a file states against the ranges of cloth, hangers and sensors.

A number outside its range was probably meant in another unit. Woven and knitted fabrics weigh 0.02 to 1.5 kg/m^2. The
618 fabrics of ClothDrapeTester (SIGGRAPH Asia 2022) weigh 0.03 to 0.7. Garments that hang from a hanger have sides of
0.1 to 3 m. Cameras and motion capture deliver 5 to 1000 frames a second.
"""

from __future__ import annotations

import numpy as np

from formats.arrays import Floats
from formats.errors import ImplausibleError
from formats.garment import Garment
from formats.meant_units import NEAR_A_RANGE, OUNCE, step_or_anyway, unit_of
from formats.plain_text import shortened
from formats.plausible_rig import check_plausible_rig
from formats.take import Take

LIGHTEST, HEAVIEST = 0.02, 1.5  # kg/m^2, each layer: the module states the fabrics
HEAVY_UNITS = (("grams", 1e-3), ("ounces", OUNCE))  # kg of each, the likelier first: some densities fit both
MOST_USUAL_LAYERS = 2  # front and back
# m, the longer side of the flat garment. Our choice: a swatch's side, and beyond a person's height. A wrong unit is
# off 39 times or more, so half and twice of either would tell units as well.
SHORTEST, LONGEST = 0.1, 3.0
# of the flat distance: hanging cloth brings its points nearer. Our choice: centimetres and millimetres stay apart.
FOLDED_TO = 0.25
FRAMES_LOOKED_AT = 1000  # for a median distance. Our choice: bounds memory, and a wrong unit shows in any frame
POINTS_APART = 1e-3  # m between two points; our choice: the smallest markers of motion capture are 1.5 mm wide
SLOWEST, FASTEST = 5.0, 1000.0  # frames a second; the module states the cameras; at 5, a swing at 2 Hz has 2.5 frames
USABLE_RATES = f"{SLOWEST:g} to {FASTEST:g} can be used"
SAME_STEP = 1e-6  # s, or of a step: times of frame numbers differ by 1, but for the rounding of a division
LARGEST_JUMP = 600.0  # s between two frames: five times the longest recording; a simulation covers the whole time
NEAR_A_RATE = 2.0  # times: a rate nearer to the range has the right unit; a wrong unit is off 30 times or more
RATE_WITHIN = 1.2  # times: largest ratio of the stamps' and the stated frame rate
CLOCKS = (  # units [s], with the name of the times' column in Hangtime's own CSV
    ("seconds", 1.0, "time_s"), ("milliseconds", 1e-3, "time_ms"), ("microseconds", 1e-6, "time_us"),
    ("nanoseconds", 1e-9, "time_ns"),
)  # fmt: skip


def check_plausible_take(take: Take, where: object, *, offers_anyway: bool = False) -> None:
    """Refuse a take with an implausible garment, hanger or time.

    offers_anyway: here and below, whether the command has the option --anyway, which the error then names

    Raises:
        ImplausibleError: names the number, its range and the unit that fits.
    """
    check_plausible_garment(take.garment, where, offers_anyway=offers_anyway)
    check_plausible_rig(take.rig, where, offers_anyway=offers_anyway)
    check_plausible_times(take.time, where, offers_anyway=offers_anyway)
    _check_reach(take, where, offers_anyway=offers_anyway)


def _check_reach(take: Take, where: object, *, offers_anyway: bool) -> None:
    """Refuse points and held ends that lie much farther apart than the garment lets them, as in another unit."""
    corners, tracked = np.array(take.garment.outline_m), np.array([point.at_m for point in take.garment.points])
    for name, places, valid, flat in (
        ("held ends", take.held, take.held_valid, corners[:2]),
        ("points", take.points, take.points_valid, tracked.reshape(-1, 2)),
    ):
        rows = np.flatnonzero(valid.sum(1) > 1)
        if not len(rows):
            continue
        rows = rows[:: 1 + len(rows) // FRAMES_LOOKED_AT]
        ends = [edge(np.where(valid[rows, :, None], places[rows], np.nan), axis=1) for edge in (np.nanmin, np.nanmax)]
        apart = float(np.median(np.linalg.norm(ends[1] - ends[0], axis=1)))
        most = float(np.hypot(*np.ptp(flat, axis=0)))
        if apart > NEAR_A_RANGE * most:
            meant = unit_of(apart, FOLDED_TO * most, most)
            raise ImplausibleError(
                f"its {name} lie up to {apart:.3g} m apart in the median, on the flat garment {most:.3g} m{meant}",
                where=where, advice=step_or_anyway("give places and garment in metres", offers_anyway),
            )  # fmt: skip


def check_plausible_garment(garment: Garment, where: object, *, offers_anyway: bool = False) -> None:
    """Refuse a garment of an implausible size or weight, and name the unit that was probably meant.

    Raises:
        ImplausibleError: names the number, its range and the unit that fits.
    """
    corners = np.array(garment.outline_m)
    side = float(np.ptp(corners, axis=0).max())
    if not SHORTEST <= side <= LONGEST:
        meant = unit_of(side, SHORTEST, LONGEST)
        raise ImplausibleError(
            f"outline_m is {side:g} m long, a garment {SHORTEST:g} to {LONGEST:g} m{meant}", where=where,
            advice=step_or_anyway("give metres", offers_anyway),
        )  # fmt: skip
    density = garment.areal_density / garment.layers
    if not LIGHTEST <= density <= HEAVIEST:
        layers = f" in {garment.layers} layers" if garment.layers > MOST_USUAL_LAYERS else ""
        is_far = density > NEAR_A_RANGE * HEAVIEST  # a nearer weight has the right unit
        fitting = [(name, kg) for name, kg in HEAVY_UNITS if is_far and LIGHTEST <= density * kg <= HEAVIEST][:1]
        meant = "".join(
            f"; were {garment.mass_kg:g} {name} meant, mass_kg = {garment.mass_kg * kg:g} ({density * kg:.2g} kg/m2)?"
            for name, kg in fitting
        )
        raise ImplausibleError(
            f"mass_kg = {garment.mass_kg:g}{layers} makes {density:.3g} kg/m2, fabric has {LIGHTEST:g} to {HEAVIEST:g}"
            f"{meant}", where=where, advice=step_or_anyway("weigh it and give kilograms", offers_anyway),
        )  # fmt: skip
    _check_places(garment, where, offers_anyway=offers_anyway)


def _check_places(garment: Garment, where: object, *, offers_anyway: bool) -> None:
    """Refuse two points of a garment at nearly one place."""
    places = np.array([point.at_m for point in garment.points]).reshape(-1, 2)
    for one in range(len(places)):
        others = np.flatnonzero(np.linalg.norm(places[one + 1 :] - places[one], axis=1) < POINTS_APART)
        if len(others):
            pair = garment.points[one], garment.points[one + 1 + int(others[0])]
            names = " and ".join(repr(shortened(point.name)) for point in pair)
            raise ImplausibleError(
                f"points: {names} are at one place, {list(pair[0].at_m)}", where=where,
                advice=step_or_anyway("give each point a place of its own", offers_anyway),
            )  # fmt: skip


def check_plausible_times(
    time: Floats, where: object, *, named_unit: float | None = None, offers_anyway: bool = False
) -> None:
    """Refuse implausible times [s], (frames,), increasing: frame numbers, other units, a jump of minutes.

    named_unit: unit [s] that the name of the times' column states, None where no name states one

    Raises:
        ImplausibleError: names the interval and the unit that was probably meant.
    """
    steps = np.diff(time)
    apart = float(np.median(steps)) if len(steps) else 1 / SLOWEST
    if apart * 1.001 >= 1 / FASTEST and apart <= 1.001 / SLOWEST:
        if len(steps) and (longest := float(steps.max())) > LARGEST_JUMP:
            raise ImplausibleError(
                f"its times jump by {longest:g} s after {time[int(steps.argmax())] - time[0]:.2f} s", where=where,
                advice=step_or_anyway("split the recording there, or mend its clock", offers_anyway),
            )  # fmt: skip
        return
    if SLOWEST / NEAR_A_RATE < 1 / apart < SLOWEST or FASTEST < 1 / apart < FASTEST * NEAR_A_RATE:
        advice = "record with more frames a second" if 1 / apart < SLOWEST else "leave out frames"
        raise ImplausibleError(
            f"has {1 / apart:.4g} frames a second; a garment needs {SLOWEST:g} to {FASTEST:g}", where=where,
            advice=step_or_anyway(advice, offers_anyway),
        )  # fmt: skip
    if apart > 1 / SLOWEST:
        _refuse_a_named_unit(apart, named_unit, f"{apart:g} s", where, offers_anyway=offers_anyway)
        fitting = [name for name, unit, _ in CLOCKS[1:] if 1 / FASTEST <= apart * unit <= 1 / SLOWEST]
        meant = f"are these {fitting[0]}?" if fitting else "is its time in seconds?"
        if np.all(np.abs(np.diff(time) - 1.0) < SAME_STEP):
            meant = "its times are frame numbers, or milliseconds at 1000 frames a second"
        raise ImplausibleError(
            f"its frames are {apart:g} s apart in the median; {meant}", where=where,
            advice=step_or_anyway(
                "give seconds: divide milliseconds by 1e3, nanoseconds by 1e9, frame numbers by the frame rate",
                offers_anyway,
            ),
        )  # fmt: skip
    _refuse_a_named_unit(apart, named_unit, f"{1e6 * apart:g} µs", where, offers_anyway=offers_anyway)
    raise ImplausibleError(
        f"its frames are {1e6 * apart:g} µs apart in the median, {1 / apart:.0f} a second; cameras deliver "
        f"{SLOWEST:g} to {FASTEST:g}", where=where, advice=step_or_anyway("give its time in seconds", offers_anyway),
    )  # fmt: skip


def _refuse_a_named_unit(
    apart: float, named: float | None, shown: str, where: object, *, offers_anyway: bool
) -> None:  # fmt: skip
    """Refuse times whose column would be plausible under another unit's name, with that name.

    `apart` [s]: median interval, `shown` in words; `named` [s]: as in `check_plausible_times`
    """
    if named is None or abs(apart / named - 1.0) < SAME_STEP:  # frame numbers have no unit
        return
    for unit_name, unit, column in CLOCKS:
        if 1 / FASTEST <= apart / named * unit <= 1 / SLOWEST:
            raise ImplausibleError(
                f"its frames are {shown} apart in the median; are these {unit_name}?", where=where,
                advice=step_or_anyway(f"name their column {column}", offers_anyway),
            )  # fmt: skip


def check_rate_alone(time: Floats, rate: float | None, where: object, *, offers_anyway: bool = False) -> None:
    """Refuse an implausible frame rate that a file states without times, or that another field contradicts.

    - `time` [s], (frames,): computed from the rate; `rate` [1/s]: the other field, None without one

    Raises:
        ImplausibleError: names the rate, and the other field.
    """
    if len(time) < 2:
        return
    found = 1 / float(np.median(np.diff(time)))
    advice = step_or_anyway("export it again with its frame rate", offers_anyway)
    if not SLOWEST / 1.001 <= found <= FASTEST * 1.001:
        raise ImplausibleError(f"states {found:.4g} frames a second; {USABLE_RATES}", where=where, advice=advice)
    if rate is not None and not 1 / RATE_WITHIN <= found / rate <= RATE_WITHIN:
        raise ImplausibleError(
            f"states {found:.4g} frames a second, and its header {rate:.4g}", where=where, advice=advice
        )


def check_stated_rate(time: Floats, rate: float | None, where: object, *, offers_anyway: bool = False) -> None:
    """Refuse increasing times [s], (frames,), that contradict the frame rate [1/s] stated in the same file.

    Raises:
        ImplausibleError: names both.
    """
    if rate is None or len(time) < 2:
        return
    found = 1 / float(np.median(np.diff(time)))
    if 1 / RATE_WITHIN <= found / rate <= RATE_WITHIN:
        return
    raise ImplausibleError(
        f"its times come at {found:.4g} frames a second, and the file states {rate:.4g}", where=where,
        advice=step_or_anyway("export it again with times in seconds", offers_anyway),
    )  # fmt: skip
