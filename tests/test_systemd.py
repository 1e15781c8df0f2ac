"""The units' users, folders and restrictions, as systemd's own tools check them."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from capture.appliance import config, config_tables

ROOT = Path(__file__).parent.parent
SYSTEM = ROOT / "systemd/system"
README = (ROOT / "systemd/README.md").read_text()

# `systemd-analyze security`: 0 for a service without permissions, 10 for one with all.
MOST_EXPOSED = {
    "system/hangtime-capture.service": 1.2,
    "system/hangtime-sync.service": 2.0,
    "system/hangtime-upgrade.service": 1.2,
    "user/hangtime-batch.service": 2.0,
}

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def settings(name: str) -> dict[str, list[str]]:
    """Every setting of a unit file, with each of its values."""
    found: dict[str, list[str]] = {}
    for line in (ROOT / "systemd" / name).read_text().splitlines():
        if match := re.match(r"([A-Z]\w+)=(.*)", line):
            found.setdefault(match[1], []).append(match[2])
    return found


def exposure(path: Path) -> float:
    """Return the exposure of a unit file by `systemd-analyze security`, 0 to 10."""
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=yes", path], capture_output=True, text=True, check=True
    )
    (level,) = re.findall(r"Overall exposure level for \S+: ([0-9.]+)", done.stdout)
    return float(level)


@needs_systemd
@pytest.mark.parametrize("name", MOST_EXPOSED)
def test_a_service_is_exposed_no_more_than_its_limit(name: str, tmp_path: Path) -> None:
    assert exposure(ROOT / "systemd" / name) <= MOST_EXPOSED[name]
    without = tmp_path / Path(name).name
    without.write_text((ROOT / "systemd" / name).read_text().replace("SystemCallFilter", "#"))
    assert exposure(without) > MOST_EXPOSED[name]


def test_no_service_has_no_limit() -> None:
    assert {str(path.relative_to(ROOT / "systemd")) for path in (ROOT / "systemd").rglob("*.service")} == set(
        MOST_EXPOSED
    )


def verified(folder: Path, *, also: str = "") -> subprocess.CompletedProcess[str]:
    """Return the output of `systemd-analyze verify` for units with existing programs; `also`: a line added to each."""
    for path in SYSTEM.iterdir():
        text = path.read_text().replace("/opt/hangtime/current/bin/python", sys.executable)
        text = text.replace("/opt/hangtime/judge-upgrade", str(ROOT / "systemd/hangtime-judge-upgrade"))
        (folder / path.name).write_text(text.replace("[Service]", f"[Service]\n{also}"))
    units = sorted(folder.iterdir())
    return subprocess.run(
        ["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", *units],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@needs_systemd
def test_systemd_finds_0_faults_in_the_4_units(tmp_path: Path) -> None:
    done = verified(tmp_path)
    assert "hangtime" not in done.stderr
    assert done.returncode == 0
    assert "'WatchdogSeconds' in section" in verified(tmp_path, also="WatchdogSeconds=3").stderr


@pytest.mark.parametrize("name", ["hangtime-capture.service", "hangtime-sync.service"])
def test_a_service_runs_a_module_that_is_there_from_the_environment_that_is_current(name: str) -> None:
    (command,) = settings(f"system/{name}")["ExecStart"]
    found = re.fullmatch(r"/opt/hangtime/current/bin/python -I -m (\S+)( run)?", command)
    assert found is not None
    assert find_spec(f"{found[1]}.__main__") is not None


def test_the_recorder_finds_its_3_paths_where_its_settings_look_for_them() -> None:
    unit = settings("system/hangtime-capture.service")
    assert config_tables.SpoolPart().folder.parent == Path("/var/lib") / unit["StateDirectory"][0]
    assert config_tables.ControlPart().socket.parent == Path("/run") / unit["RuntimeDirectory"][0]
    assert config.DEFAULT.parent == Path("/etc") / unit["ConfigurationDirectory"][0]
    assert (ROOT / "systemd/etc" / config.DEFAULT.name).is_file()


def test_the_settings_that_the_installer_brings_hold_but_for_the_2_files_that_are_the_owners(tmp_path: Path) -> None:
    shutil.copy(ROOT / "systemd/etc/appliance.toml", tmp_path)
    with pytest.raises(config.DescriptionError) as refused:
        config.load(tmp_path / "appliance.toml")
    assert str(tmp_path / "rig.toml") in str(refused.value)


def test_the_recorder_is_fed_to_a_watchdog_and_stops_only_after_its_take_is_on_the_disk() -> None:
    unit = settings("system/hangtime-capture.service")
    assert (unit["Type"], unit["NotifyAccess"]) == (["notify"], ["main"])
    assert 0 < int(unit["WatchdogSec"][0]) <= 10
    assert int(unit["TimeoutStopSec"][0]) > 20 + 5  # s: LONGEST_SHUTDOWN of the daemon and the disk's own five


def test_only_the_sync_of_the_3_services_may_open_a_network_socket() -> None:
    families = {
        name: set(settings(f"system/hangtime-{name}.service")["RestrictAddressFamilies"][0].split())
        for name in ("capture", "sync", "upgrade")
    }
    assert {name for name, may in families.items() if may & {"AF_INET", "AF_INET6"}} == {"sync"}
    assert settings("system/hangtime-sync.service")["SocketBindDeny"] == ["any"]


def test_every_account_and_group_of_a_unit_is_made_by_sysusers() -> None:
    text = (ROOT / "systemd/sysusers.d/hangtime.conf").read_text()
    users = set(re.findall(r"^u +(\S+)", text, re.MULTILINE))
    groups = users | set(re.findall(r"^g +(\S+)", text, re.MULTILINE))
    services = list(SYSTEM.glob("*.service"))
    assert len(services) == 3
    for path in services:
        unit = settings(f"system/{path.name}")
        assert set(unit.get("User", [])) <= users
        assert {
            name for key in ("Group", "SupplementaryGroups") for name in " ".join(unit.get(key, [])).split()
        } <= groups


@needs_systemd
def test_the_spool_that_tmpfiles_makes_belongs_to_the_recorder_and_is_shared_with_the_sync(tmp_path: Path) -> None:
    if shutil.which("systemd-sysusers") is None or subprocess.run(["id", "-u"], capture_output=True).stdout != b"0\n":
        pytest.skip("only root may make accounts, also those of a folder")
    for kind in ("sysusers", "tmpfiles"):
        (tmp_path / f"etc/{kind}.d").mkdir(parents=True)
        shutil.copy(ROOT / f"systemd/{kind}.d/hangtime.conf", tmp_path / f"etc/{kind}.d")
    subprocess.run(["systemd-sysusers", f"--root={tmp_path}"], check=True, capture_output=True)
    subprocess.run(["systemd-tmpfiles", f"--root={tmp_path}", "--create"], check=True, capture_output=True)
    accounts = dict(re.findall(r"^([\w-]+):x:\d+:(\d+)", (tmp_path / "etc/passwd").read_text(), re.MULTILINE))
    spool = (tmp_path / "var/lib/hangtime/takes").stat()
    assert oct(spool.st_mode & 0o7777) == "0o2770"
    assert str(spool.st_gid) == accounts["hangtime"] == accounts["hangtime-sync"]
    assert oct((tmp_path / "etc/hangtime/credentials").stat().st_mode & 0o777) == "0o700"


# --- the workstation's files ----------------------------------------------------------------------


def test_each_of_the_2_files_that_a_workstation_copies_is_there_and_goes_where_the_table_says() -> None:
    commands = "\n".join(re.findall(r"```sh\n(.*?)```", README, re.DOTALL))
    copied = re.findall(r"sudo cp systemd/(\S+) (/\S+)", commands)
    assert len(copied) == 2
    for file, folder in copied:
        assert (ROOT / "systemd" / file).is_file()
        assert f"| `{file}` | `{folder}` |" in README


def test_whom_the_rule_and_the_limits_are_for_is_whom_the_commands_make_a_member() -> None:
    (limited,) = re.findall(r"^@(\w+) ", (ROOT / "systemd/limits.d/55-hangtime.conf").read_text(), re.MULTILINE)
    rules = (ROOT / "systemd/udev/55-hangtime-depth-sensor.rules").read_text()
    assert set(re.findall(r'GROUP:="(\w+)"', rules)) == {limited}
    assert f'sudo usermod -aG {limited} "$USER"' in README
    assert limited in settings("system/hangtime-capture.service")["SupplementaryGroups"]
