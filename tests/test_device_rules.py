"""The sensors' udev rules give no device world access."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.repository import ROOT


def device_rules(path: Path) -> list[dict[str, str]]:
    """The rules of a udev file that name a product, each as key to value."""
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    pairs = [dict(re.findall(r'([A-Z]+(?:\{\w+\})?)(?:==|!=|\+=|:=|=)"([^"]*)"', line)) for line in lines]
    return [rule for rule in pairs if "ATTR{idProduct}" in rule]


def test_the_sensor_rules_win_over_debians_number_60_and_open_no_device_to_everybody() -> None:
    path = ROOT / "systemd/udev/55-hangtime-depth-sensor.rules"
    assert int(path.name.split("-")[0]) < 60
    for rule in device_rules(path):
        assert (rule["MODE"], rule["GROUP"], rule["TAG"]) == ("0660", "plugdev", "uaccess")
    assert path.read_text().count('MODE:="0660"') == len(device_rules(path)) >= 3


def test_the_sensor_rules_cover_every_device_that_debian_opens_to_everybody() -> None:
    debian = Path("/usr/lib/udev/rules.d/60-libopenni2-0.rules")
    if not debian.exists():
        debian = Path("/lib/udev/rules.d/60-libopenni2-0.rules")
    if not debian.exists():
        pytest.skip("libopenni2-0 is not installed")
    path = ROOT / "systemd/udev/55-hangtime-depth-sensor.rules"
    ours = {(r["ATTR{idVendor}"], p) for r in device_rules(path) for p in r["ATTR{idProduct}"].split("|")}
    theirs = {(r["ATTR{idVendor}"], r["ATTR{idProduct}"]) for r in device_rules(debian)}
    assert len(theirs) >= 10
    assert theirs <= ours
