"""What `hangtime batch` says and how it ends, where every fit is known and no worker has to start."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from fit.batch import runner
from fit.batch.garments import diagnoses_of, is_diagnosed, wardrobes
from fit.batch.jobs import Outcome, diagnosis_name, failure_name, report_name, result_name
from fit.batch.kept import keep
from fit.batch.runner import survey
from fit.batch.store import open_store
from fit.batch.summary import rows_of
from fit.identification.request import Plan
from fit.recordings.intact import FRAME_FIELDS
from formats.archive import read_take, write_take
from formats.results import result_bytes
from tests.fit.batch.night import SHORT
from tests.fit.batch.test_night_of_diagnoses import a_take
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.formats.unprivileged import hangtime_unprivileged

PLAN = Plan(method="kinect-skirt", iterations=8, spacing=0.1)  # of SHORT


class Night:
    """A folder with a take of each name, which are fitted or to fit."""

    def __init__(self, folder, *names, to_fit=()):
        self.folder, self.results = folder, open_store(str(folder / "out"))
        (folder / "takes").mkdir()
        self.takes = open_store(str(folder / "takes"))
        for name in names:
            amplitude, sideways = (0.0, 0.2) if name == "side" else (0.06, 0.0)
            write_take(folder / f"takes/{name}.mcap", a_take(name, amplitude=amplitude, sideways=sideways))
        if names:
            self.keep_fits()
        for name in to_fit:
            write_take(folder / f"takes/{name}.mcap", a_take(name))

    def keep_fits(self):
        """Keep a fit of every take."""
        for job in survey(self.takes, self.results, PLAN).jobs:
            keep(self.results, result_name(job.key), result_bytes(fit_result(), self.folder / "k"))

    def add_part_of(self, take, name, frames):
        """Add frames of a take as another take, which is fitted."""
        whole = read_take(self.folder / f"takes/{take}.mcap")
        part = {name: array[frames] for name in FRAME_FIELDS if (array := getattr(whole, name)) is not None}
        write_take(self.folder / f"takes/{name}.mcap", dataclasses.replace(whole, take_id=name, **part))
        self.keep_fits()

    def diagnoses(self):
        """The diagnoses to make."""
        found = survey(self.takes, self.results, PLAN)
        rows = rows_of(found, self.results)
        every = wardrobes(rows, found, self.takes, lambda one: is_diagnosed(one, self.results, 0))
        return diagnoses_of(every, self.takes, self.results, 0).jobs

    def diagnosis_key(self):
        """The key of the only garment's diagnosis."""
        return self.diagnoses()[0].key

    def run(self, *words):
        workers = () if "--scheduler" in words else ("--workers", 1)
        return hangtime_here("batch", "takes", "--out", "out", *workers, *SHORT, *words, folder=self.folder)


def test_a_night_is_done_where_a_garment_lacks_takes_and_says_what_it_needs(tmp_path):
    done = Night(tmp_path, "front").run("--diagnose", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["summary"] == str(tmp_path / "out/summary.html")
    assert told["morning"] == str(tmp_path / "out/morning.html")
    assert told["headline"] == "1 take: 1 fitted before. 1 garment: 0 diagnosed, 1 without enough takes."
    assert [one["take"] for one in told["takes"]] == ["front.mcap"]
    (need,) = told["needs"]
    assert need["who"] == "sheet"
    assert need["what"].startswith("Not diagnosed: its only take moves face-on")
    assert "1 take, 0 to fit.\n1 garment, 0 to diagnose.\n" in done.stderr
    assert f"sheet: {need['what']}\n" in done.stderr
    assert (tmp_path / "out/morning.txt").read_text().startswith("Hangtime, ")


def test_a_night_with_a_diagnosis_that_failed_ends_with_its_own_status_and_the_morning_page(tmp_path):
    night = Night(tmp_path, "front", "side")
    key = night.diagnosis_key()
    night.results.write(failure_name(key), b'{"sentence": "the cloth flew apart; record again"}')
    done = night.run("--diagnose")
    assert done.returncode == 3
    headline = "2 takes: 2 fitted before. 1 garment: 0 diagnosed."
    assert f"{tmp_path}/out/morning.html: {headline}" in night.run("--diagnose", "--quiet").stderr
    assert done.stdout.endswith(f"{headline}\nMorning page: {tmp_path}/out/morning.html\n")
    assert "sheet: the cloth flew apart; record again\n" in done.stderr

    keep(night.results, report_name(key), b"<html></html>")
    keep(night.results, diagnosis_name(key), result_bytes(diagnosis(), tmp_path / "k"))
    assert night.run("--diagnose").returncode == 0


@pytest.mark.parametrize("name", ["a", "z"])
def test_a_twin_of_a_take_is_left_out_with_a_note_that_names_both_and_the_garment_is_diagnosed(tmp_path, name):
    """The last 80 of a take's 90 frames as another take, before it and behind it in the order of names."""
    night = Night(tmp_path, "front", "side")
    night.add_part_of("front", name, slice(10, None))
    (job,) = night.diagnoses()
    assert (job.training, job.held_out) == (("front.mcap",), ("side.mcap",))
    keep(night.results, report_name(job.key), b"<html></html>")
    keep(night.results, diagnosis_name(job.key), result_bytes(diagnosis(), tmp_path / "k"))
    done = night.run("--diagnose", "--json")
    assert done.returncode == 0, done.stderr
    why = "Left out of the diagnosis: it holds frames of the recording that front.mcap holds."
    assert json.loads(done.stdout)["left_out"] == [{"take": f"{name}.mcap", "why": why}]
    assert f"{name}.mcap: {why}\n" in done.stderr
    assert why in (tmp_path / "out/morning.html").read_text()
    assert why in (tmp_path / "out/morning.txt").read_text()


def test_of_two_takes_as_long_the_one_that_was_diagnosed_stays(tmp_path):
    """A rounded copy, which sorts first, comes after the diagnosis."""
    night = Night(tmp_path, "front", "side")
    (job,) = night.diagnoses()
    keep(night.results, report_name(job.key), b"<html></html>")
    keep(night.results, diagnosis_name(job.key), result_bytes(diagnosis(), tmp_path / "k"))
    whole = read_take(tmp_path / "takes/front.mcap")
    write_take(tmp_path / "takes/a.mcap", dataclasses.replace(whole, take_id="a", points=whole.points.round(4)))
    night.keep_fits()
    assert night.diagnoses() == []
    done = night.run("--diagnose", "--json")
    why = "Left out of the diagnosis: it holds frames of the recording that front.mcap holds."
    assert json.loads(done.stdout)["left_out"] == [{"take": "a.mcap", "why": why}]


@pytest.mark.parametrize("name", ["a", "z"])
def test_a_file_that_joins_two_takes_is_left_out_and_both_takes_stay(tmp_path, name):
    night = Night(tmp_path, "front", "side")
    front, side = (read_take(tmp_path / f"takes/{one}.mcap") for one in ("front", "side"))
    joined = {
        key: np.concatenate([one, getattr(side, key)]) for key in FRAME_FIELDS
        if (one := getattr(front, key)) is not None
    }  # fmt: skip
    joined["time"] = np.concatenate([front.time, side.time - side.time[0] + front.time[-1] + 1 / 30])
    write_take(tmp_path / f"takes/{name}.mcap", dataclasses.replace(front, take_id=name, **joined))
    night.keep_fits()
    (job,) = night.diagnoses()
    assert (job.training, job.held_out) == (("front.mcap",), ("side.mcap",))
    keep(night.results, report_name(job.key), b"<html></html>")
    keep(night.results, diagnosis_name(job.key), result_bytes(diagnosis(), tmp_path / "k"))
    done = night.run("--diagnose", "--json")
    why = "Left out of the diagnosis: it holds frames of the recordings that front.mcap and side.mcap hold."
    assert json.loads(done.stdout)["left_out"] == [{"take": f"{name}.mcap", "why": why}]


def test_a_garment_whose_twins_leave_too_few_takes_names_them(tmp_path):
    night = Night(tmp_path, "front")
    night.add_part_of("front", "cut", slice(10, None))
    (need,) = json.loads(night.run("--diagnose", "--json").stdout)["needs"]
    assert need["what"].startswith("Not diagnosed: its only take moves face-on")
    twin = "cut.mcap is left out: it holds frames of the recording that front.mcap holds."
    assert need["what"].endswith(f"; {twin}")


def test_a_take_that_failed_is_told_once_with_and_without_the_morning_page(tmp_path):
    night = Night(tmp_path, "front", to_fit="b")
    (job,) = survey(night.takes, night.results, PLAN).jobs
    night.results.write(failure_name(job.key), b'{"sentence": "the hanger is lost; record again"}')
    for words in ((), ("--diagnose",)):
        done = night.run(*words)
        assert done.returncode == 3
        assert done.stderr.count("b.mcap: the hanger is lost; record again\n") == 1


def test_a_night_shows_how_far_it_is_and_continues_after_ctrl_c(tmp_path, monkeypatch):
    """Of four takes the first half is done, one of them in vain, and one of the others at 50 %."""
    night = Night(tmp_path, to_fit="abcd")

    def stops(found, workers, *, progress, say, ending):
        (first, second, *_) = found.jobs
        found.outcomes[first.key] = Outcome(key=first.key, state="failed", sentence="the hanger is lost")
        found.outcomes[second.key] = Outcome(key=second.key, state="refused", sentence="no memory")
        progress(2.5, 4, "c.mcap: searching")
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "run", stops)
    done = night.run("--diagnose")
    assert done.returncode == 130
    assert "batch: 62 %, 2/4 takes, 2 failed, c.mcap: searching\n" in done.stderr
    assert done.stderr.endswith("Interrupted; the same command continues.\n")
    assert "a.mcap: the hanger is lost\n" in done.stderr
    assert "4 takes: 1 failed, 1 not fitted, 2 waiting." in (tmp_path / "out/summary.html").read_text()
    assert not (tmp_path / "out/morning.html").exists()


def test_a_batch_hands_its_cluster_what_its_options_say(tmp_path, monkeypatch):
    """Minutes of patience, and no end unless there is one."""
    night, asked = Night(tmp_path, to_fit="a"), []
    monkeypatch.setattr(runner, "run", lambda found, workers, **more: asked.append((workers, more["ending"].is_over)))
    assert night.run("--patience", 2, "--scheduler", "tcp://a:1").returncode == 3
    night.run("--hours", 0)
    night.run("--dashboard-port", 0)
    (first, is_over), (second, is_over_at_once), (third, _) = asked
    assert (first.patience, first.dashboard_port, first.scheduler, first.count) == (120.0, 8787, "tcp://a:1", None)
    assert third.dashboard_port == 0
    assert (second.patience, second.dashboard_port, second.scheduler) == (600.0, 8787, None)
    assert (is_over, is_over_at_once) == (False, True)


def test_a_night_whose_results_have_no_place_is_refused_at_once(tmp_path):
    """Else every take would be fitted for nothing."""
    night = Night(tmp_path, to_fit="a")
    (night.folder / "locked").mkdir(mode=0o555)
    (done,) = hangtime_unprivileged(["batch", "takes", "--out", "locked/out", *SHORT], folder=night.folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith(
        "locked/out: cannot be made or written to (Permission denied); choose another folder, or get the "
        "permission to write to this one\n"
    )
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("words", [("--retry-failed",), ()])
def test_failed_takes_and_garments_are_tried_again_with_one_option(tmp_path, monkeypatch, words):
    night, counts = Night(tmp_path, "front", "side"), []
    key = night.diagnosis_key()
    write_take(tmp_path / "takes/new.mcap", a_take("new"))
    (job,) = survey(night.takes, night.results, PLAN).jobs
    for one in (key, job.key):
        night.results.write(failure_name(one), b'{"sentence": "in vain"}')
    monkeypatch.setattr(runner, "run", lambda found, *_, **__: counts.append(len(found.waiting)))
    assert night.run("--diagnose", *words).returncode == 3
    assert counts == ([1, 1] if words else [0, 0])
