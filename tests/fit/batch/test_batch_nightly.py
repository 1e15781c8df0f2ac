"""The systemd timer, the Slurm recipe and the summary of a nightly batch."""

from __future__ import annotations

import csv
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from configparser import RawConfigParser
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fit.batch.cli import NEXT_TRY
from fit.batch.ending import ending_of
from fit.batch.summary import Row, as_csv, as_html, sentence_of
from fit.identification.request import Plan
from fit.search.least_squares import BoundedSpace
from fit.search.tempering import FEWEST_DRAWS, Tempering
from tests.fit.batch.night import HANGS, PROGRAMS, SHORT, make_takes
from tests.fit.report.report_scene import fit_result

ROOT = Path(__file__).parents[3]
UNITS = ROOT / "systemd/user"


# --- the timer ----------------------------------------------------------------------------------


@pytest.fixture
def home(tmp_path):
    """A user's folder with the units and the command where the texts say they go."""
    (tmp_path / ".local/bin").mkdir(parents=True)
    (tmp_path / ".local/bin/hangtime").symlink_to(PROGRAMS / "hangtime")
    (tmp_path / "run").mkdir()
    shutil.copytree(UNITS, tmp_path / ".config/systemd/user")
    return tmp_path


def verify(home, name):
    """What systemd says of a unit of this user."""
    if not shutil.which("systemd-analyze"):
        pytest.skip("systemd-analyze is not installed")
    done = subprocess.run(
        ["systemd-analyze", "verify", "--user", "--man=no", home / ".config/systemd/user" / name],
        env={"PATH": os.environ["PATH"], "HOME": str(home), "XDG_RUNTIME_DIR": str(home / "run")},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout + done.stderr


@pytest.mark.parametrize("name", ["hangtime-batch.service", "hangtime-batch.timer"])
def test_systemd_finds_nothing_wrong_with_the_units(home, name):
    assert verify(home, name) == ""


def test_systemd_would_have_found_a_misspelt_setting(home):
    path = home / ".config/systemd/user/hangtime-batch.service"
    path.write_text(path.read_text().replace("KillSignal=SIGINT", "KillSignal=SIGNIT"))
    assert "Failed to parse signal name" in verify(home, "hangtime-batch.service")


def test_the_service_runs_the_command_with_options_that_it_has(home):
    """An empty folder is as far as it gets without takes: exit code 2, which is not tried again."""
    unit = RawConfigParser(strict=False)
    unit.read(UNITS / "hangtime-batch.service")
    service = dict(unit["Service"])
    line = service["execstart"].replace("%h", str(home)).replace("${HANGTIME_TAKES}", "empty")
    line = line.replace("${HANGTIME_RESULTS}", "results").replace("$HANGTIME_OPTIONS", "--method si --workers 1")
    (home / "empty").mkdir()
    done = subprocess.run(shlex.split(line), cwd=home, capture_output=True, text=True, check=False)
    assert done.returncode == int(service["restartpreventexitstatus"]) == 2
    assert "holds no take" in done.stderr


def test_a_night_without_network_is_tried_until_the_morning_and_not_into_the_day():
    """It starts no more than `StartLimitBurst` times within `StartLimitIntervalSec` (`man 5 systemd.unit`)."""
    unit = RawConfigParser(strict=False)
    unit.read(UNITS / "hangtime-batch.service")
    minutes = int(unit["Unit"]["StartLimitBurst"]) * int(unit["Service"]["RestartSec"].removesuffix("min"))
    assert 6 * 60 < minutes < 9 * 60
    assert unit["Unit"]["StartLimitIntervalSec"] == "9h"


def test_a_second_try_at_five_in_the_morning_ends_at_seven_as_the_first_would_have():
    """Nine hours after the timer's 22:00; a second try of its own nine hours would end at 14:00."""
    unit, timer = RawConfigParser(strict=False), RawConfigParser(strict=False)
    unit.read(UNITS / "hangtime-batch.service")
    timer.read(UNITS / "hangtime-batch.timer")
    assert timer["Timer"]["OnCalendar"].endswith(" 22:00")
    hours, until = re.search(r"--hours (\d+) --until (\S+)", unit["Service"]["ExecStart"]).groups()
    for start, end in ((22, 31), (29, 31)):  # hours after midnight
        now = time.mktime((2026, 7, 3, start, 0, 0, 0, 0, -1))
        ending = ending_of(float(hours), until, running=lambda: 0.0, wall=lambda now=now: now)
        assert min(now + ending.hours_end, ending.day_end) == time.mktime((2026, 7, 3, end, 0, 0, 0, 0, -1))


def test_the_command_knows_when_the_service_tries_again():
    unit = RawConfigParser(strict=False)
    unit.read(UNITS / "hangtime-batch.service")
    assert unit["Service"]["RestartSec"] == f"{NEXT_TRY / 60:.0f}min"


def test_the_file_of_keys_is_made_as_printed_and_nobody_else_may_read_it(home):
    text = (ROOT / "docs/how-to/fit-over-night.md").read_text()
    (line,) = re.findall(r"```sh\n(.*batch\.env.*)\n```", text)
    subprocess.run(["sh", "-c", line], env={"PATH": os.environ["PATH"], "HOME": str(home)}, check=True)
    unit = RawConfigParser(strict=False)
    unit.read(UNITS / "hangtime-batch.service")
    path = Path(unit["Service"]["EnvironmentFile"].replace("%E", str(home / ".config")))
    assert path.stat().st_mode & 0o777 == 0o600


@pytest.mark.slow
def test_a_night_with_takes_that_do_not_fit_is_a_success_and_a_crash_is_not(home):
    """The command's own status for it, from a folder with one damaged take; Python's status of a crash is 1."""
    unit = RawConfigParser(strict=False)
    unit.read(UNITS / "hangtime-batch.service")
    successes = {int(status) for status in unit["Service"]["SuccessExitStatus"].split()}
    (home / "takes").mkdir()
    (home / "takes/damaged.mcap").write_bytes(b"not a take")
    words = [home / ".local/bin/hangtime", "batch", "takes", "--out", "results", "--method", "si", "--workers", "1"]
    done = subprocess.run(words, cwd=home, capture_output=True, text=True, check=False)
    assert "damaged" in done.stderr
    assert done.returncode in successes
    crash = subprocess.run([sys.executable, "-c", "raise RuntimeError"], capture_output=True, check=False)
    assert crash.returncode not in successes


# --- Slurm --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_slurm_recipe_as_printed_fits_two_takes(tmp_path):
    """`srun` starts what it is given, `hostname` says the loopback interface; all else is real."""
    (script,) = re.findall(r"```bash\n(.*?)```", (ROOT / "docs/how-to/fit-over-night.md").read_text(), re.DOTALL)
    (tmp_path / "bin").mkdir()
    for name, text in {"srun": 'exec "$@"', "hostname": "echo 127.0.0.1"}.items():
        (tmp_path / "bin" / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / "bin" / name).chmod(0o755)
    (tmp_path / "takes").mkdir()
    make_takes(tmp_path / "takes", 2)
    done = subprocess.run(
        ["bash", "-c", script.replace("hangtime batch", f"hangtime batch {' '.join(SHORT)}")],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=HANGS,
        env={
            **os.environ, "PATH": f"{tmp_path}/bin:{PROGRAMS}:{os.environ['PATH']}", "SLURM_JOB_ID": "7",
            "SLURM_CPUS_PER_TASK": "1", "TAKES": str(tmp_path / "takes"), "RESULTS": str(tmp_path / "results"),
        },
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "2 takes: 2 fitted." in done.stdout
    assert not list(tmp_path.glob("*.json"))


# --- the summary --------------------------------------------------------------------------------


@pytest.fixture
def rows():
    result = fit_result()
    worse = msgspec.structs.replace(
        result.error, train_after=msgspec.structs.replace(result.error.train_after, mean_m=0.0987)
    )
    unsure = [msgspec.structs.replace(p, is_identified=False) for p in result.parameters]
    return [
        Row(take="a.mcap", key="k1", state="fitted", sentence="", result=result),
        Row(take="b.mcap", key="k2", state="known", sentence="",
            result=msgspec.structs.replace(result, error=worse, parameters=unsure)),
        Row(take="c <&> ü.mcap", key="k3", state="failed", sentence='says "no", and <why>', result=None),
        Row(take="d.mcap", key="k4", state="waiting", sentence="", result=None),
    ]  # fmt: skip


def test_one_sentence_counts_every_state(rows):
    assert sentence_of(rows) == "4 takes: 1 fitted, 1 fitted before, 1 failed, 1 waiting."
    assert sentence_of(rows[:1]) == "1 take: 1 fitted."


def test_the_csv_has_a_row_for_each_take_and_its_numbers_to_the_last_digit(rows):
    """The interval begins at 0.8 times 61.2, which rounding makes 48.96000000000001; such noise alone is left out."""
    table = list(csv.DictReader(io.StringIO(as_csv(rows))))
    assert [row["take"] for row in table] == ["a.mcap", "b.mcap", "c <&> ü.mcap", "d.mcap"]
    assert table[1]["error_after_mm"] == "98.700"
    first = rows[0].result.parameters[1]
    assert float(table[0][first.name]) == first.fitted
    assert table[1][f"{first.name}_is_identified"] == "False"
    assert table[1][first.name] == ""  # rounding would choose the number; the interval stands beside it
    assert (table[1][f"{first.name}_low"], first.interval_low) == ("48.96", 0.8 * 61.2)
    low, high = 41.123456789012345, 48.96000000001  # other digits stay, also behind zeros
    exact = msgspec.structs.replace(first, interval_low=low, interval_high=high)
    changed = msgspec.structs.replace(rows[0].result, parameters=[exact])
    (line,) = csv.DictReader(io.StringIO(as_csv([replace(rows[0], result=changed)])))
    assert (float(line[f"{first.name}_low"]), float(line[f"{first.name}_high"])) == (low, high)
    assert table[2]["remark"] == 'says "no", and <why>'
    assert table[2][first.name] == ""


def test_the_page_is_whole_escapes_what_it_shows_and_begins_with_what_needs_a_look(rows):
    class Cells(HTMLParser):
        def __init__(self):
            super().__init__()
            self.open, self.widths, self.names, self.links = [], [], [], []

        def handle_starttag(self, tag, attrs):
            if tag == "tr":
                self.widths.append(0)
            if tag in ("td", "th"):
                self.widths[-1] += int(dict(attrs).get("colspan", 1))
            self.links += [value for name, value in attrs if name in ("href", "src")]
            if tag not in ("meta", "br"):
                self.open.append(tag)

        def handle_endtag(self, tag):
            assert self.open.pop() == tag

        def handle_data(self, data):
            if self.open and self.open[-1] == "th" and data.endswith(".mcap"):
                self.names.append(data)

    page = as_html(rows, Plan(method="kinect-skirt"))
    cells = Cells()
    cells.feed(page)
    assert cells.open == []
    assert len(set(cells.widths)) == 1
    assert cells.names == ["c <&> ü.mcap", "d.mcap", "b.mcap", "a.mcap"]
    assert cells.links == ["fits/k2.json", "fits/k1.json"]
    assert "98.7 mm" in page
    struct = f'">{rows[0].result.parameters[1].fitted:g}<br>'
    assert page.count(struct) == 1  # identified in `a` alone; in `b` its interval stands alone


@pytest.mark.parametrize(
    ("search", "told"),
    [
        ("annealing", "search annealing, 350 iterations, mesh"),
        ("restarts", "search restarts, 350 iterations, mesh"),
        ("tempering", "search tempering, 350 candidates, mesh"),
        ("cma-es", "search cma-es, 350 candidates, mesh"),
        ("least-squares", "search least-squares, 141 to 155 simulations a take, mesh"),
        ("short-windows", "search short-windows, 141 to 155 simulations a take, mesh"),
    ],
)
def test_the_page_says_what_the_search_spent_and_where_its_intervals_are_too_short(rows, search, told):
    counts = {"k1": 155, "k2": 141}
    spent = [
        replace(row, result=row.result and msgspec.structs.replace(row.result, simulations=counts[row.key]))
        for row in rows
    ]
    page = as_html(spent, Plan(search=search))
    assert told in page
    assert (f"Intervals by {search} are known to be too short" in page) == (search != "least-squares")


def test_the_page_of_a_night_without_results_says_nothing_of_them(rows):
    page = as_html(rows[2:], Plan(search="least-squares"))
    assert "search least-squares, mesh" in page
    assert "too short" not in as_html(rows[2:], Plan())


def test_801_candidates_of_tempering_leave_draws_enough_for_intervals_of_their_own_and_800_do_not(rows):
    """Stated by the search itself, on a constant cost."""
    for budget, is_enough in ((800, False), (801, True)):
        space = BoundedSpace(minimum=np.zeros(2), maximum=np.ones(2), is_log=np.zeros(2, bool))
        search = Tempering(np.full(2, 0.5), space, budget, 0, numbers=10.0)
        while not search.is_finished:
            candidates = search.ask(8)
            search.tell(candidates, np.ones(len(candidates)))
        assert (len(search.draws) >= FEWEST_DRAWS) == is_enough
        page = as_html(rows, Plan(search="tempering", iterations=budget))
        assert ("too short" not in page) == is_enough


def test_nothing_of_the_batch_is_loaded_before_it_is_needed():
    code = "import sys, fit.batch.cli; print(sorted({'distributed', 'obstore', 'bokeh', 'taichi'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
