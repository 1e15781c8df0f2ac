"""Helpers for tests of the real daemon: OpenNI2, a take by the button, a small disk."""

from __future__ import annotations

import subprocess
from contextlib import contextmanager

import pytest

from tests import openni2

FPS = 15  # of the recording in place of the sensor

needs_openni = [
    pytest.mark.openni, pytest.mark.skipif(not openni2.is_available(), reason="libopenni2 is not here"),
]  # fmt: skip


def recorded(appliance, seconds=1.5):
    """Record for so long by the button; return the status afterwards."""
    appliance.wait_until(lambda told: told["state"] == "armed" and told["pre_roll_s"] >= 1.9, "armed with a pre-roll")
    before = appliance.ask("status")["takes"]
    appliance.press()
    appliance.wait_until(
        lambda told: told["recording"] and told["recording"]["seconds"] >= 2.0 + seconds, f"recording {seconds} s"
    )
    appliance.press()
    return appliance.wait_until(lambda told: told["takes"] > before, "kept")


@contextmanager
def small_disk(folder, size):
    folder.mkdir()
    made = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], capture_output=True)
    if made.returncode:
        pytest.skip("this user may not mount")
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)
