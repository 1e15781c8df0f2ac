"""Name a sensor that hangs upside down as the cause of exchanged markers, where a picture shows it."""

from __future__ import annotations

from dataclasses import replace

from capture.hanger.seen_otherwise import is_upside_down
from firmware_host.depth_sensor import SensorFrame
from formats.findings import Finding
from formats.judgement import SWAPPED
from formats.rig import Rig


def of_the_sensor(findings: tuple[Finding, ...], shown: SensorFrame | None, rig: Rig) -> tuple[Finding, ...]:
    """Return a take's findings; that of exchanged markers names a sensor that hangs upside down, where `shown` does.

    shown: a frame of the take with both markers, None if none was kept
    """
    if shown is None or rig.hanger is None or all(one.name != SWAPPED for one in findings):
        return findings
    if not is_upside_down(shown.colour, rig.hanger):
        return findings
    words = "the first marker is on the right, and both stand on their heads: the sensor hangs upside down"
    advice = "turn the sensor over and record again"
    return tuple(replace(one, words=words, advice=advice) if one.name == SWAPPED else one for one in findings)
