"""Every command of `hangtime`: its help pages and options, and its output under `--json` and `--quiet`."""

from __future__ import annotations

import json
import os
import pty
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
import typer

from docs.generator.commands import every_command, whole_command
from formats import command as program
from formats import help_pages
from formats.archive import write_take
from formats.command_groups import COMMAND_GROUPS, OTHER_COMMANDS
from formats.results import save_fit_result
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import fit_result
from tests.fit.scenes import hung, sheet, swing, take_of
from tests.sentences import LONGEST_SENTENCE, sentences_of, words_of

COMMANDS = dict(every_command(whole_command()))
NAMES = sorted(COMMANDS)
# Long-running commands report events at once; the appliance's two services report to the journal.
ON_AND_ON = {f"hangtime {name}" for name in (*help_pages.WITHOUT_QUIET, *help_pages.WITHOUT_JSON)}


def options_of(name):
    return {option: p for p in COMMANDS[name].params for option in (*p.opts, *p.secondary_opts)}


@pytest.mark.parametrize(
    "name",
    ["record", "import", "fit", "diagnose", "fabric", "report", "compare", "export", "animate", "batch"],
)
def test_a_main_command_has_an_example_that_the_program_understands(name):
    command = dict(every_command(whole_command()))[f"hangtime {name}"]  # parsing leaves marks on it
    found = re.search(r"Example: `hangtime (\S+) ([^`]+)`", command.help)
    assert found is not None
    assert found[1] == name
    command.make_context(name, shlex.split(found[2]))  # parses, and runs nothing


def test_the_commands_of_takes_begin_with_the_one_that_lists_them():
    shown = hangtime_here("takes", "--help", folder=".").stdout
    found = re.findall(r"^  (list|show|verify|recover|export|prune) ", shown, re.MULTILINE)
    assert found == ["list", "show", "verify", "recover", "export", "prune"]


def test_a_lone_seed_or_mesh_has_no_heading_of_its_own():
    assert "Search:" not in hangtime_here("sensor", "synthesise", "--help", folder=".").stdout
    assert "Model:" not in hangtime_here("export", "--help", folder=".").stdout
    assert "Search:" in hangtime_here("fit", "--help", folder=".").stdout


def test_a_wrong_option_of_watch_gives_one_object_on_one_line(tmp_path):
    done = hangtime_here("watch", "--json", "--nonsense", folder=tmp_path)
    assert done.returncode == 2
    (line,) = done.stdout.splitlines()
    assert "--nonsense" in json.loads(line)["error"]


@pytest.mark.parametrize("name", NAMES)
def test_a_command_is_summed_up_in_one_sentence_and_every_option_is_explained(name):
    command = COMMANDS[name]
    first = sentences_of(" ".join(command.help.split("\n\n")[0].split()))[0]
    assert words_of(first) <= LONGEST_SENTENCE
    assert not command.get_short_help_str(66).endswith("...")
    for parameter in command.params:
        assert getattr(parameter, "help", None), f"{name} {parameter.name}"
        assert parameter.help.rstrip().endswith("."), f"{name} {parameter.name}: {parameter.help}"


@pytest.mark.parametrize("name", NAMES)
def test_a_page_shows_every_option_under_a_heading(name):
    context = typer.Context(COMMANDS[name], info_name=name, help_option_names=["-h", "--help"], terminal_width=100)
    shown = COMMANDS[name].get_help(context)
    for option in [*(option for option in options_of(name) if option.startswith("-")), "-h", "--help"]:
        assert re.search(rf"(?<![\w-]){option}(?![\w-])", shown), option
    headings = re.findall(r"^(\w[\w ]*):$", shown, re.MULTILINE)
    known = ["Arguments", *help_pages.HEADINGS, "Options", help_pages.OUTPUT]
    assert headings == [heading for heading in known if heading in headings]


@pytest.mark.parametrize("name", NAMES)
def test_a_page_names_values_in_words_and_not_as_types_of_python(name):
    context = typer.Context(COMMANDS[name], info_name=name, help_option_names=["-h", "--help"], terminal_width=100)
    assert not re.findall(
        r"<(?:list\[)?(?:bool|int|float|str|path|directory|file)\b|\{[^|}]*\}", COMMANDS[name].get_help(context)
    )


def _count_below(heading, options):
    return sum(help_pages.HEADING_OF.get(option) == heading for option in options)


def test_commands_that_are_made_anew_have_each_option_once_and_under_its_heading():
    """Two commands bring a `--json` of their own."""
    commands = dict(every_command(whole_command()))
    assert sorted(commands) == NAMES
    for name, command in commands.items():
        options = [option for parameter in command.params for option in parameter.opts]
        assert len(options) == len(set(options)), name
        for parameter in command.params:
            headings = {help_pages.HEADING_OF.get(option) for option in parameter.opts} - {None}
            headings = {one for one in headings if _count_below(one, options) >= help_pages.FEWEST_OPTIONS.get(one, 1)}
            assert not headings or parameter.rich_help_panel is not None, f"{name} {parameter.name}"
            assert headings <= {parameter.rich_help_panel}, f"{name} {parameter.name}"
        for option, others in (("--json", help_pages.WITHOUT_JSON), ("--quiet", help_pages.WITHOUT_QUIET)):
            assert (option in options) == (name.removeprefix("hangtime ") not in others), f"{name} {option}"


@pytest.mark.parametrize("words", [["takes"], ["takes", "show"], ["fit"], ["sync", "now"]])
def test_both_ways_to_ask_for_help_work_at_every_depth(words, tmp_path):
    short = hangtime_here(*words, "-h", folder=tmp_path)
    assert short.returncode == 0
    assert short.stdout == hangtime_here(*words, "--help", folder=tmp_path).stdout


def test_commands_print_json_for_programs_and_are_quiet_when_asked():
    for name in NAMES:
        options = options_of(name)
        assert "--quiet" in options or name in ON_AND_ON, name
        assert "--json" in options or name in ON_AND_ON, name
    assert {"hangtime daemon", "hangtime watch", "hangtime sync run"} == ON_AND_ON


def test_the_list_of_commands_stands_under_headings_in_the_order_of_work(tmp_path):
    shown = hangtime_here("-h", folder=tmp_path).stdout
    headings = re.findall(r"^(\w[\w ]*):$", shown, re.MULTILINE)
    assert headings == ["Options", *(panel for panel in COMMAND_GROUPS if panel != OTHER_COMMANDS)]
    places = [shown.index(f"  {name} ") for name in ("record", "daemon", "import", "fit", "export")]
    assert places == sorted(places)


def test_the_version_is_printed_by_the_command_and_by_the_module(tmp_path):
    version = hangtime_here("--version", folder=tmp_path).stdout
    assert re.fullmatch(r"hangtime \d+\.\d+\.\d+\S*\n", version)
    done = subprocess.run([sys.executable, "-m", "hangtime", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == version


def test_a_command_prints_words_or_json_or_nothing(tmp_path):
    words = ("swatch", "s.toml", "--mass", 0.05, "--overwrite")
    assert hangtime_here(*words, folder=tmp_path).stdout == "s.toml: 81 markers, 62.5 mm apart\n"
    assert json.loads(hangtime_here(*words, "--json", folder=tmp_path).stdout) == {
        "file": "s.toml", "markers": 81, "apart_mm": 62.5,
    }  # fmt: skip
    quiet = hangtime_here(*words, "--quiet", folder=tmp_path)
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")
    assert hangtime_here(*words, folder=tmp_path).stdout  # the next command of this process prints again


TOLD_AS_JSON = (
    (("takes", "list", "."), "takes"), (("takes", "show", "a.mcap"), "duration_s"),
    (("takes", "verify", "a.mcap"), "takes"), (("takes", "recover", "a.mcap"), "takes"),
    (("takes", "export", "a.mcap", "--to", "csv", "--out", "e"), "files"),
    (("compare", "a.mcap", "b.mcap"), "compared"), (("report", "out"), "report"),
    (("export", "out", "--to", "csv", "--out", "f.csv"), "files"), (("compare", "out", "out"), "compared"),
    (("swatch", "s.toml", "--mass", "0.05"), "markers"),
)  # fmt: skip


def test_the_output_of_a_command_for_programs_is_one_json_document_and_nothing_else(tmp_path):
    time, garment = np.arange(0, 3, 1 / 30), sheet()
    for name in ("a", "b"):
        write_take(tmp_path / f"{name}.mcap", take_of(garment, time, swing(time), hung(garment, time), name=name))
    (tmp_path / "out").mkdir()
    save_fit_result(tmp_path / "out/fit.json", fit_result())
    for words, name in TOLD_AS_JSON:
        done = hangtime_here(*words, "--json", "--quiet", folder=tmp_path)
        assert (done.returncode, done.stderr) == (0, ""), words
        assert json.loads(done.stdout)[name], words


@pytest.mark.parametrize(("reader", "code"), [("true", 141), ("cat > /dev/null", 0)])
def test_json_that_nobody_reads_ends_like_words_that_nobody_reads(reader, code, tmp_path):
    words = f"{shlex.quote(sys.executable)} -m formats.command swatch s.toml --mass 0.05 --json"
    code_file = tmp_path / "code"
    done = subprocess.run(
        ["sh", "-c", f"({{ sleep 0.5; {words}; echo $? > {code_file}; }}) | {reader}"], capture_output=True, text=True,
        cwd=tmp_path, check=False,
    )  # fmt: skip
    assert done.stderr == ""
    assert code_file.read_text().strip() == str(code)


def test_a_quiet_command_still_says_its_error(tmp_path):
    done = hangtime_here("takes", "show", "gone.mcap", "-q", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("hangtime: gone.mcap: ")


def on_a_terminal(*words, **environment):
    """Return the command's output on a terminal of 100 columns."""
    ours, theirs = pty.openpty()
    known = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "FORCE_COLOR")}
    process = subprocess.Popen(
        [sys.executable, "-m", "hangtime", *words], stdout=theirs, stderr=theirs, stdin=theirs,
        env={**known, "TERM": "xterm-256color", "COLUMNS": "100", **environment},
    )  # fmt: skip
    os.close(theirs)
    written = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # Linux: the other end is closed
            break
        if not part:
            break
        written += part
    os.close(ours)
    assert process.wait() == 0
    return written.decode()


def test_a_terminal_gets_boxes_and_colours_unless_it_wants_none(tmp_path):
    colour = re.compile(r"\x1b\[[0-9;]*3[0-9]")
    drawn = on_a_terminal("compare", "-h")
    assert "╭─" in drawn
    assert not re.search(r"<(bool|list.Path.)>", drawn)
    assert "hangtime compare [OPTIONS] A B..." in re.sub(r"\x1b\[[0-9;]*m", "", drawn)
    assert colour.search(drawn)
    assert not colour.search(on_a_terminal("compare", "-h", NO_COLOR="1"))
    plain = hangtime_here("compare", "-h", folder=tmp_path).stdout  # not a terminal
    assert "╭─" not in plain
    assert "\x1b" not in plain


def parts_of(root):
    return {part: [sorted(p.opts) for p in one.params] for part, one in every_command(root, "")}


def test_a_command_that_is_made_alone_is_the_same_as_among_all():
    """Programs make the one that the command line names, as all of them take a tenth of a second."""
    among = whole_command().commands
    for name in among:
        alone = program.whole(name)
        assert list(alone.commands) == [name]
        assert parts_of(alone.commands[name]) == parts_of(among[name])
    for other in (None, "--help", "nothing", ""):
        assert list(program.whole(other).commands) == list(among)


def test_a_program_makes_only_the_command_that_it_is_asked_for_and_all_to_complete_words(tmp_path, monkeypatch):
    asked, made = [], whole_command()
    monkeypatch.setattr(program, "whole", lambda name=None: asked.append(name) or made)
    assert "Usage: hangtime takes show" in hangtime_here("takes", "show", "--help", folder=tmp_path).stdout
    for variable, value in (
        ("_HANGTIME_COMPLETE", "complete_bash"),
        ("COMP_WORDS", "hangtime ta"),
        ("COMP_CWORD", "1"),
    ):
        monkeypatch.setenv(variable, value)
    assert hangtime_here("ta", folder=tmp_path).stdout.split() == ["takes"]
    assert asked == ["takes", None]
