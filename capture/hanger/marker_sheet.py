"""A page of fiducial markers to print to scale, with scale bars to check the print.

A marker of n x n bits has a black border one bit wide, so its side is n + 2 bits. Around it a quiet zone of one bit
stays white, which detection needs. One unit of the drawing is one millimetre; the page is A4.
Source: S. Garrido-Jurado et al., "Automatic generation and detection of highly reliable fiducial markers under
occlusion", Pattern Recognition 47 (2014), section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, tostring

import cv2

from capture.errors import UntrackableError
from capture.hanger.marker_detection import marker_dictionary
from formats.outputs import AS_SHEET, check_ending, write_text

PAGE = (210.0, 297.0)  # mm, A4
# mm that no printer reaches. Our choice: wider than a home printer leaves blank; with less, a border would be cut
# off.
PRINTER_MARGIN = 15.0
# mm. Our choice: long enough that a ruler's 0.5 mm is 0.5 %; a shorter bar would hide a printer's wrong scale.
SCALE_BAR = 100.0
# mm between markers, with their labels. Our choice: room for a label of 3.6 mm and scissors; with less, a cut would
# enter a border.
GAP = 12.0
LABEL_STYLE = {"font-family": "sans-serif", "font-size": "3.6"}  # mm


@dataclass(frozen=True)
class Placed:
    """One marker on the page: id and upper left corner of its black square [mm]."""

    id: int
    left: float
    top: float


def draw_sheet(dictionary: str, ids: list[int], size_m: float) -> str:
    """Return an SVG page of these markers, each `size_m` [m] from black edge to black edge.

    Raises:
        UntrackableError: an unknown dictionary or id, the same id twice, a bad size, or too many markers for a page.
    """
    known = marker_dictionary(dictionary)
    count = len(known.bytesList)
    for marker in ids:
        if not 0 <= marker < count:
            raise UntrackableError(
                f"there is no marker {marker} in {dictionary}", where="--ids", advice=f"use ids from 0 to {count - 1}"
            )
    if len(set(ids)) != len(ids):
        raise UntrackableError(
            "the same id is asked for twice", where="--ids", advice="give two different ids, one for each marker"
        )
    if not (math.isfinite(size_m) and size_m > 0):
        raise UntrackableError(
            f"{size_m:g} m is no size of a marker", where="--size", advice="give metres, as in --size 0.06"
        )
    side = 1e3 * size_m
    bits = known.markerSize + 2
    placed = _place(ids, side, side / bits)
    page = Element("svg", {
        "xmlns": "http://www.w3.org/2000/svg", "width": f"{PAGE[0]:g}mm", "height": f"{PAGE[1]:g}mm",
        "viewBox": f"0 0 {PAGE[0]:g} {PAGE[1]:g}",
    })  # fmt: skip
    SubElement(page, "rect", {"width": "100%", "height": "100%", "fill": "#fff"})
    for one in placed:
        _add_marker(page, known, one, side, bits)
    _add_bar(page, PRINTER_MARGIN, PAGE[1] - PRINTER_MARGIN, horizontal=True)
    _add_bar(page, PAGE[0] - PRINTER_MARGIN, PAGE[1] - PRINTER_MARGIN - SCALE_BAR, horizontal=False)
    notes = (
        f"{dictionary}, {side:g} mm from black edge to black edge.",
        f"Print at 100 %, not fitted to the page; both bars must measure {SCALE_BAR:g} mm.",
    )
    for k, note in enumerate(notes):
        place = {"x": f"{PRINTER_MARGIN:g}", "y": f"{PAGE[1] - PRINTER_MARGIN - 11 + 5 * k:g}"}
        SubElement(page, "text", place | LABEL_STYLE).text = note
    return f"{tostring(page, encoding='unicode')}\n"


def write_sheet(path: Path, dictionary: str, ids: list[int], size_m: float) -> Path:
    """Write the page as SVG.

    Raises:
        UntrackableError: as `draw_sheet`.
        OutputError: another ending than .svg, or the file cannot be written.
    """
    check_ending(path, *AS_SHEET)
    page = draw_sheet(dictionary, ids, size_m)
    write_text(path, page)
    return path


def _place(ids: list[int], side: float, quiet: float) -> list[Placed]:
    """Lay the markers out in rows from the upper left, with quiet zones and labels between."""
    step = side + 2 * quiet + GAP
    wide = int((PAGE[0] - 2 * PRINTER_MARGIN - 8 + GAP) // step)
    high = int((PAGE[1] - 2 * PRINTER_MARGIN - 12 + GAP) // step)
    if wide * high < len(ids):
        raise UntrackableError(
            f"{len(ids)} markers of {side:g} mm do not fit on a page",
            where="--size",
            advice="print fewer at a time, or smaller ones: 0.03 to 0.08 m suits 1 to 2.5 m of distance",
        )
    return [
        Placed(marker, PRINTER_MARGIN + quiet + (k % wide) * step, PRINTER_MARGIN + quiet + (k // wide) * step)
        for k, marker in enumerate(ids)
    ]


def _add_marker(page: Element, known: cv2.aruco.Dictionary, placed: Placed, side: float, bits: int) -> None:
    image = known.generateImageMarker(placed.id, bits)
    bit = side / bits
    border = {"fill": "#fff", "stroke": "#bbb", "stroke-width": "0.2", "stroke-dasharray": "2 2"}
    SubElement(page, "rect", _square(placed.left - bit, placed.top - bit, side + 2 * bit) | border)
    SubElement(page, "rect", _square(placed.left, placed.top, side) | {"fill": "#000"})
    white = SubElement(page, "g", {"fill": "#fff", "shape-rendering": "crispEdges"})
    for row in range(bits):
        for column in range(bits):
            if image[row, column]:
                SubElement(white, "rect", _square(placed.left + column * bit, placed.top + row * bit, bit))
    place = {"x": f"{placed.left:.4f}", "y": f"{placed.top + side + 1.5 * bit + 4:.4f}"}
    SubElement(page, "text", place | LABEL_STYLE).text = f"id {placed.id}, upright as printed"


def _square(left: float, top: float, side: float) -> dict[str, str]:
    return {"x": f"{left:.4f}", "y": f"{top:.4f}", "width": f"{side:.4f}", "height": f"{side:.4f}"}


def _add_bar(page: Element, x: float, y: float, *, horizontal: bool) -> None:
    end = (x + SCALE_BAR, y) if horizontal else (x, y + SCALE_BAR)
    across = (0.0, 2.0) if horizontal else (2.0, 0.0)
    lines = [(x, y, *end)]
    lines += [(px - across[0], py - across[1], px + across[0], py + across[1]) for px, py in ((x, y), end)]
    for x1, y1, x2, y2 in lines:
        ends = {"x1": f"{x1:g}", "y1": f"{y1:g}", "x2": f"{x2:g}", "y2": f"{y2:g}"}
        SubElement(page, "line", ends | {"stroke": "#000", "stroke-width": "0.25"})
