"""Open a sensor from its address."""

from __future__ import annotations

from pathlib import Path

from firmware_host.depth_sensor import DepthSensor
from firmware_host.errors import SensorUnavailableError
from formats.garment import Garment

ADVICE = "give FILE.oni, openni2:, synthetic:MOTION or live:FILE.oni"
PLAYED = "live:"
SYNTHETIC = "synthetic:"
CORD = "?cord="  # option of `live:`: a file whose content "silent" or "unplugged" simulates a fault

LIVE = ("openni2:", "openni2")


def names_live_sensor(uri: str) -> bool:
    """Return whether an address names a connected device."""
    return uri in LIVE or uri.startswith(PLAYED)


def garment_in_view(uri: str) -> Garment | None:
    """Return the garment that a synthetic world swings; None for any other sensor, which knows of none.

    Raises:
        SensorAddressError: the synthetic world has no such garment.
    """
    if not uri.startswith(SYNTHETIC):
        return None
    from firmware_host.synthetic.sensor import garment_of

    return garment_of(uri)


def open_sensor(uri: str, *, anyway: bool = False) -> DepthSensor:
    """Open a sensor by its address; anyway: accept a recording's stamps at any rate.

    An address is a path to an .oni file, openni2: for the connected device, or synthetic:MOTION?effect=NAME&seconds=8.
    The prefix live: before a path plays the recording as a live sensor, in an endless loop.

    Raises:
        SensorUnavailableError: no such sensor; RecordingError: no such recording.
    """
    if uri.startswith(SYNTHETIC):
        from firmware_host.synthetic.sensor import SyntheticSensor

        return SyntheticSensor.from_uri(uri)
    from firmware_host.openni2_sensor import OpenNI2Sensor

    if uri.startswith(PLAYED):
        from firmware_host.paced import PacedSensor

        recording, _, cord = uri.removeprefix(PLAYED).partition(CORD)
        # In this process: a separate player process would take half a second to start each round.
        return PacedSensor(lambda: OpenNI2Sensor(Path(recording)), uri, Path(cord) if cord else None)
    if names_live_sensor(uri):
        return OpenNI2Sensor()
    if "://" in uri:
        raise SensorUnavailableError("no sensor has such an address", where=uri, advice=ADVICE)
    from firmware_host.recorded_sensor import RecordedSensor

    return RecordedSensor(Path(uri), anyway=anyway)
