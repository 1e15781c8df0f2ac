"""The undervoltage flag of a Raspberry Pi's kernel."""

from __future__ import annotations

from firmware_host.power import BLAMED, PowerSupply


def test_a_raspberry_pis_flag_is_found_among_others_and_blamed_for_a_minute(tmp_path):
    for number, name in enumerate(("cpu_thermal", "rpi_volt")):
        folder = tmp_path / f"hwmon{number}"
        folder.mkdir()
        (folder / "name").write_text(f"{name}\n")
        (folder / "in0_lcrit_alarm").write_text("0\n")
    (tmp_path / "hwmon0/in0_lcrit_alarm").write_text("1\n")  # another device's
    power = PowerSupply(hwmon=tmp_path)
    assert power.is_watched
    assert not power.was_low(1.0)
    (tmp_path / "hwmon1/in0_lcrit_alarm").write_text("1\n")
    assert power.was_low(2.0)
    (tmp_path / "hwmon1/in0_lcrit_alarm").write_text("0\n")
    assert power.was_low(2.0 + BLAMED - 0.1)
    assert not power.was_low(2.0 + BLAMED)


def test_a_board_without_the_flag_is_never_blamed(tmp_path):
    assert not PowerSupply(hwmon=tmp_path / "none").is_watched
    assert not PowerSupply(hwmon=tmp_path).was_low(1.0)
    assert not PowerSupply(tmp_path / "gone").was_low(1.0)
