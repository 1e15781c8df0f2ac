"""Commands that are printed, run by a shell as they are printed, are what they say."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fit.api.said import is_diagnosed, model_to_name, next_command
from fit.recordings.ready import ready
from fit.report.origin import command_line
from formats.archive import write_take
from formats.garment import Garment
from formats.plain_text import as_typed
from formats.results import load_fit_result, save_diagnosis
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis
from tests.fit.scenes import sheet
from tests.fit.test_command_line import a_swung_take

# What a file system allows: anything but `/` and 0, also bytes that are not UTF-8.
NAMES = st.binary(min_size=1, max_size=12).map(
    lambda raw: os.fsdecode(raw.replace(b"/", b"").replace(b"\0", b"") or b"a")
)
ODD = ["my take.mcap", "it's.mcap", "-a.mcap", "--out", "a`b`.mcap", "$HOME.mcap", "a\nb.mcap", "caf\udce9.mcap",
       "\u00c4rmel \u65e5\u672c.mcap", 'a"b\\c!.mcap', "a\u202eb.mcap", "~", "*", "a\x1b[2J1", "\\n'"]  # fmt: skip
PARSES = """#!{python}
import json, sys
from docs.generator.commands import every_command, whole_command
name, *words = sys.argv[1:]
command = dict(every_command(whole_command()))["hangtime " + name]
given = command.make_context(name, words).params
print(json.dumps(given, default=str))
"""


def command_in(said):
    return re.search("Next: `(.*)` looks for missing physics\\.$", said, re.DOTALL)[1]


def words_of(line):
    """The words that bash makes of a command line, as text of the file system."""
    done = subprocess.run(
        ["bash", "-c", f"hangtime() {{ printf '%s\\0' \"$@\"; }}; {line}"], capture_output=True, check=True
    )
    return [os.fsdecode(word) for word in done.stdout.split(b"\0")[:-1]]


@given(words=st.lists(NAMES, min_size=1, max_size=4))
@example(words=ODD)
@settings(max_examples=60, deadline=None)
def test_a_shell_takes_a_printed_line_apart_into_its_words(words):
    line = as_typed(["hangtime", *words])
    assert words_of(line) == words
    assert line.isprintable()


def test_a_report_holds_its_command_as_it_can_be_run_again(monkeypatch):
    monkeypatch.setattr("sys.argv", ["hangtime", "fit", *ODD])
    assert words_of(command_line()) == ["fit", *ODD]


@pytest.fixture(scope="module")
def parsed(tmp_path_factory):
    """A function: the options that the real command gets from a printed line, run in bash; nothing else runs."""
    folder = tmp_path_factory.mktemp("bin")
    program = folder / "hangtime"
    program.write_text(PARSES.format(python=sys.executable))
    program.chmod(0o755)
    root = Path(__file__).parents[2]

    def parse(line):
        paths = {"PATH": f"{folder}:{os.environ['PATH']}", "PYTHONPATH": str(root)}
        done = subprocess.run(["bash", "-c", line], capture_output=True, env=os.environ | paths, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return parse


def test_the_next_command_has_every_argument_that_the_fit_had(parsed):
    """Names of each odd kind, a number with all its digits."""
    takes, held_out, out = [Path(name) for name in ODD[::2]], [Path(name) for name in ODD[1::2]], Path("-my 'out'")
    said = next_command(
        takes, held_out, ["up-and-down", "twist"], 0.0987654321, out, model="lean", anyway=True
    )  # fmt: skip
    got = parsed(command_in(said))
    assert [Path(one) for one in got["takes"]] == [Path(f"./{one}") for one in takes]
    assert [Path(one) for one in got["held_out"]] == [Path(f"./{one}") for one in held_out]
    assert (Path(got["out"]), got["held_out_motion"]) == (Path(f"./{out}"), ["up-and-down", "twist"])
    assert (got["spacing"], got["model"], got["anyway"]) == (0.0987654321, "lean", True)
    plain = parsed(command_in(next_command(takes, [], [], None, out)))
    assert (plain["spacing"], plain["model"], plain["anyway"], plain["held_out"]) == (None, None, False, [])


@pytest.mark.parametrize(
    ("method", "kind", "model"),
    [
        ("si", "sheet", ""), ("si", "t-shirt", "si"), ("si-sewn", "t-shirt", ""), ("si-sewn", "sheet", "si-sewn"),
        ("lean", "sheet", "lean"), ("kinect-skirt", "sheet", "kinect-skirt"), ("mocap-swatch", "sheet", ""),
        ("si-outline", "sheet", ""),
    ],
)  # fmt: skip
def test_the_next_command_names_the_model_of_the_fit_unless_it_is_the_default_or_none(method, kind, model):
    garment: Garment = msgspec.structs.replace(sheet(), kind=kind)
    assert model_to_name(method, garment) == model


def heavy(name):
    """A take of a cloth of 12 kg, which no sheet weighs, so that only --anyway accepts it."""
    take = a_swung_take(name, seconds=3.0)
    return replace(take, garment=msgspec.structs.replace(take.garment, mass_kg=12.0))


def test_the_command_that_a_fit_prints_is_accepted_by_diagnose_in_a_shell(tmp_path, parsed):
    """The takes are implausible, their names odd, the model and the mesh not the default ones."""
    write_take(tmp_path / "my take's.mcap", heavy("a"))
    words = ["my take's.mcap", "--method", "lean", "--spacing", "0.1500000001", "--search", "annealing"]
    refused = hangtime_here("fit", *words, "--iterations", 1, folder=tmp_path)
    assert "or --anyway" in refused.stderr, refused.stderr
    done = hangtime_here("fit", *words, "--iterations", 1, "--anyway", "--out", "my out", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    line = command_in(done.stdout.strip())
    got = parsed(line)
    assert (got["takes"], got["out"]) == (["my take's.mcap"], "my out")
    assert (got["spacing"], got["model"], got["anyway"]) == (0.1500000001, "lean", True)
    fit = load_fit_result(tmp_path / "my out/fit.json")
    assert (fit.spacing, fit.method) == (got["spacing"], got["model"])


def test_a_diagnosis_of_other_takes_in_the_folder_keeps_the_next_command(tmp_path):
    """It is set aside by the diagnosis; one of these takes has answered, and one that cannot be read has not."""
    take = a_swung_take(seconds=3.0)
    prepared = ready([take], [])
    assert not is_diagnosed(tmp_path, prepared)
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis())
    assert not is_diagnosed(tmp_path, prepared)
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis(take_ids=["a"], take_contents=prepared.contents))
    assert is_diagnosed(tmp_path, prepared)
    (tmp_path / "diagnosis.json").write_text("{")
    assert not is_diagnosed(tmp_path, prepared)
    write_take(tmp_path / "a.mcap", take)
    save_diagnosis(tmp_path / "out/diagnosis.json", diagnosis())
    done = hangtime_here(
        "fit", "a.mcap", "--spacing", 0.15, "--search", "annealing", "--iterations", 1, "--out", "out", folder=tmp_path
    )
    assert done.stdout.endswith(
        "Next: `hangtime diagnose a.mcap --spacing 0.15 --out out` looks for missing physics.\n"
    )


@pytest.mark.slow
def test_the_printed_command_itself_begins_to_diagnose_the_takes(tmp_path):
    """It is interrupted once it has named them, which it does after everything that it could refuse."""
    write_take(tmp_path / "my take's.mcap", heavy("a"))
    words = ["fit", "my take's.mcap", "--method", "lean", "--spacing", "0.1500000001", "--anyway", "--out", "my out"]
    done = hangtime_here(*words, "--search", "annealing", "--iterations", 1, folder=tmp_path)
    program = tmp_path / "bin/hangtime"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m hangtime "$@"\n')
    program.chmod(0o755)
    paths = {"PATH": f"{program.parent}:{os.environ['PATH']}", "PYTHONPATH": str(Path(__file__).parents[2])}
    with subprocess.Popen(
        ["bash", "-c", f"trap : INT; {command_in(done.stdout.strip())}"], stderr=subprocess.PIPE, text=True,
        cwd=tmp_path, env=os.environ | paths, start_new_session=True,
    ) as begun:  # fmt: skip
        said = ""
        for line in begun.stderr:
            said += line
            if "judging on the same" in line:
                os.killpg(begun.pid, signal.SIGINT)
    assert (begun.returncode, "finished fits are kept" in said) == (130, True), said
    assert (tmp_path / "my out/diagnosis.partial").is_dir()
