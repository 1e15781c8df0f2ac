"""Provenance of a report: program version, command, garment, sensor and takes."""

from __future__ import annotations

import sys
from importlib.metadata import version

import msgspec
import numpy as np

from fit.provenance import physics_version
from fit.recordings.ready import Ready
from formats.garment import Garment
from formats.plain_text import as_typed
from formats.rig import Rig
from formats.take import Take


class Origin(msgspec.Struct, frozen=True, kw_only=True):
    """Provenance of a report.

    - `facts`: names with their values, as the page lists them
    - `takes`: take, its part, and the sha256 of its content
    """

    facts: list[tuple[str, str]] = []
    takes: list[tuple[str, str, str]] = []


def command_line() -> str:
    """Return the running command as a shell command line.

    A byte of a file name that is not UTF-8 appears as its code, as in \\xff: the page and its motion are UTF-8.
    """
    return as_typed(["hangtime", *sys.argv[1:]])


def origin_of(takes: Ready, first: Take | None = None, command: str = "") -> Origin:
    """Return the provenance of a result of these takes.

    first: the take whose garment and sensor are described
    """
    facts = [("Hangtime", version("hangtime")), ("simulation and libraries", f"sha256 {physics_version()}")]
    if command:
        facts.insert(1, ("command", command))
    if first is not None:
        facts += [("garment", _garment(first.garment)), ("mass", f"{1e3 * first.garment.mass_kg:g} g")]
        facts.append(("sensor", _sensor(first.rig, first.source)))
        facts.append(("calibration", _calibration(first.rig)))
    fitted_to = zip(takes.training, takes.contents, strict=True)
    held_out = zip(takes.held_out, takes.held_out_contents, strict=True)
    rows = [(recording.take_id, "fitted to", content) for recording, content in fitted_to]
    rows += [(recording.take_id, "held out", content) for recording, content in held_out]
    return Origin(facts=facts, takes=rows)


def _garment(garment: Garment) -> str:
    wide, high = np.ptp(np.array(garment.outline_m), axis=0)
    layers = f", {garment.layers} layers" if garment.layers > 1 else ""
    sewn = ", front and back sewn" if garment.seams else ""
    return (
        f"{garment.name}: {garment.kind}, {1e3 * wide:.0f} × {1e3 * high:.0f} mm{layers}{sewn}, held by its "
        f"{'top edge' if garment.held == 'edge' else 'two top corners'}, {len(garment.points)} tracked points "
        f"({garment.point_kind})"
    )


def _sensor(rig: Rig, source: str) -> str:
    if rig.sensor is None:
        return f"none: imported points{f' ({source})' if source else ''}"
    named = f"{source}, " if source else ""
    return f"{named}{rig.sensor.width} × {rig.sensor.height} pixels, focal length {rig.sensor.fx:.0f} pixels"


def _calibration(rig: Rig) -> str:
    found = rig.calibration
    if found is None:
        return "none" if rig.sensor is not None else "as the imported file states"
    scale = "not measured" if found.depth_scale_sd is None else f"± {100 * found.depth_scale_sd:.2g} %"
    gravity = f"from the {found.gravity_from}" if found.gravity_from else "as the rig's file states"
    return f"gravity {gravity}; depth scale {found.depth_scale:.4f} ({scale})"
