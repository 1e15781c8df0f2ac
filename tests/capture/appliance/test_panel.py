"""The button and the lamps of the configuration: a named pipe, and folders of real files as the kernel's LEDs."""

from __future__ import annotations

import os

import pytest

from capture.appliance.config_tables import ButtonPart, Config, LampPart, SensorPart
from capture.appliance.faults import FaultBook
from capture.appliance.panel import REOPENING, Panel
from capture.appliance.showing import ARMED, FAULT_LIGHT, RECORDING, Lamps
from firmware_host.button import EVENT, KEY_EVENT, STUCK
from firmware_host.errors import LampError
from firmware_host.lamp import StatusLamp
from tests.capture.appliance.virtual_appliance import BTN_0
from tests.firmware_host.test_lamp import LED, make_led

DOWN, UP = 1, 0


@pytest.fixture
def leds(tmp_path):
    return tmp_path / "leds"


@pytest.fixture
def faults():
    return FaultBook()


@pytest.fixture
def panel(tmp_path, leds, faults):
    made = Panel(
        Config(
            sensor=SensorPart(rig=tmp_path, garment=tmp_path), button=ButtonPart(device=str(tmp_path / "button")),
            lamp=LampPart(led="green", fault_led="red", leds=leds),
        ), faults,
    )  # fmt: skip
    yield made
    made.close()


def lit(leds, name):
    trigger, brightness, on, off = (
        (leds / name / file).read_text().strip() for file in ("trigger", "brightness", "delay_on", "delay_off")
    )
    return f"{on}/{off}" if trigger == "timer" else brightness


def make_leds(leds):
    for name in ("green", "red"):
        make_led(leds, name, LED)


def change(tmp_path, *levels):
    with (tmp_path / "button").open("wb", buffering=0) as pipe:
        pipe.write(b"".join(EVENT.pack(0, 0, KEY_EVENT, BTN_0, level) for level in levels))


def test_without_a_button_or_a_lamp_there_is_no_press_and_no_fault(tmp_path, faults):
    panel = Panel(Config(sensor=SensorPart(rig=tmp_path, garment=tmp_path)), faults)
    panel.show(FAULT_LIGHT, 0.0)
    assert (panel.presses(0.0), faults.all) == (0, [])
    panel.close()


def test_a_missing_button_is_a_fault_and_is_opened_once_it_is_there(tmp_path, panel, faults):
    assert panel.presses(10.0) == 0
    assert [(fault.name, fault.since_s) for fault in faults.all] == [("button", 10.0)]
    os.mkfifo(tmp_path / "button")
    assert panel.presses(10.0 + 0.9 * REOPENING) == 0  # not yet tried again
    assert "button" in faults
    panel.presses(10.0 + REOPENING)
    assert faults.all == []
    change(tmp_path, DOWN, UP)
    assert panel.presses(13.0) == 1


def test_a_stuck_button_is_a_fault_until_it_is_free(tmp_path, panel, faults):
    os.mkfifo(tmp_path / "button")
    panel.presses(0.0)
    change(tmp_path, DOWN)
    assert panel.presses(1.0) == 1
    panel.presses(1.0 + STUCK - 0.1)
    assert faults.all == []
    panel.presses(1.0 + STUCK)
    assert [(fault.name, fault.since_s) for fault in faults.all] == [("button_stuck", 1.0 + STUCK)]
    assert f"{STUCK:g} s" in faults.all[0].sentence
    assert "hangtime start" in faults.all[0].advice
    change(tmp_path, UP)
    panel.presses(20.0)
    assert faults.all == []


def test_a_button_that_is_gone_is_let_go_and_said(tmp_path, panel, faults):
    os.mkfifo(tmp_path / "button")
    panel.presses(0.0)
    (tmp_path / "button").unlink()
    assert panel.presses(1.0) == 0
    assert "the button is gone" in faults.all[0].sentence
    os.mkfifo(tmp_path / "button")
    panel.presses(0.9 * REOPENING)
    assert "button" in faults
    panel.presses(REOPENING)
    assert faults.all == []


def test_a_fault_is_red_and_all_else_green_and_the_other_led_is_dark(leds, panel, faults):
    make_leds(leds)
    panel.show(RECORDING, 0.0)
    assert (lit(leds, "green"), lit(leds, "red")) == ("255", "0")
    panel.show(FAULT_LIGHT, 0.1)
    assert (lit(leds, "green"), lit(leds, "red")) == ("0", "125/125")
    panel.show(ARMED, 0.2)
    assert (lit(leds, "green"), lit(leds, "red")) == ("1500/500", "0")
    panel.close()
    assert [(leds / name / "trigger").read_text() for name in ("green", "red")] == ["mmc0", "mmc0"]
    assert faults.all == []


def test_one_led_shows_faults_too_and_an_unchanged_light_writes_nothing(leds):
    make_leds(leds)
    lamps = Lamps(StatusLamp("green", leds))
    lamps.show(FAULT_LIGHT)
    assert lit(leds, "green") == "125/125"
    (leds / "green/delay_on").write_text("7")
    lamps.show(FAULT_LIGHT)
    assert lit(leds, "green") == "7/125"
    lamps.close()


def test_a_missing_lamp_is_a_fault_until_it_is_there(leds, panel, faults):
    panel.show(RECORDING, 5.0)
    assert [(fault.name, fault.since_s) for fault in faults.all] == [("lamp", 5.0)]
    make_leds(leds)
    panel.show(RECORDING, 5.0 + 0.9 * REOPENING)
    assert "lamp" in faults
    panel.show(RECORDING, 5.0 + REOPENING)
    assert (faults.all, lit(leds, "green")) == ([], "255")


def test_a_lamp_that_is_removed_shows_nothing_more(leds):
    make_leds(leds)
    lamps = Lamps(StatusLamp("green", leds))
    (leds / "green").rename(leds / "gone")
    with pytest.raises(LampError, match="cannot be changed"):
        lamps.show(RECORDING)
    (leds / "gone").rename(leds / "green")
    lamps.show(ARMED)
    lamps.close()
    assert lit(leds, "green") == "0"
