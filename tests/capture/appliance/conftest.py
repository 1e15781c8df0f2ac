"""Fixtures of the daemon's tests: a recording in place of the sensor, and an appliance."""

from __future__ import annotations

import pytest

from tests.capture.appliance.real_daemon import FPS
from tests.capture.appliance.virtual_appliance import VirtualAppliance, draw_recording


@pytest.fixture(scope="session")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("sensor") / "swing.oni"
    draw_recording(path, fps=FPS, seconds=2.0)
    return path


@pytest.fixture
def appliance(tmp_path, recording):
    with VirtualAppliance(tmp_path, recording) as one:
        yield one
