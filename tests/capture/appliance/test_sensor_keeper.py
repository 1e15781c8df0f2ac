"""The sensor is unplugged and plugged in again, many times, through the real OpenNI2 library."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.capture.appliance.real_daemon import FPS, needs_openni
from tests.capture.appliance.virtual_appliance import ROOT, draw_recording

pytestmark = needs_openni

REPLUG = """
import sys
from pathlib import Path
from capture.appliance import sensor_keeper
from capture.appliance.wall_clock import monotonic
from firmware_host.opening import open_sensor
from tests.capture.appliance.virtual_appliance import RIG
recording, cord, times = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
sensor_keeper.RETRY = 0.02
keeper = sensor_keeper.SensorKeeper(lambda: open_sensor(f"live:{recording}?cord={cord}"), RIG, monotonic)
for _ in range(times):
    cord.write_text("")
    while keeper.next_frame(0.05) is None:
        pass
    assert keeper.error is None and keeper.info is not None
    cord.write_text("unplugged")
    while keeper.error is None:
        keeper.next_frame(0.05)
    assert "unplugged" in str(keeper.error) or "connected" in str(keeper.error)
keeper.close()
"""


def test_thirty_times_unplugged_and_plugged_in_again_crash_no_library(tmp_path):
    """With a thread for each opening, OpenNI2 2.2.0.33 ends the process within about twenty."""
    draw_recording(tmp_path / "s.oni", fps=FPS, seconds=1.0)
    done = subprocess.run(
        [sys.executable, "-c", REPLUG, str(tmp_path / "s.oni"), str(tmp_path / "cord"), "30"], cwd=ROOT, timeout=600,
        env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
