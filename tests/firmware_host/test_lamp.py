"""The status lamp: an LED's folder of real files, as of the kernel, and an LED mocked by umockdev."""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

from capture.recording.condition import Condition
from capture.recording.condition_lamp import show_condition
from firmware_host.errors import LampError
from firmware_host.lamp import StatusLamp

LED = {
    "brightness": "0", "max_brightness": "255", "trigger": "none timer [mmc0] heartbeat", "delay_on": "0",
    "delay_off": "0",
}  # fmt: skip
MOCKED = """P: /devices/platform/leds/leds/status
E: SUBSYSTEM=leds
A: brightness=0\\n
A: max_brightness=255\\n
A: trigger=[none] timer heartbeat\\n
A: delay_on=0\\n
A: delay_off=0\\n
"""


@pytest.fixture
def leds(tmp_path):
    make_led(tmp_path / "leds", "status", LED)
    return tmp_path / "leds"


def make_led(leds, name, files):
    (leds / name).mkdir(parents=True)
    for file, value in files.items():
        (leds / name / file).write_text(value + "\n")


def said(leds, *names):
    return [(leds / "status" / name).read_text().strip() for name in names]


def test_a_lamp_is_lit_and_dark(leds):
    lamp = StatusLamp("status", leds)
    assert said(leds, "trigger", "brightness") == ["none", "0"]
    lamp.steady()
    assert said(leds, "trigger", "brightness") == ["none", "255"]
    lamp.dark()
    assert said(leds, "trigger", "brightness") == ["none", "0"]


@pytest.mark.parametrize(
    ("condition", "trigger", "half"),
    [(Condition.GOOD, "none", "0"), (Condition.NO_MARKERS, "timer", "500"), (Condition.NO_DEPTH, "timer", "125")],
)
def test_each_condition_has_its_rhythm(leds, condition, trigger, half):
    """Once a second is 500 ms of light and 500 ms of dark, four times 125 and 125."""
    show_condition(StatusLamp("status", leds), condition)
    assert said(leds, "trigger", "brightness", "delay_on") == [trigger, "255", half]
    assert said(leds, "delay_off") == [half]


def test_a_led_that_blinks_already_is_lit_blinks_and_is_dark_by_its_2_times_alone(tmp_path):
    """As the kernel's timer has it: no dark is steady light, no light is dark, both 0 is the kernel's own rhythm."""
    files = LED | {"trigger": "none [timer] mmc0", "delay_on": "500", "delay_off": "500"}
    make_led(tmp_path, "status", files)
    written = []

    class Watched(StatusLamp):
        def _write(self, name, value):
            super()._write(name, value)
            written.append((name, said(tmp_path, "delay_on", "delay_off")))

    with Watched("status", tmp_path) as lamp:
        assert said(tmp_path, "delay_on") == ["0"]
        for show, ends in [
            (lamp.steady, ["1000", "0"]),
            (lamp.dark, ["0", "1000"]),
            (lambda: lamp.blink(125, 250), ["125", "250"]),
            (lamp.steady, ["1000", "0"]),
            (lambda: lamp.blink(60, 940), ["60", "940"]),
        ]:
            show()
            assert said(tmp_path, "delay_on", "delay_off") == ends
    assert said(tmp_path, "trigger", "delay_on") == ["none [timer] mmc0", "0"]
    assert {name for name, _ in written} == {"delay_on", "delay_off"}
    assert ["0", "0"] not in [times for _, times in written]


def test_the_led_gets_its_trigger_back(leds):
    with StatusLamp("status", leds) as lamp:
        lamp.blink(500, 500)
    assert said(leds, "trigger", "brightness") == ["mmc0", "0"]


def test_a_led_that_was_lit_is_lit_again(leds):
    make_led(leds, "power", LED | {"trigger": "[none] timer", "brightness": "80"})
    StatusLamp("power", leds).close()
    assert (leds / "power/brightness").read_text() == "80"


@pytest.mark.parametrize("name", ["", "..", "other", "status/../status"])
def test_a_led_that_is_not_there_is_an_error_that_names_those_that_are(leds, name):
    with pytest.raises(LampError, match=r"there is no LED .*choose one of status"):
        StatusLamp(name, leds)


def test_a_kernel_without_the_timer_says_what_to_load(leds):
    make_led(leds, "plain", LED | {"trigger": "[none] heartbeat"})
    with pytest.raises(LampError, match="modprobe ledtrig-timer"):
        StatusLamp("plain", leds).blink(500, 500)


def test_a_led_that_goes_away_is_an_error_and_is_left_without_one(leds):
    with StatusLamp("status", leds) as lamp:
        shutil.rmtree(leds / "status")
        with pytest.raises(LampError, match="cannot be changed"):
            lamp.steady()


def test_a_led_of_the_led_class_is_found_in_sysfs(tmp_path):
    if shutil.which("umockdev-run") is None:
        pytest.skip("umockdev is not installed (scripts/setup --with-umockdev)")
    (tmp_path / "led.umockdev").write_text(MOCKED)
    program = """
from firmware_host.lamp import LEDS, StatusLamp
with StatusLamp("status") as lamp:
    lamp.blink(125, 125)
    names = "trigger", "brightness", "delay_on", "delay_off"
    print(*((LEDS / "status" / name).read_text().strip() for name in names))
print((LEDS / "status/brightness").read_text().strip())
"""
    words = ["umockdev-run", "-d", tmp_path / "led.umockdev", "--", sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.stdout.split("\n")[:2] == ["timer 255 125 125", "0"], done.stderr
