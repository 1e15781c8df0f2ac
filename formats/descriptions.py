"""Read and write rig and garment descriptions (TOML); every error names the file and the field."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from formats.errors import DescriptionError
from formats.garment import Garment, TrackedPoint, signed_area
from formats.meant_units import NEAR_A_RANGE, unit_of
from formats.near_names import near_names
from formats.plain_text import code_in, shortened
from formats.plausible import check_plausible_garment
from formats.plausible_rig import DICTIONARIES, LARGEST_MARKER, SHORTEST_BAR, SMALLEST_MARKER, check_plausible_rig
from formats.polygons import (
    corner_twice,
    cross,
    crosses_itself,
    distances_outside,
    first_overlap,
    inside,
    touch,
    touches_itself,
)
from formats.rig import Calibration, Hanger, Rig, RigBody, Sensor
from formats.toml_files import Tables, place_in, read_toml
from formats.wrong_fields import wrong_field

Description = TypeVar("Description", Garment, Rig)

MOST_POINTS = 2000  # tracked; motion capture of cloth has some hundred
MOST_LETTERS_OF_A_NAME = 1000  # characters of a garment's or a point's name: tables and pages show it
MOST_CORNERS = 1000  # of an outline, and of all holes together
HEAVIEST_GARMENT = 50.0  # kg; our choice: no hanger holds more, and grams of a skirt are beyond it
DEPTH_SCALES = 0.8, 1.25  # measured over true depth; beyond them, a distance was measured wrong
LARGEST_OFFSET = 30.0  # px between depth and colour; PrimeSense's unregistered images differ by up to this at 0.8 m
MOST_PIXELS = 100_000  # along a picture's side; our choice: far beyond any sensor's, so that a larger number is damage
HEIGHT_TOLERANCE = 0.01  # m, tolerance of other sides above the held edge's lower end: flat cloth is laid by hand
ESCAPED_IN_TOML = re.compile(r"[\x00-\x1f\x7f]")  # characters that TOML strings must escape, toml.io/en/v1.0.0#string
LEAST_FALL, MOST_FALL = 9.5, 10.1  # m/s^2: from 9.78 at the equator to 9.83 at the poles, typed with two digits or more
ACCELERATIONS = ("m/s2", 1.0), ("cm/s2", 1e-2), ("mm/s2", 1e-3), ("thousandths of g", 9.80665e-3), ("ft/s2", 0.3048)
UNMEASURED = "calibration.depth_offset_sd_px", math.inf  # along an axis that was never measured
LARGEST_FIELD = 1e9  # in any unit: squares and products of larger ones may overflow
NEEDED_OF_BODIES = {"plane": ("normal",), "sphere": ("radius_m",), "capsule": ("to_m", "radius_m")}
THINNEST_BODY, LARGEST_BODY = 0.01, 10.0  # m, radius: a thinner body slips between the points where contact is checked
SHORTEST_CAPSULE = 1e-6  # m between the ends: the square of a shorter length is lost in rounding
ON_OUTLINE = 2e-3  # m, of a tracked point outside the outline; our choice: a ruler errs by 1 mm at either end


def load_garment(path: Path, *, anyway: bool | None = None) -> Garment:
    """Read a garment description.

    anyway: accept implausible sizes and weights; None: refuse them, and do not offer --anyway in the error

    Raises:
        DescriptionError: the file is missing, malformed, impossible or implausible; names the field.
    """
    plain = read_toml(path)
    with _naming_the_line(path, plain):
        garment = _converted(path, plain, Garment)
        refuse_codes(path, plain)
        check_garment(garment, path)
        if not anyway:
            check_plausible_garment(garment, path, offers_anyway=anyway is not None)
    return garment


def load_rig(path: Path, *, anyway: bool | None = None) -> Rig:
    """Read a rig description.

    anyway: accept implausible sizes; None: refuse them, and do not offer --anyway in the error

    Raises:
        DescriptionError: the file is missing, malformed, impossible or implausible; names the field.
    """
    plain = read_toml(path)
    with _naming_the_line(path, plain):
        rig = _converted(path, plain, Rig)
        refuse_codes(path, plain)
        check_rig(rig, path)
        if not anyway:
            check_plausible_rig(rig, path, offers_anyway=anyway is not None)
    return rig


def says(path: Path, description: Garment | Rig) -> bool:
    """Return whether an existing file holds the same values as a description, in any spelling.

    An implausible file counts too, since the user may have accepted it.

    Raises:
        DescriptionError: the file cannot be read, or is no description.
    """
    if isinstance(description, Rig):
        return load_rig(path, anyway=True) == description
    return load_garment(path, anyway=True).as_meant == description.as_meant


def dump_description(description: Garment | Rig) -> str:
    """Return the TOML text of a rig or garment."""
    plain = {k: v for k, v in msgspec.to_builtins(description).items() if v is not None}
    lines, tables = [], []
    for key, value in plain.items():
        if isinstance(value, dict):
            tables.append(f"\n[{key}]\n" + "".join(f"{k} = {_toml(v)}\n" for k, v in value.items() if v is not None))
        elif key in ("points", "bodies"):
            for part in value:
                tables.append(f"\n[[{key}]]\n" + "".join(f"{k} = {_toml(v)}\n" for k, v in part.items()))
        else:
            lines.append(f"{key} = {_toml(value)}\n")
    return "".join(lines) + "".join(tables)


def refuse_codes(path: Path, plain: Any, field: str = "") -> None:
    """Refuse a text with a line break, a terminal control code, or a code that reverses the writing direction.

    plain: the tables of a description, as `msgspec.to_builtins` gives them

    Raises:
        DescriptionError: names the field and the code.
    """
    if isinstance(plain, dict):
        for key, part in plain.items():
            refuse_codes(path, part, f"{field}.{key}" if field else key)
    elif isinstance(plain, list):
        for number, part in enumerate(plain):
            refuse_codes(path, part, f"{field}[{number}]")
    elif isinstance(plain, str) and (code := code_in(plain)):
        raise DescriptionError(f"{field} has the control character {code}", where=path, advice="type it again")


def _toml(value: Any) -> str:
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + ESCAPED_IN_TOML.sub(lambda found: f"\\u{ord(found.group()):04x}", escaped) + '"'
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    return repr(value)


@contextmanager
def _naming_the_line(path: Path, plain: Tables) -> Iterator[None]:
    """Add the line of the wrong field to an error."""
    try:
        yield
    except DescriptionError as error:
        raise type(error)(error.what, where=place_in(path, plain, error.what), advice=error.advice) from error


def _converted(path: Path, plain: Tables, kind: type[Description]) -> Description:
    try:
        return msgspec.convert(dict(plain), kind)
    except msgspec.ValidationError as error:
        words, add = wrong_field(error, (kind, *PARTS[kind]), plain), ""
        if "format" not in plain:
            add = f'add the line format = "hangtime-{kind.__name__.lower()}/2" at its top, and '
        raise DescriptionError(words, where=path, advice=f"{add}see docs/reference/file-formats.md") from error


PARTS: dict[Any, tuple[Any, ...]] = {Garment: (TrackedPoint,), Rig: (RigBody, Hanger, Sensor, Calibration)}


def check_garment(garment: Garment, where: object) -> None:
    """Check the rules of a garment that types cannot express.

    Raises:
        DescriptionError: an impossible garment; names the field.
    """

    def refuse(what: str) -> None:
        raise DescriptionError(what, where=where, advice="see docs/reference/file-formats.md")

    _refuse_what_is_not_finite(garment, refuse)
    if not 0 < garment.mass_kg < HEAVIEST_GARMENT:
        grams = garment.mass_kg / 1000
        meant = f"; were grams meant, mass_kg = {grams:g}?" if 0 < grams < HEAVIEST_GARMENT else ""
        refuse(f"mass_kg must be above 0 and below {HEAVIEST_GARMENT:g} (got {garment.mass_kg:g}){meant}")
    if garment.layers < 1:
        refuse(f"layers must be 1 or more (got {garment.layers})")
    outline = np.array(garment.outline_m, float)
    holes = sum(len(hole) for hole in garment.holes_m)
    if max(len(outline), holes) > MOST_CORNERS:
        refuse(f"outline_m has {len(outline)} corners and holes_m {holes}, at most {MOST_CORNERS} each can be used")
    if len(garment.points) > MOST_POINTS:
        refuse(f"points: {len(garment.points)} are more than the {MOST_POINTS} that a take holds")
    if len(outline) < 3:
        refuse(f"outline_m needs 3 corners or more (got {len(outline)})")
    _check_units_of_places(garment, outline, refuse)
    if (twice := corner_twice(outline)) is not None:
        refuse(f"outline_m has the corner {twice} twice: leave one out; the last corner is joined to the first anyway")
    if crosses_itself(outline):
        refuse("outline_m crosses itself: list the corners in order, from the top left clockwise")
    if garment.area_m2 < 1e-4:
        whose = ", less its holes," if holes else ""
        refuse(f"outline_m{whose} encloses hardly any area ({garment.area_m2:.2g} m2)")
    if (touched := touches_itself(outline)) is not None:
        refuse(f"outline_m touches itself at its corner {touched}: cloth needs some width there")
    _check_held_edge(garment, refuse)
    _check_version_2(garment, outline, refuse)
    names = garment.point_names
    if twice_used := [name for name, times in Counter(names).items() if times > 1]:
        refuse(f"points: the name {shortened(twice_used[0])!r} is used twice")
    if (longest := max(len(name) for name in (garment.name, *names))) > MOST_LETTERS_OF_A_NAME:
        refuse(f"a name has {longest} letters, at most {MOST_LETTERS_OF_A_NAME} can be used")
    places = np.array([point.at_m for point in garment.points]).reshape(-1, 2)
    if (outside := distances_outside(places, outline) > ON_OUTLINE).any():
        refuse(f"points: {shortened(garment.points[int(outside.argmax())].name)!r} lies outside the outline")


def _check_units_of_places(garment: Garment, outline: np.ndarray[Any, Any], refuse: Callable[[str], None]) -> None:
    """Refuse holes and points far outside an outline in metres; name the unit in which all of them would fit it."""
    farthest = float(np.abs(outline).max())
    lists = {f"holes_m: hole {number}": hole for number, hole in enumerate(garment.holes_m, 1)}
    lists |= {f"points: {shortened(point.name)!r}": (point.at_m,) for point in garment.points}
    every = {"holes_m": garment.holes_m, "points": ([point.at_m for point in garment.points],)}
    for words, places in lists.items():
        away = float(np.abs(np.array(places, float)).max(initial=0.0))
        if away > NEAR_A_RANGE * farthest:
            of_list = [abs(part) for hole in every[words.split(":")[0]] for place in hole for part in place]
            meant = unit_of(max(of_list), 0.0, farthest * (1 + ON_OUTLINE))
            refuse(f"{words} has a coordinate of {away:g} m, and the outline none above {farthest:g} m{meant}")


def _check_held_edge(garment: Garment, refuse: Callable[[str], None]) -> None:
    """Check that the outline goes clockwise and begins with its top side, and that no other side lies wholly higher."""
    corners = garment.outline_m
    is_clockwise = signed_area(corners) < 0
    in_order = corners if is_clockwise else corners[::-1]
    sides = list(zip(in_order, (*in_order[1:], in_order[0]), strict=True))
    top = max(sides, key=lambda side: (min(side[0][1], side[1][1]), abs(side[1][0] - side[0][0])))
    (left, left_y), (right, right_y) = corners[:2]
    is_on_top = left < right and min(left_y, right_y) > min(top[0][1], top[1][1]) - HEIGHT_TOLERANCE
    if not (is_clockwise and is_on_top):
        wrong = "does not begin with the held edge" if is_clockwise else "goes anticlockwise"
        refuse(
            f"outline_m {wrong}: x is to the right and y up. Begin with the top side's left and right end, which seem "
            f"to be {list(top[0])} and {list(top[1])}. List the others clockwise"
        )


def _check_version_2(garment: Garment, outline: np.ndarray[Any, Any], refuse: Callable[[str], None]) -> None:
    """Check holes, seams and grain."""
    if garment.format == "hangtime-garment/1" and (garment.holes_m or garment.seams or garment.grain_degrees):
        refuse('holes_m, seams and grain_degrees need format = "hangtime-garment/2"')
    if garment.format == "hangtime-garment/1" and garment.points_are is not None:
        refuse('points_are needs format = "hangtime-garment/2"')
    holes = [np.array(corners, float) for corners in garment.holes_m]
    for number, hole in enumerate(holes, 1):
        if len(hole) < 3 or crosses_itself(hole):
            refuse(f"holes_m: hole {number} needs 3 corners or more, in order round it")
        if corner_twice(hole) is not None or touches_itself(hole) is not None:
            refuse(f"holes_m: hole {number} touches itself, or has a corner twice")
        if distances_outside(hole, outline).any() or cross(hole, outline):
            refuse(f"holes_m: hole {number} is not inside the outline")
        if touch(hole, outline):
            refuse(f"holes_m: hole {number} touches the outline: cut it out of the outline instead")
    if (pair := first_overlap(holes)) is not None:
        refuse(f"holes_m: hole {pair[0] + 1} overlaps hole {pair[1] + 1}")
    places = np.array([point.at_m for point in garment.points]).reshape(-1, 2)
    for number, hole in enumerate(holes, 1):
        if (lost := inside(places, hole)).any():
            refuse(f"points: {shortened(garment.points[int(lost.argmax())].name)!r} lies in hole {number}")
    if len(set(garment.seams)) < len(garment.seams):
        refuse("seams: one is there twice")
    for pair in garment.seams:
        if not all(0 <= corner < len(outline) for corner in pair) or (pair[1] - pair[0]) % len(outline) != 1:
            refuse(f"seams: {list(pair)} are not neighbouring corners of the outline, clockwise, counted from 0")
    if not -90 <= garment.grain_degrees <= 90:
        refuse(f"grain_degrees must be between -90 and 90 (got {garment.grain_degrees:g})")


def _refuse_what_is_not_finite(description: Garment | Rig, refuse: Callable[[str], None]) -> None:
    """Refuse numbers that are not finite, and negative standard deviations."""

    def look(value: Any, field: str) -> None:
        if isinstance(value, dict):
            for key, part in value.items():
                look(part, f"{field}.{key}" if field else key)
        elif isinstance(value, list | tuple):
            for number, part in enumerate(value):  # the name of a table tells its place; a list's field is one line
                look(part, f"{field}[{number}]" if isinstance(part, dict) else field)
        elif isinstance(value, int | float):
            if isinstance(value, float) and not math.isfinite(value) and (field, value) != UNMEASURED:
                refuse(f"{field} has a number that is not finite (got {value:g})")
            elif abs(value) > LARGEST_FIELD and (field, value) != UNMEASURED:
                refuse(f"{field} has a number beyond {LARGEST_FIELD:g} (got {value:g})")
            if "_sd" in field and value < 0:
                refuse(f"{field} is a standard deviation and cannot be below 0 (got {value:g})")

    look(msgspec.to_builtins(description, enc_hook=float), "")


def check_rig(rig: Rig, where: object) -> None:
    """Check the rules of a rig that types cannot express.

    Raises:
        DescriptionError: an impossible rig; names the field.
    """

    def refuse(what: str) -> None:
        raise DescriptionError(what, where=where, advice="see docs/reference/file-formats.md")

    _refuse_what_is_not_finite(rig, refuse)
    length = float(np.linalg.norm(rig.gravity))
    if not abs(length - 1) < 0.01:
        upright = ", ".join(f"{part / length:.6g}" for part in rig.gravity) if length > 0 else ""
        units = [unit for unit, size in ACCELERATIONS if LEAST_FALL <= length * size <= MOST_FALL]
        meant = f"; were {' or '.join(units)} meant, gravity = [{upright}]?" if units else ""
        refuse(f"gravity must be a unit vector (its length is {length:.3g}){meant}")
    if rig.sensor is not None:
        for name in ("width", "height", "fx", "fy"):
            if not 0 < getattr(rig.sensor, name) < MOST_PIXELS:
                refuse(f"sensor.{name} must be above 0 and below {MOST_PIXELS} (got {getattr(rig.sensor, name):g})")
        for name, size in (("cx", rig.sensor.width), ("cy", rig.sensor.height)):
            if not 0 < getattr(rig.sensor, name) < size:
                refuse(
                    f"sensor.{name} must lie in the picture, between 0 and {size} (got {getattr(rig.sensor, name):g})"
                )
    if rig.hanger is not None:
        hanger = rig.hanger
        if hanger.ids[0] == hanger.ids[1]:
            refuse(f"hanger.ids must differ (both are {hanger.ids[0]})")
        for colour in hanger.dot_colours or ():
            if not all(0 <= part <= 255 for part in colour):
                refuse(f"hanger.dot_colours must be three numbers from 0 to 255 each (got {list(colour)})")
        if not 0 < hanger.marker_size_m < hanger.marker_distance_m:
            _refuse_the_likelier(hanger, refuse)
        if hanger.marker == "fiducial":
            _check_markers(hanger, refuse)
        if not np.linalg.norm(np.subtract(*hanger.held_m)) > 0.01:
            refuse("hanger.held_m: the two ends of the held edge are at the same place")
    _check_bodies(rig, refuse)
    if rig.calibration is not None:
        calibration = rig.calibration
        least, most = DEPTH_SCALES
        if not least < calibration.depth_scale < most:
            scale = calibration.depth_scale
            meant = f"; were per cent meant, {scale / 100:g}?" if least < scale / 100 < most else ""
            refuse(f"calibration.depth_scale must be between {least:g} and {most:g} (got {scale:g}){meant}")
        offset = calibration.depth_offset_px
        if not max(map(abs, offset)) <= LARGEST_OFFSET:
            refuse(
                f"calibration.depth_offset_px must be at most {LARGEST_OFFSET:g} pixels either way (got "
                f"{max(offset, key=abs):g})"
            )


def _refuse_the_likelier(hanger: Hanger, refuse: Callable[[str], None]) -> None:
    """Refuse markers that overlap; name the size where no marker has that size, else the distance."""
    size, distance = hanger.marker_size_m, hanger.marker_distance_m
    if not SMALLEST_MARKER <= size <= LARGEST_MARKER:
        meant = unit_of(size, SMALLEST_MARKER, LARGEST_MARKER) if size > LARGEST_MARKER else ""
        refuse(f"hanger.marker_size_m must be above 0 and below hanger.marker_distance_m (got {size:g}){meant}")
    meant = f"; was {10 * distance:g} meant?" if distance >= SHORTEST_BAR and size < 10 * distance else ""
    refuse(f"hanger.marker_distance_m, {distance:g}, must be above hanger.marker_size_m, {size:g}{meant}")


def _check_markers(hanger: Hanger, refuse: Callable[[str], None]) -> None:
    """Check that the dictionary has the hanger's markers."""
    if hanger.dictionary not in DICTIONARIES:
        close = near_names(hanger.dictionary, list(DICTIONARIES))
        hint = f"; did you mean {close[0]}?" if close else ""
        refuse(f"hanger.dictionary {hanger.dictionary!r} is none of OpenCV's{hint}")
    count = DICTIONARIES[hanger.dictionary]
    if wrong := [number for number in hanger.ids if not 0 <= number < count]:
        refuse(f"hanger.ids: {hanger.dictionary} has the markers 0 to {count - 1} (got {wrong[0]})")


def _check_bodies(rig: Rig, refuse: Callable[[str], None]) -> None:
    """Check that each body has the fields of its kind, no others, and a size that a simulation can handle."""
    if not isinstance(rig.camera_at_m, msgspec.UnsetType):
        if rig.format == "hangtime-rig/1":
            refuse('camera_at_m needs format = "hangtime-rig/2"')
        if rig.sensor is not None:
            refuse("camera_at_m: the sensor is in the origin of its own frame; leave camera_at_m out")
    if rig.near and rig.format == "hangtime-rig/1":
        refuse('bodies need format = "hangtime-rig/2"')
    for number, body in enumerate(rig.near, 1):
        needed = NEEDED_OF_BODIES[body.kind]
        for name in ("normal", "to_m", "radius_m"):
            if (getattr(body, name) is None) == (name in needed):
                refuse(f"bodies: a {body.kind} needs at_m, {' and '.join(needed)}, and nothing else (body {number})")
        if body.radius_m is not None and not THINNEST_BODY <= body.radius_m <= LARGEST_BODY:
            refuse(
                f"bodies: radius_m must be between {THINNEST_BODY:g} and {LARGEST_BODY:g} (body {number} has "
                f"{body.radius_m:g}){unit_of(body.radius_m, THINNEST_BODY, LARGEST_BODY)}"
            )
        if body.normal is not None and not np.linalg.norm(body.normal) > 0:
            refuse(f"bodies: the normal of body {number} has no direction")
        if body.to_m is not None and not np.linalg.norm(np.subtract(body.to_m, body.at_m)) > SHORTEST_CAPSULE:
            refuse(f"bodies: the capsule {number} ends where it begins: a sphere does")
