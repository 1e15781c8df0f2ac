"""`scripts/demo` skips the steps whose inputs are unchanged, and repeats the others."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_host.synthetic.motion import hanger_pose
from fit.batch.garments import STRONGER
from tests.repository import PACKAGES, ROOT

HANGTIME = """#!/bin/sh
# Writes what each command would write.
echo "$*" >>calls
out() { while [ "$1" != --out ]; do shift; done; echo "$2"; }
case "$1 $2" in
    "sensor synthesise") mkdir -p "$3" && for f in "$5.oni" rig.toml garment.toml; do echo >"$3/$f"; done ;;
    record*) echo >"$(out "$@")" ;;
    fit*) [ ! -e broken ] || exit 2; echo >"$(out "$@")/fit.json"; echo >"$(out "$@")/report.html" ;;
    diagnose*) echo '{"sentence": "Air is missing."}' >"$(out "$@")/diagnosis.json"; echo >"$(out "$@")/report.html" ;;
esac
"""


@pytest.fixture
def demo(tmp_path: Path) -> Path:
    """A checkout whose `hangtime` only touches its outputs."""
    for folder in (*PACKAGES, "scripts", ".venv/bin"):
        (tmp_path / folder).mkdir(parents=True)
    shutil.copy(ROOT / "scripts/demo", tmp_path / "scripts")
    for name, text in {"scripts/setup": "#!/bin/sh\n", ".venv/bin/hangtime": HANGTIME}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    (tmp_path / ".venv/bin/python").symlink_to(sys.executable)
    return tmp_path


def run_demo(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([folder / "scripts/demo", *arguments], capture_output=True, text=True, check=False)


def test_the_second_demo_skips_all_4_steps_and_still_says_the_verdict(demo: Path) -> None:
    assert run_demo(demo).returncode == 0
    again = run_demo(demo)
    assert again.stdout.count("up to date, skipped") == 4
    assert "verdict: Air is missing." in again.stdout
    assert run_demo(demo, "--fresh").stdout.count("up to date, skipped") == 0


def test_changed_fitting_code_repeats_2_of_the_demos_4_steps(demo: Path) -> None:
    run_demo(demo)
    (demo / "fit/model.py").write_text("")
    assert run_demo(demo).stdout.count("up to date, skipped") == 2


def test_a_demo_step_that_failed_ends_the_demo_and_runs_again(demo: Path) -> None:
    (demo / "broken").touch()
    assert run_demo(demo).returncode == 2
    assert not (demo / "demo/diagnosis.json").exists()
    (demo / "broken").unlink()
    assert run_demo(demo).stdout.count("up to date, skipped") == 2


def test_the_demo_of_felt_has_a_folder_and_a_fabric_of_its_own(demo: Path) -> None:
    assert run_demo(demo, "--felt").returncode == 0
    assert (demo / "demo-felt/report.html").exists()
    assert not (demo / "demo").exists()
    made = [line for line in (demo / "calls").read_text().splitlines() if line.startswith("sensor synthesise")]
    assert len(made) == 3
    assert all("--fabric felt" in line for line in made)


def test_the_appliances_demo_shows_three_strengths_of_one_motion_wherever_its_takes_begin() -> None:
    """A busy machine starts a take up to 5 s later; the night then found two strengths and nothing to judge on."""
    script = (ROOT / "scripts/demo-appliance").read_text()
    recordings = re.findall(r"^synthesise (gentle|swing|mixed) (\w+) (\d+) (\d+)$", script, re.MULTILINE)
    reaches = {}
    for name, motion, length, seed in recordings:
        seconds = float(length)
        time = np.arange(0.0, seconds, 1 / 30)
        moved = hanger_pose(motion, time, int(seed), seconds).displacement
        shown = [moved[(time >= begin) & (time <= begin + 10.0)] for begin in np.arange(0.0, 5.0, 0.25)]
        reaches[name] = [math.hypot(*part.std(axis=0)) for part in shown]
    for weaker, stronger in (("gentle", "swing"), ("swing", "mixed")):
        assert min(reaches[stronger]) > STRONGER * max(reaches[weaker])


def test_each_take_of_the_appliances_demo_has_a_recording_of_its_own() -> None:
    """A sensor that shows a recording twice makes two takes with the same frames, which no diagnosis accepts."""
    script = (ROOT / "scripts/demo-appliance").read_text()
    made = re.findall(r"^synthesise (\w+) (\w+) \d+ (\d+)$", script, re.MULTILINE)
    shown = re.findall(r"^start_daemon (\w+)$", script, re.MULTILINE)
    assert sorted(name for name, _, _ in made) == sorted(shown)
    assert len({(motion, seed) for _, motion, seed in made}) == len(shown) == 4
