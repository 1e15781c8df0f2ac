"""The summary of a calibration: the measured values, their uncertainty, and warnings."""

from __future__ import annotations

import numpy as np

from capture.calibration.session import Measured
from formats.rig import Rig

DOUBTFUL_DEVIATIONS = 3.0  # standard deviations from the expected value: a probability of 1 in 370
GRAVITY_TURNED = 5.0  # degrees between the rig's gravity and the measured one that cause a warning


def lines(measured: Measured, before: Rig) -> list[str]:
    """Return the findings as lines of name and value; `before` is the rig as it was."""
    said = [("still", f"{measured.frames} of {measured.seen} frames")]
    said += [
        ("gravity", _gravity(measured, before)),
        ("depth scale", _scale(measured)),
        ("depth offset", _offset(measured)),
        ("held ends", _held(measured)),
    ]
    return [f"{name:<14}{text}" for name, text in said]


def _gravity(measured: Measured, before: Rig) -> str:
    if measured.gravity is None:
        return "not measured: no plumb line with both its markers in view, and no accelerometer; kept as it was"
    cosine = float(np.clip(np.asarray(before.gravity) @ measured.gravity.value, -1.0, 1.0))
    turned = float(np.degrees(np.arccos(cosine)))
    calibration = measured.rig.calibration
    source = calibration.gravity_from if calibration else ""
    text = f"{_numbers(measured.gravity.value, '.4f')} +- {np.degrees(float(measured.gravity.sd)):.2f} degrees, from "
    text += f"the {source}; {turned:.1f} degrees from what the rig said"
    if turned > GRAVITY_TURNED:
        text += ": is the plumb line's first marker the upper one?" if turned > 90.0 else ", is the sensor that tilted?"
    return text


def _scale(measured: Measured) -> str:
    scale, hanger = measured.scale, measured.rig.hanger
    if scale is None or hanger is None:
        return "not measured: the hanger's two markers were not seen together; kept as it was"
    said = f"{1e3 * measured.distance_m:.1f} mm between the markers, the rig says {1e3 * hanger.marker_distance_m:.1f}"
    text = f"{float(scale.value):.4f} +- {float(scale.sd):.4f}: {said}"
    if abs(float(scale.value) - 1.0) > DOUBTFUL_DEVIATIONS * float(scale.sd):
        text += "; measure that distance again: if it is right, depth or focal length is off and recording corrects it"
    return text


def _offset(measured: Measured) -> str:
    offset = measured.offset
    if offset is None or not np.isfinite(offset.value).any():
        return "not measured: no plate with free edges on all four sides in depth; kept as it was"
    text = (
        f"{_numbers(offset.value, '.2f')} px +- {_numbers(offset.sd, '.2f')} px, right and down, depth against colour"
    )
    for name, value in zip(("right", "down"), offset.value, strict=True):
        if not np.isfinite(value):
            text += f"; {name} was not measured, since no plate ends on both sides along it, and is kept as it was"
    if (np.abs(offset.value) > DOUBTFUL_DEVIATIONS * offset.sd).any():
        text += "; recording allows for it"
    return text


def _held(measured: Measured) -> str:
    if measured.held is None:
        return "not measured: no marker in each clip; kept as they were"
    ends = " and ".join(_numbers(1e3 * end, ".1f") for end in measured.held.value)
    return f"{ends} mm, +- {1e3 * float(measured.held.sd.max()):.1f} mm"


def _numbers(values: object, form: str) -> str:
    return "[" + ", ".join(f"{value:{form}}" for value in np.asarray(values)) + "]"
