"""The real daemon on real file systems that are slow, fail or fill up: ext4 in a file, and a small tmpfs.

Needs root, a loop device and the kernel's limit on a device's rate (cgroup blkio); skipped where one is missing.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from capture.appliance.spool import Spool
from formats.archive import read_take, verify_take
from tests.capture.appliance.real_daemon import FPS, needs_openni, recorded, small_disk
from tests.capture.appliance.virtual_appliance import VirtualAppliance

pytestmark = [pytest.mark.slow, *needs_openni]
LIMIT = Path("/sys/fs/cgroup/blkio/blkio.throttle.write_bps_device")
SLOW = 50_000  # bytes a second


def run(*words):
    done = subprocess.run([*map(str, words)], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"{words[0]} does not work here: {done.stderr.strip()}")
    return done.stdout.strip()


@contextmanager
def ext4(folder, image, size):
    """Mount an ext4 of this size [bytes] in a file; yield the name of its device."""
    if os.geteuid() or shutil.which("mkfs.ext4", path="/usr/sbin:/sbin") is None:
        pytest.skip("only root can mount, and e2fsprogs must be there")
    with image.open("wb") as file:
        file.truncate(size)
    run("/usr/sbin/mkfs.ext4", "-q", "-F", "-E", "lazy_itable_init=0,lazy_journal_init=0", image)
    device = run("/usr/sbin/losetup", "-f", "--show", image)
    try:
        folder.mkdir()
        run("mount", device, folder)
        try:
            yield device
        finally:
            subprocess.run(["umount", "-l", folder], check=True)
    finally:
        subprocess.run(["/usr/sbin/losetup", "-d", device], check=True)


@contextmanager
def limited(device, rate):
    """Limit the rate at which the kernel writes to a device [bytes/s]."""
    if not LIMIT.exists():
        pytest.skip("the kernel has no limit on a device's rate at this place")
    number = Path(f"/sys/block/{Path(device).name}/dev").read_text().strip()
    LIMIT.write_text(f"{number} {rate}")
    try:
        yield
    finally:
        LIMIT.write_text(f"{number} 0")


def check_kept(appliance):
    """Check that every named take is completely readable; return the takes."""
    kept = Spool(appliance.spool).takes()
    assert all(verify_take(take.path).is_sound for take in kept)
    return kept


def test_a_disk_of_50_kilobytes_a_second_keeps_takes_whole_and_is_named_within_5_s_once_it_falls_behind(
    tmp_path, recording
):
    """A take needs some kilobytes a second. Another program then writes 3 MB to the same disk, which take a minute."""
    disk = tmp_path / "disk"
    with (
        ext4(disk, tmp_path / "image", 64 << 20) as device,
        limited(device, SLOW),
        VirtualAppliance(tmp_path / "a", recording, "least_free_mb = 20\n", spool=disk / "takes") as appliance,
    ):
        appliance.start()
        told = recorded(appliance, seconds=6.0)
        assert told["faults"] == []
        (whole,) = check_kept(appliance)
        assert whole.facts["ended_by"] == "button"
        assert len(read_take(whole.path).time) > 6.0 * FPS

        appliance.wait_until(lambda told: told["state"] == "armed" and told["pre_roll_s"] >= 1.9, "armed again")
        appliance.press()
        appliance.wait_until(lambda told: told["recording"] and told["recording"]["seconds"] > 3.0, "recording")
        other = threading.Thread(target=_write, args=(disk / "other", 3_000_000))
        other.start()
        told = appliance.wait_until(lambda told: told["faults"], "a fault", seconds=90)
        (fault,) = told["faults"]
        assert fault["name"] == "disk_slow"
        behind = float(re.search(r"has not finished writing for (\d\.\d) s", fault["sentence"])[1])
        assert behind <= 5.0
        assert told["state"] != "recording"
        other.join()
        appliance.wait_until(lambda told: told["takes"] == 2 and not told["faults"], "kept", seconds=120)
        late = check_kept(appliance)[1]
        assert "has not finished writing" in late.facts["ended_by"]
        assert len(read_take(late.path).time) > 3.0 * FPS


def _write(path, size):
    with path.open("wb") as file:
        for _ in range(size // 100_000):
            file.write(bytes(100_000))
            file.flush()
            os.fsync(file.fileno())


def test_a_card_that_fails_is_named_within_5_s_and_what_was_kept_is_readable_after_its_repair(tmp_path, recording):
    """The file of the card lies where no room is left, so that the kernel itself fails to write."""
    under, disk = tmp_path / "under", tmp_path / "disk"
    with small_disk(under, "60M"):
        with (
            ext4(disk, under / "image", 256 << 20),
            VirtualAppliance(tmp_path / "a", recording, "least_free_mb = 20\n", spool=disk / "takes") as appliance,
        ):
            appliance.start()
            recorded(appliance)
            appliance.wait_until(lambda told: told["state"] == "armed" and told["pre_roll_s"] >= 1.9, "armed again")
            appliance.press()
            appliance.wait_until(lambda told: told["recording"] and told["recording"]["seconds"] > 3.0, "recording")
            filler = under / "filler"
            with filler.open("wb") as file:
                try:
                    while file.write(bytes(1 << 20)):
                        file.flush()
                except OSError:
                    pass
            failed_at = time.monotonic()
            told = appliance.wait_until(lambda told: told["faults"], "a fault", seconds=60)
            took = time.monotonic() - failed_at
            assert told["faults"][0]["name"] == "disk"
            assert re.search("Input/output error|Read-only file system", told["faults"][0]["sentence"])
            assert "replace the card" in told["faults"][0]["advice"]
            assert took < 5.0
            assert appliance.ask("start")["what"].startswith("nothing can be recorded")
            check_kept(appliance)
            appliance.kill(signal.SIGKILL)
            filler.unlink()
        mended = tmp_path / "mended"
        mended.mkdir()
        subprocess.run(["/usr/sbin/e2fsck", "-f", "-y", str(under / "image")], capture_output=True)
        run("mount", "-o", "loop", under / "image", mended)
        try:
            with VirtualAppliance(tmp_path / "b", recording, "least_free_mb = 20\n", spool=mended / "takes") as again:
                again.start()
                again.wait_until(lambda told: told["takes"] == 2 and told["salvaged"] == 1, "salvaged")
                first, second = check_kept(again)
                assert (first.sequence, second.sequence) == (1, 2)
                assert len(read_take(second.path).time) > FPS
        finally:
            subprocess.run(["umount", "-l", str(mended)], check=True)
