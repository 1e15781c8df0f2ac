"""The demos skip steps whose inputs are unchanged, end with what they found, and are part of every night."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_host.synthetic.motion import hanger_pose
from fit.batch.garments import STRONGER
from tests.conftest import STILL
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
    (rest,) = map(float, re.findall(r"--rest (\S+)", script))
    assert re.findall(r"^take (\d+)$", script, re.MULTILINE) == ["10"] * 3  # and 2 s before the press
    reaches = {}
    for name, motion, length, seed in recordings:
        seconds = float(length)
        time = np.arange(0.0, seconds, 1 / 30)
        moved = hanger_pose(motion, time, int(seed), seconds, rest).displacement
        shown = [moved[(time >= begin) & (time <= begin + 12.0)] for begin in np.arange(0.0, 5.0, 0.25)]
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


STAND_IN = r"""#!/bin/sh
# Answers as `hangtime` does, without a sensor and without a night of fits.
case "$1 $2" in
    "sensor synthesise") mkdir -p "$3" && touch "$3/$5.oni" "$3/rig.toml" "$3/garment.toml" ;;
    daemon*) exec 3<>demo/appliance/button && exec /bin/sleep 60 ;;
    "status --json") echo '  "state": "armed",' ;;
    batch*)
        mkdir -p demo/appliance/results/diagnoses && cd demo/appliance/results && echo "the page" >morning.txt
        [ -z "$VERDICT" ] || printf '{\n  "verdict": "%s",\n  "x": 1\n}\n' "$VERDICT" >diagnoses/k.json
        exit "$ENDED" ;;
esac
"""


@pytest.mark.parametrize(
    ("verdict", "ended", "status", "said"),
    [
        ("effect", 0, 0, "the night named what the simulation lacks (verdict: effect)"),
        ("inconclusive", 0, 0, "the night said what it could not tell, and why (verdict: inconclusive)"),
        ("none", 0, 1, "the night found no gap, though drag of air is in the recordings"),
        ("", 0, 1, "the night diagnosed nothing; the page says why"),
        ("effect", 3, 1, "the night left something undone; the page names it"),
        ("", 75, 75, "the night: every take is fitted"),
    ],
)
def test_the_appliances_demo_ends_with_0_only_after_a_night_with_a_verdict(
    tmp_path: Path, verdict: str, ended: int, status: int, said: str
) -> None:
    """The real script, before a stand-in for `hangtime` and a `sleep` that is over at once."""
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts/demo-appliance", tmp_path / "scripts")
    for name, text in {"hangtime": STAND_IN, "sleep": "#!/bin/sh\nexec /bin/sleep 0.01\n"}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    done = subprocess.run(
        [tmp_path / "scripts/demo-appliance"], capture_output=True, text=True, check=False, timeout=STILL,
        env=os.environ | {
            "PATH": f"{tmp_path}:{os.environ['PATH']}", "HANGTIME_DEMO_COMMAND": str(tmp_path / "hangtime"),
            "VERDICT": verdict, "ENDED": str(ended),
        },
    )  # fmt: skip
    assert said in done.stdout + done.stderr
    assert done.returncode == status, done.stdout + done.stderr


def test_the_nightly_runs_both_demos_afresh_and_names_the_broken_one(tmp_path: Path) -> None:
    (tmp_path / "scripts").mkdir()
    shutil.copy(ROOT / "scripts/nightly", tmp_path / "scripts")
    for name in ("test", "fuzz", "mutants", "demo", "demo-appliance"):
        (tmp_path / "scripts" / name).write_text(f'#!/bin/sh\necho "{name} $*" >>calls\n')
        (tmp_path / "scripts" / name).chmod(0o755)
    whole = subprocess.run([tmp_path / "scripts/nightly"], capture_output=True, text=True, check=False)
    assert whole.returncode == 0, whole.stderr
    calls = (tmp_path / "calls").read_text().splitlines()
    assert calls.count("demo --fresh") == calls.count("demo-appliance --fresh") == 1
    (tmp_path / "scripts/demo-appliance").write_text("#!/bin/sh\nexit 1\n")
    broken = subprocess.run([tmp_path / "scripts/nightly"], capture_output=True, text=True, check=False)
    assert broken.returncode == 1
    assert "nightly: failed: scripts/demo-appliance --fresh" in broken.stderr
