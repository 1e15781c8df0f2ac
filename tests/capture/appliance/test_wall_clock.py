"""The wall-clock time of a take: its source, and that clock steps change no duration."""

from __future__ import annotations

import time

import numpy as np
import pytest

from capture.appliance import wall_clock
from capture.appliance.running_take import TakeInProgress
from capture.appliance.wall_clock import wall_time
from capture.recording.condition import Condition
from capture.recording.frame_reader import Seen
from formats.blocks import Frame


@pytest.fixture
def undisciplined(monkeypatch, tmp_path):
    """Simulate a kernel with an undisciplined clock, on a board without systemd-timesyncd."""
    monkeypatch.setattr(wall_clock, "_kernel_error_s", lambda: None)
    monkeypatch.setattr(wall_clock, "TIMESYNCD", tmp_path / "synchronized")


def test_a_board_without_network_and_battery_says_that_nobody_set_its_clock(undisciplined, tmp_path):
    assert wall_time(2.0, clock=lambda: 10.0, rtcs=tmp_path / "rtc") == wall_clock.WallTime(
        utc="1970-01-01T00:00:08.000+00:00", source="none", uncertainty_s=None
    )
    assert wall_time(2.0, clock=lambda: 1.0, rtcs=tmp_path).utc.startswith("1970-01-01T00:00:00")  # none before 1970


def test_the_sources_are_distinguished(undisciplined, tmp_path, monkeypatch):
    (tmp_path / "rtc0").mkdir()
    (tmp_path / "rtc0/hctosys").write_text("1\n")
    assert wall_time(rtcs=tmp_path).source == "RTC"
    (tmp_path / "rtc0/hctosys").write_text("0\n")
    assert wall_time(rtcs=tmp_path).source == "none"
    (tmp_path / "synchronized").touch()
    assert wall_time(rtcs=tmp_path).source == "NTP"
    monkeypatch.setattr(wall_clock, "_kernel_error_s", lambda: 0.012)
    assert (wall_time().source, wall_time().uncertainty_s) == ("NTP", 0.012)


def test_the_kernel_says_how_far_its_clock_may_be_off_or_nothing():
    error = wall_clock._kernel_error_s()
    assert error is None or 0.0 <= error < 100.0


def seen(time_s):
    nothing = np.full((2, 3), np.nan)
    frame = Frame(
        time=time_s, markers=nothing, held=nothing, held_valid=np.zeros(2, bool), held_sd=nothing,
        points=np.full((1, 3), np.nan), points_valid=np.zeros(1, bool), points_sd=np.full((1, 3), np.nan),
    )  # fmt: skip
    return Seen(time=time_s, frame=frame, scan=None, condition=Condition.GOOD, has_hanger=True, dropped=0)


@pytest.mark.parametrize("leap", [-3600.0 * 24 * 365 * 50, -7200.0, 7200.0])
def test_a_wall_clock_that_jumps_in_mid_take_changes_no_duration(monkeypatch, leap):
    """Two seconds before the press and four after it, while the clock steps by hours or back to 1970."""
    real = time.time
    take = TakeInProgress(None, [seen(t) for t in np.arange(0.0, 2.01, 0.1)], 1, by="button", now=50.0)
    monkeypatch.setattr(time, "time", lambda: max(real() + leap, 0.0))
    for t in np.arange(2.1, 6.01, 0.1):
        take.count(seen(t))
    facts = take.facts("button")
    assert facts["seconds"] == pytest.approx(6.0)
    assert facts["pre_roll_s"] == pytest.approx(2.0)
    assert take.seconds_since_press == pytest.approx(4.0)


@pytest.mark.parametrize(("answer", "status", "error"), [(0, 0x2001, 0.012), (5, 0x2041, None), (-1, 0x2001, None)])
def test_the_kernels_bound_on_its_error_is_in_microseconds_and_counts_while_the_clock_is_disciplined(
    monkeypatch, answer, status, error
):
    """`man 2 adjtimex`: maxerror of 12000 us; STA_UNSYNC is 0x40 of status; -1 is a refusal."""

    class Kernel:
        def adjtimex(self, timex):
            timex[24:32] = (12_000).to_bytes(8, "little")
            timex[40:44] = status.to_bytes(4, "little")
            return answer

    monkeypatch.setattr(wall_clock.ctypes, "CDLL", lambda *_, **__: Kernel())
    assert wall_clock._kernel_error_s() == (error if error is None else pytest.approx(error))
