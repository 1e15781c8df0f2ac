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

import cv2

from capture.errors import UntrackableError
from capture.hanger.marker_detection import marker_dictionary
from formats.errors import OutputError
from formats.outputs import write_text

PAGE = (210.0, 297.0)  # mm, A4
PRINTER_MARGIN = 15.0  # mm that no printer reaches
SCALE_BAR = 100.0  # mm
GAP = 12.0  # mm between markers, with their labels


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
    marks = "".join(_marker(known, one, side, bits) for one in placed)
    notes = (
        f"{dictionary}, {side:g} mm from black edge to black edge.",
        f"Print at 100 %, not fitted to the page; both bars must measure {SCALE_BAR:g} mm.",
    )
    lines = "".join(
        f'<text x="{PRINTER_MARGIN:g}" y="{PAGE[1] - PRINTER_MARGIN - 11 + 5 * k:g}" font-family="sans-serif" '
        f'font-size="3.6">{note}</text>'
        for k, note in enumerate(notes)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{PAGE[0]:g}mm" height="{PAGE[1]:g}mm" '
        f'viewBox="0 0 {PAGE[0]:g} {PAGE[1]:g}"><rect width="100%" height="100%" fill="#fff"/>{marks}'
        f"{_bar(PRINTER_MARGIN, PAGE[1] - PRINTER_MARGIN, horizontal=True)}"
        f"{_bar(PAGE[0] - PRINTER_MARGIN, PAGE[1] - PRINTER_MARGIN - SCALE_BAR, horizontal=False)}"
        f"{lines}"
        "</svg>\n"
    )


def write_sheet(path: Path, dictionary: str, ids: list[int], size_m: float) -> Path:
    """Write the page as SVG.

    Raises:
        UntrackableError: as `draw_sheet`.
        OutputError: another ending than .svg, or the file cannot be written.
    """
    if path.suffix.lower() != ".svg":
        raise OutputError("markers are written as SVG", where=path, advice="give a name that ends in .svg")
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


def _marker(known: cv2.aruco.Dictionary, placed: Placed, side: float, bits: int) -> str:
    image = known.generateImageMarker(placed.id, bits)
    bit = side / bits
    white = "".join(
        f'<rect x="{placed.left + column * bit:.4f}" y="{placed.top + row * bit:.4f}" width="{bit:.4f}" '
        f'height="{bit:.4f}"/>'
        for row in range(bits)
        for column in range(bits)
        if image[row, column]
    )
    cut, corner = side + 2 * bit, 1.5 * bit
    return (
        f'<rect x="{placed.left - bit:.4f}" y="{placed.top - bit:.4f}" width="{cut:.4f}" height="{cut:.4f}" '
        'fill="#fff" stroke="#bbb" stroke-width="0.2" stroke-dasharray="2 2"/>'
        f'<rect x="{placed.left:.4f}" y="{placed.top:.4f}" width="{side:.4f}" height="{side:.4f}" fill="#000"/>'
        f'<g fill="#fff" shape-rendering="crispEdges">{white}</g>'
        f'<text x="{placed.left:.4f}" y="{placed.top + side + corner + 4:.4f}" font-family="sans-serif" '
        f'font-size="3.6">id {placed.id}, upright as printed</text>'
    )


def _bar(x: float, y: float, *, horizontal: bool) -> str:
    end = (x + SCALE_BAR, y) if horizontal else (x, y + SCALE_BAR)
    across = (0.0, 2.0) if horizontal else (2.0, 0.0)
    lines = [(x, y, *end)]
    lines += [(px - across[0], py - across[1], px + across[0], py + across[1]) for px, py in ((x, y), end)]
    return "".join(
        f'<line x1="{a:g}" y1="{b:g}" x2="{c:g}" y2="{d:g}" stroke="#000" stroke-width="0.25"/>' for a, b, c, d in lines
    )
