"""Presses among a button's changes: bounce, double presses and a stuck button."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_host import button
from firmware_host.button import DOWN, EVENT, KEY_EVENT, UP, Presses, open_contact
from firmware_host.errors import ButtonError

ROOT = Path(__file__).parents[2]


def counted(script):
    """Feed (time, changes) and return the presses of each."""
    presses = Presses()
    return [presses.take([bool(change) for change in changes], time) for time, changes in script]


def test_a_press_counts_when_the_button_goes_down():
    assert counted([(1.0, [1]), (1.1, [0])]) == [1, 0]


def test_a_contact_that_bounces_five_times_in_20_ms_is_one_press():
    assert counted([(1.000, [1, 0]), (1.010, [1, 0, 1]), (1.020, [0, 1]), (1.2, [0, 1, 0])]) == [1, 0, 0, 0]


def test_two_presses_within_one_frame_are_one():
    assert counted([(1.0, [1, 0, 1, 0]), (1.05, []), (1.1, [])]) == [1, 0, 0]


def test_a_second_press_counts_half_a_second_after_the_first_not_before():
    assert counted([(1.0, [1]), (1.1, [0]), (1.3, [1]), (1.4, [0]), (1.6, [1])]) == [1, 0, 0, 0, 1]


def test_a_release_that_came_while_contacts_bounced_is_seen_afterwards():
    """Down and up within 10 ms: the button is up again 30 ms later, and the next press counts."""
    assert counted([(1.0, [1, 0]), (1.04, []), (2.0, [1])]) == [1, 0, 1]


def test_a_button_down_for_ten_seconds_is_stuck_until_it_comes_up():
    presses = Presses()
    assert presses.take([True], 1.0) == 1
    presses.take([], 10.99)
    assert not presses.is_stuck
    presses.take([], 11.0)
    assert presses.is_stuck
    presses.take([False], 20.0)
    assert not presses.is_stuck
    assert presses.take([True], 21.0) == 1


def test_a_button_that_is_held_while_the_appliance_starts_is_no_press_but_may_be_stuck():
    presses = Presses(is_down=True)
    assert presses.take([], 5.0) == 0
    assert presses.take([], 15.0) == 0
    assert presses.is_stuck


def test_events_of_a_pipe_are_read_whole_even_where_they_are_written_in_pieces(tmp_path):
    os.mkfifo(tmp_path / "button")
    contact = open_contact(str(tmp_path / "button"))
    down, up = (EVENT.pack(9, 0, KEY_EVENT, 0x100, value) for value in (DOWN, UP))
    other = EVENT.pack(9, 0, 0, 0, 0)  # EV_SYN
    with (tmp_path / "button").open("wb", buffering=0) as writer:
        writer.write(down + other + up[:10])
        assert contact.changes() == [True]
        writer.write(up[10:])
        assert contact.changes() == [False]
    assert contact.changes() == []
    (tmp_path / "button").unlink()
    with pytest.raises(ButtonError, match="the button is gone"):
        contact.changes()
    contact.close()


def test_a_button_that_is_not_there_is_refused_with_those_that_are(tmp_path, monkeypatch):
    named = tmp_path / "event3/device"
    named.mkdir(parents=True)
    (named / "name").write_text("gpio-keys\n")
    monkeypatch.setattr(button, "INPUTS", tmp_path)
    monkeypatch.setattr(button, "DEVICES", tmp_path / "dev")
    with pytest.raises(ButtonError, match=r"no input device 'front'; choose one of gpio-keys; a path begins with /$"):
        open_contact("front")
    with pytest.raises(ButtonError, match=r"dev/event3: the button cannot be read \(no such file"):
        open_contact("gpio-keys")
    with pytest.raises(ButtonError, match="is no line of a GPIO chip; write gpio:"):
        open_contact("gpio:17")


def test_a_line_of_a_chip_that_is_not_there_is_refused():
    pytest.importorskip("gpiod")
    with pytest.raises(ButtonError, match="/dev/gpiochip99: the button cannot be read"):
        open_contact("gpio:/dev/gpiochip99:17")


GPIO_KEYS = r"""P: /devices/platform/button/input/input3
E: SUBSYSTEM=input
A: name=gpio-keys\n

P: /devices/platform/button/input/input3/event3
N: input/event3
E: DEVNAME=/dev/input/event3
E: SUBSYSTEM=input
E: MAJOR=13
E: MINOR=67
L: device=..
"""
EVENTS = "".join(
    f"E: {at:.6f} 0001 0100 {value:04}\nE: {at:.6f} 0000 0000 0000\n"
    for at, value in ((0.0, 1), (0.004, 0), (0.008, 1), (0.6, 0), (2.0, 1), (3.0, 0))
)
COUNT_PRESSES = """
import time
from firmware_host.button import Presses, open_contact
contact = open_contact("gpio-keys")
presses, changes, count, until = Presses(is_down=contact.is_down()), [], 0, time.monotonic() + 300
while len(changes) < 6 and time.monotonic() < until:
    new = contact.changes()
    changes += new
    count += presses.take(new, time.monotonic())
    time.sleep(0.005)
print(count, changes)
"""


@pytest.mark.skipif(shutil.which("umockdev-run") is None, reason="umockdev is not here")
def test_a_gpio_keys_device_of_the_kernel_is_found_by_its_name_and_read(tmp_path):
    """A mocked input device replays two presses two seconds apart, the first with a bounce of 8 ms."""
    (tmp_path / "device").write_text(GPIO_KEYS)
    (tmp_path / "events").write_text(EVENTS)
    mocked = ["umockdev-run", "-d", str(tmp_path / "device"), "-e", f"/dev/input/event3={tmp_path / 'events'}"]
    done = subprocess.run(
        [*mocked, "--", sys.executable, "-c", COUNT_PRESSES], capture_output=True, text=True, timeout=600,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "2 [True, False, True, False, True, False]\n"
