"""What systemd/README.md tells to do is what the files of the folder need."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
README = (ROOT / "systemd/README.md").read_text()
COMMANDS = "\n".join(re.findall(r"```sh\n(.*?)```", README, re.DOTALL))


def test_each_of_the_four_files_of_the_table_is_there_and_is_copied_to_where_the_table_says() -> None:
    table = re.findall(r"^\| `([^`]+)` \| `(/[^`]+)` \|", README, re.MULTILINE)
    assert len(table) == 4
    for file, folder in table:
        assert (ROOT / "systemd" / file).is_file()
        assert f"sudo cp systemd/{file} {folder}" in COMMANDS


def test_whom_the_rule_and_the_limits_are_for_is_whom_the_commands_make_a_member() -> None:
    (limited,) = re.findall(r"^@(\w+) ", (ROOT / "systemd/limits.d/55-hangtime.conf").read_text(), re.MULTILINE)
    rules = (ROOT / "systemd/udev/55-hangtime-depth-sensor.rules").read_text()
    assert set(re.findall(r'GROUP:="(\w+)"', rules)) == {limited}
    assert f'sudo usermod -aG {limited} "$USER"' in COMMANDS
    assert re.search(
        rf"^m +hangtime +{limited}$", (ROOT / "systemd/sysusers.d/hangtime.conf").read_text(), re.MULTILINE
    )


def test_the_account_of_an_appliance_runs_the_command_that_setup_makes_by_its_whole_path() -> None:
    (command,) = re.findall(r"systemd-run --uid=hangtime (?:[^\n]*\\\n)* *[^\n]*?(\S+) record", COMMANDS)
    assert command == "/opt/hangtime/.venv/bin/hangtime"
    assert "/opt/hangtime/scripts/setup" in README
    assert (ROOT / "scripts/setup").is_file()
