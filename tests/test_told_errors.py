"""A failing command reports its reason: under `error` in its JSON, and on stderr even under `--quiet`."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from capture.appliance import control
from capture.appliance.sync_status import Proof
from capture.sync.rounds import Sync
from firmware_host.doctor import doctor
from firmware_host.doctor.checks import ok, problem, skipped
from formats.archive import write_take
from formats.descriptions import dump_description
from formats.importers.marker_tracks import write_marker_csv
from tests.fit.here import hangtime_here
from tests.formats.test_archive import a_take
from tests.formats.test_marker_oddities import GARMENT as SWATCH
from tests.formats.test_marker_oddities import hanging

GONE = "cannot be read (No such file or directory); check the path"
ABSENT = "is absent; install the appliance (docs/how-to/appliance.md), or give another file with --config"
OPEN = "--garment g.toml --out"


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with a sound take, a damaged one, a file that is not a take, and a recording with its garment."""
    folder = tmp_path_factory.mktemp("desk")
    raw = write_take(folder / "a.mcap", a_take()).read_bytes()
    (folder / "behind.mcap").write_bytes(raw + b"ten bytes!")
    (folder / "listed").mkdir()
    (folder / "listed/e.mcap").write_bytes(b"")
    write_marker_csv(folder / "m.csv", hanging())
    (folder / "g.toml").write_text(dump_description(SWATCH))
    return folder


@pytest.mark.parametrize(
    ("words", "sentences"),
    [
        ("takes verify gone.mcap a.mcap lost.mcap", [f"gone.mcap: {GONE}", f"lost.mcap: {GONE}"]),
        ("takes verify behind.mcap", ["behind.mcap: 150 frames in 5 blocks; 10 bytes"]),
        ("takes recover gone.mcap --out r", [f"gone.mcap: {GONE}"]),
        ("takes recover gone.mcap lost.mcap --out r", [f"gone.mcap: {GONE}", f"lost.mcap: {GONE}"]),
        ("takes list listed", ["listed/e.mcap: is "]),
        ("takes export a.mcap gone.mcap --to csv --overwrite --out e", [f"gone.mcap: {GONE}"]),
        ("takes export gone.mcap --to csv --out e", [f"gone.mcap: {GONE}"]),
        (f"import m.csv gone.csv {OPEN} t --overwrite", [f"gone.csv: {GONE}"]),
        ("sync now --config gone.toml", [f"gone.toml: {ABSENT}"]),
        ("sync prove --config gone.toml", [f"gone.toml: {ABSENT}"]),
        ("sync status --config gone.toml", [f"gone.toml: {ABSENT}"]),
    ],
)
def test_a_command_that_fails_has_its_error_for_a_program_and_on_stderr_in_silence(desk, words, sentences):
    done = hangtime_here(*words.split(), "--json", "--quiet", folder=desk)
    assert done.returncode == 2
    said = [line.removeprefix("hangtime: ").removeprefix("hangtime sync: ") for line in done.stderr.splitlines()]
    assert [line[: len(wanted)] for line, wanted in zip(said, sentences, strict=True)] == sentences
    assert json.loads(done.stdout)["error"] == said[0]


def test_an_import_beside_anothers_garment_says_in_silence_that_it_stays(desk, monkeypatch):
    hangtime_here("import", "m.csv", *OPEN.split(), "own", folder=desk)
    (desk / "own/garment.toml").write_text("another's")
    replaced = Path.replace

    def refuse(path, target):
        if target.name == "garment.toml":
            raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), str(path))
        return replaced(path, target)

    monkeypatch.setattr(Path, "replace", refuse)
    done = hangtime_here("import", "m.csv", *OPEN.split(), "own", "--overwrite", "--quiet", "--json", folder=desk)
    assert done.returncode == 2
    assert done.stderr == f"hangtime: {json.loads(done.stdout)['error']}\n"
    assert "own/garment.toml: " in done.stderr


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("takes show a.mcap --json --bogus", "No such option: --bogus"), ("takes gone --json", "No such command"),
        ("takes list a b --json", "Got unexpected extra argument"), ("--json", "No such option: --json"),
    ],
)  # fmt: skip
def test_json_of_a_command_line_that_is_wrong_before_its_json_has_the_sentence_of_its_error(desk, words, error):
    done = hangtime_here(*words.split(), folder=desk)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (2, f"Error: {json.loads(done.stdout)['error']}")
    assert json.loads(done.stdout)["error"].startswith(error)


def test_a_file_that_is_named_json_asks_for_none(desk):
    done = hangtime_here("takes", "show", "--", "--json", folder=desk)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"hangtime: --json: {GONE}\n")


def test_help_beside_json_is_help_alone(desk):
    assert (
        hangtime_here("takes", "show", "--json", "-h", folder=desk).stdout
        == hangtime_here("takes", "show", "-h", folder=desk).stdout
    )


def test_watch_ends_with_an_error_in_one_line_as_are_its_other_objects(desk):
    done = hangtime_here("watch", "--socket", "gone.sock", "--json", folder=desk)
    assert done.returncode == 2
    assert done.stderr == f"hangtime: {json.loads(done.stdout)['error']}\n"
    assert done.stdout.count("\n") == 1


def test_the_doctor_says_in_silence_what_is_not_well(desk, monkeypatch):
    found = {
        "usb": ok("there"),
        "depth": problem("is dark", advice="turn on the light"),
        "markers": skipped("waits for `depth`"),
    }
    each = [(SimpleNamespace(name=name), finding) for name, finding in found.items()]
    monkeypatch.setattr(doctor, "all_checks", lambda is_recording: [check for check, _ in each])
    monkeypatch.setattr(doctor, "examine", lambda checks, examination: each)
    done = hangtime_here("sensor", "doctor", "--quiet", "--json", folder=desk)
    assert (done.returncode, done.stderr.splitlines()) == (1, [
        "hangtime: depth: is dark; turn on the light", "hangtime: markers: skipped: waits for `depth`"
    ])  # fmt: skip
    assert json.loads(done.stdout)["error"] == "depth: is dark; turn on the light"


def test_an_appliance_that_cannot_record_says_in_silence_why(desk, monkeypatch):
    """A report of a daemon, with the facts alone that the command itself reads."""
    fault = {"sentence": "no sensor is there", "advice": "plug it in"}
    told = {"state": "fault", "faults": [fault], "line": "nothing"}
    monkeypatch.setattr(control, "ask", lambda socket, do: dict(told))
    monkeypatch.setattr("capture.appliance.status.lines", lambda told: [])
    done = hangtime_here("status", "--quiet", "--json", folder=desk)
    assert (done.returncode, done.stderr) == (1, "hangtime: no sensor is there; plug it in\n")
    assert json.loads(done.stdout)["error"] == "no sensor is there; plug it in"


def test_a_proof_that_finds_a_take_damaged_is_an_error(desk, monkeypatch):
    proof = Proof(at="2026-01-01T00:00:00+00:00", sequence=3, outcome="damaged")
    monkeypatch.setattr(Sync, "prove", lambda self: proof)
    (desk / "spool").mkdir()
    (desk / "sync.toml").write_text(f'[spool]\nfolder = "spool"\n[sync]\nurl = "file://{desk}/server"\n')
    done = hangtime_here("sync", "prove", "--config", "sync.toml", "--json", folder=desk)
    assert (done.returncode, json.loads(done.stdout)["error"]) == (
        2, "take-000003 was fetched from the server: damaged"
    )  # fmt: skip
