"""The real daemon under a wall clock that starts in 1970, jumps by hours and years, and runs backwards."""

from __future__ import annotations

import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from capture.appliance.spool import Spool
from formats.archive import read_take, verify_take
from tests.capture.appliance.real_daemon import needs_openni
from tests.capture.appliance.virtual_appliance import VirtualAppliance

pytestmark = [pytest.mark.slow, *needs_openni]
HOUR, DAY = 3600, 86_400  # s
LATE = 0.5  # s of a busy machine


@pytest.fixture
def shim(tmp_path):
    """Return a library that shifts the wall clock, the file with the shift, and the environment for both."""
    if shutil.which("gcc") is None:
        pytest.skip("no C compiler is here")
    library, offset = tmp_path / "wall_clock.so", tmp_path / "offset"
    source = Path(__file__).with_name("wall_clock_shim.c")
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl", "-lpthread"], check=True)
    offset.write_text("0")
    return offset, {"LD_PRELOAD": str(library), "CLOCK_OFFSET": str(offset)}


def test_a_wall_clock_of_1970_that_jumps_and_runs_backwards_changes_no_duration_and_loses_no_take(
    tmp_path, recording, shim
):
    offset, environment = shim
    in_1970 = 60 - int(time.time())
    leaps = [[in_1970, 0, -2 * HOUR], [3 * HOUR, -3 * HOUR], [20 * 365 * DAY, in_1970]]  # of take 1, 2 and 3, in s
    lasted = []
    with VirtualAppliance(tmp_path / "a", recording) as appliance:
        offset.write_text(str(in_1970))
        appliance.start(environment=environment)
        for number, steps in enumerate(leaps, start=1):
            offset.write_text(str(steps[0]))
            appliance.wait_until(lambda told: told["state"] == "armed" and told["pre_roll_s"] >= 1.9, "armed")
            begun = time.monotonic()
            appliance.ask("start")
            for step in steps[1:]:
                time.sleep(1.0)
                offset.write_text(str(step))
            time.sleep(1.0)
            if number < 3:
                appliance.ask("stop")
                lasted.append(time.monotonic() - begun)
                appliance.wait_until(lambda told, n=number: told["takes"] == n, "kept")
            else:
                lasted.append(time.monotonic() - begun)
                appliance.kill()
        appliance.start(environment=environment)  # in 1970 again: a power cut reset the clock
        told = appliance.wait_until(lambda told: told["takes"] == 3 and told["salvaged"] == 1, "salvaged")
        assert told["faults"] == []
    takes = Spool(appliance.spool).takes()
    assert [take.sequence for take in takes] == [1, 2, 3]
    years = [read_take(take.path).created[:4] for take in takes]
    assert years[0] == "1970"
    assert int(years[2]) > int(years[1]) + 18
    for take, seconds in zip(takes, lasted, strict=True):
        assert verify_take(take.path).is_sound
        times = read_take(take.path).time
        assert (np.diff(times) > 0).all()
        after_press = times[-1] - times[0] - 2.0
        lost = 2.0 if take.sequence == 3 else LATE  # s; the kill may cost two of the running take
        assert seconds - lost < after_press < seconds + LATE


def test_a_sensor_that_is_silent_while_the_clock_jumps_is_named_all_the_same(tmp_path, recording, shim):
    """Silence by the wall clock would be named at once or after five hours, and not after a second."""
    offset, environment = shim
    with VirtualAppliance(tmp_path / "a", recording) as appliance:
        appliance.start(environment=environment)
        appliance.wait_for("armed")
        appliance.cord.write_text("silent")
        offset.write_text(str(-5 * HOUR))
        appliance.wait_until(lambda told: told["faults"], "a fault")
        offset.write_text(str(5 * HOUR))
        appliance.cord.write_text("")
        appliance.wait_for("armed")
