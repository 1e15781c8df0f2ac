"""The installer installs the appliance's files, keeps the owner's files, and removes only its own."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
INSTALLER = ROOT / "scripts/install-appliance"

needs_root = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("systemd-sysusers") is None, reason="only root on a system with systemd installs"
)


def ran(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the installer."""
    return subprocess.run([INSTALLER, *arguments], capture_output=True, text=True, check=False)


def installed_into(system: Path) -> str:
    """Install all files into a folder; return the output."""
    done = ran("--files-only", "--root", system)
    assert done.returncode == 0, done.stderr
    return done.stdout


def contents(system: Path) -> dict[str, tuple[int, str]]:
    """Mode and content, or target, of every file and link below a folder."""
    found = {}
    for path in sorted(system.rglob("*")):
        if path.is_symlink():
            found[str(path.relative_to(system))] = (0, str(path.readlink()))
        elif path.is_file():
            found[str(path.relative_to(system))] = (path.stat().st_mode & 0o7777, path.read_text())
    return found


@needs_root
def test_every_unit_and_rule_of_the_folder_is_installed_and_units_follow_the_current_environment(
    tmp_path: Path,
) -> None:
    installed_into(tmp_path)
    for path in (ROOT / "systemd/system").iterdir():
        link = tmp_path / "etc/systemd/system" / path.name
        assert str(link.readlink()) == f"/opt/hangtime/current/units/{path.name}"
    for path in (ROOT / "systemd/udev").iterdir():
        assert (tmp_path / "etc/udev/rules.d" / path.name).read_text() == path.read_text()
    for kind in ("sysusers", "tmpfiles", "modules-load"):
        installed = tmp_path / f"etc/{kind}.d/hangtime.conf"
        assert installed.read_text() == (ROOT / f"systemd/{kind}.d/hangtime.conf").read_text()
    assert os.access(tmp_path / "opt/hangtime/judge-upgrade", os.X_OK)


@needs_root
def test_a_second_installation_changes_0_files_and_no_setting_of_the_owner(tmp_path: Path) -> None:
    installed_into(tmp_path)
    (tmp_path / "etc/hangtime/appliance.toml").write_text("mine")
    first = contents(tmp_path)
    installed_into(tmp_path)
    assert contents(tmp_path) == first
    assert first["etc/hangtime/appliance.toml"][1] == "mine"
    assert len(first) >= 12


@needs_root
def test_after_uninstalling_only_settings_takes_and_accounts_are_left_and_twice_is_once(tmp_path: Path) -> None:
    installed_into(tmp_path)
    (tmp_path / "var/lib/hangtime/takes/take-000001.mcap").write_text("a take")
    for _ in range(2):
        done = ran("--uninstall", "--root", tmp_path)
        assert done.returncode == 0, done.stderr
        left = {
            name for name in contents(tmp_path) if not re.match(r"etc/(passwd|group|shadow|gshadow|\.pwd\.lock)", name)
        }
        settings = {"etc/hangtime/appliance.toml", "etc/hangtime/appliance.toml.example"}
        assert left == settings | {"var/lib/hangtime/takes/take-000001.mcap"}
    assert "Kept: /etc/hangtime" in done.stdout


@needs_root
def test_uninstalling_leaves_a_command_hangtime_that_is_not_the_installers(tmp_path: Path) -> None:
    installed_into(tmp_path)
    command = tmp_path / "usr/local/bin/hangtime"
    command.unlink()
    command.symlink_to("/srv/mine/hangtime")
    ran("--uninstall", "--root", tmp_path)
    assert str(command.readlink()) == "/srv/mine/hangtime"


@needs_root
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--wait", "soon"], "whole number of minutes"),
        (["--root", "/nowhere/at/all"], "no folder /nowhere/at/all"),
        (["--wheels"], "--wheels needs a value"),
        (["--purge"], "no such option: --purge"),
        (["--uninstall", "--wait", "3", "--root", "EMPTY"], "--wait changes nothing with --uninstall, which ends a"),
        (["--python", "x", "--uninstall", "--root", "EMPTY"], "--python changes nothing with --uninstall, which onl"),
        (["--files-only", "--uninstall", "--root", "EMPTY"], "--files-only changes nothing with --uninstall, whi"),
        (["--files-only", "--wheels", "EMPTY", "--root", "EMPTY"], "--wheels changes nothing with --files-only"),
        (["--anyway", "--root", "EMPTY"], "--anyway changes nothing with --root, which starts nothing; leave one of"),
        (["--python", "python9", "--root", "EMPTY"], "--python python9: this is no Python 3.11, 3.12 or 3.13 that can"),
        (["--python", "/bin/true", "--root", "EMPTY"], "--python /bin/true: this is no Python 3.11, 3.12 or 3.13 that"),
    ],
)
def test_a_wrong_option_ends_it_with_1_and_one_sentence_before_anything_is_changed(
    arguments: list[str], said: str, tmp_path: Path
) -> None:
    done = ran(*(str(tmp_path) if one == "EMPTY" else one for one in arguments))
    assert list(tmp_path.iterdir()) == []
    assert (done.returncode, done.stdout) == (1, "")
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


@needs_root
def test_a_machine_of_32_bits_is_refused_with_what_to_use_instead(tmp_path: Path) -> None:
    (tmp_path / "uname").write_text("#!/bin/sh\necho armv7l\n")
    (tmp_path / "uname").chmod(0o755)
    done = subprocess.run(
        [INSTALLER, "--files-only", "--root", tmp_path], capture_output=True, text=True, check=False,
        env=os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert done.returncode == 1
    assert "Raspberry Pi OS of 64 bits" in done.stderr
    assert not (tmp_path / "etc").exists()


def test_scripts_of_an_upgrade_are_plain_shell_too() -> None:
    judge = ROOT / "systemd/hangtime-judge-upgrade"
    assert os.access(judge, os.X_OK)
    subprocess.run(["sh", "-n", judge], check=True)
    if shutil.which("shellcheck"):
        subprocess.run(["shellcheck", judge], check=True)


@pytest.mark.slow
@pytest.mark.processor_time(3600)
def test_the_appliance_passes_every_check_in_a_container_with_a_real_systemd() -> None:
    if os.geteuid() != 0 or not shutil.which("systemd-nspawn") or not shutil.which("debootstrap"):
        pytest.skip("takes root, systemd-nspawn (systemd-container) and debootstrap")
    done = subprocess.run([ROOT / "scripts/test-appliance-container"], capture_output=True, text=True, check=False)
    assert re.search(r"^20 passed, 0 failed$", done.stdout, re.MULTILINE), done.stdout + done.stderr
