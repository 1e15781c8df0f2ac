"""Check whether tests can use OpenNI2 on this machine."""

from __future__ import annotations

from firmware_host import openni2_library
from firmware_host.errors import SensorUnavailableError


def is_available() -> bool:
    """Return whether OpenNI2 can be used here."""
    try:
        openni2_library.load()
    except SensorUnavailableError:
        return False
    return True
