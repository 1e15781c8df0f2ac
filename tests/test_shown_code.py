"""Commands, scripts and options in the texts exist."""

from __future__ import annotations

import re
from pathlib import Path

import typer

from docs.generator.commands import whole_command
from tests.repository import ROOT, SCRIPTS, name_of, texts

OURS = re.compile(r"(?:\w+=\S+ |sudo .* )*(?:\S*/)?hangtime (.+)")
PROGRAM = re.compile(r"(?:\w+=\S+ )*(?:\S*python3? )?((?:scripts|benchmarks)/\w[\w.]*|\.ci/run|\w+\.py)( .+)?")
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
# Code of other programs: in a line that begins with their name, or as an option alone.
OTHER_PROGRAMS = (
    "sbatch",
    "sha256sum",
    "systemctl",
    "systemd-analyze",
    "umockdev-run",
    "systemd-sysusers",
    "systemd-tmpfiles",
)
OTHER_OPTIONS = {"--nthreads", "--protocol", "--tls-ca-file", "--tls-cert", "--tls-key"}  # dask's


def shown_code() -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """What the texts show, as (file, line): every line of their code blocks, and every piece of code in a sentence."""
    in_blocks, in_sentences = [], []
    for path in texts():
        if path.suffix != ".md":
            continue
        text = path.read_text().replace("\\\n", " ")
        fenced, rest = re.findall(r"```.*?\n(.*?)```", text, re.DOTALL), re.sub(r"```.*?```", "", text, flags=re.DOTALL)
        blocks = fenced + re.findall(r"^ {4}\S.*$", rest, re.MULTILINE)
        lines = [line.split(" # ")[0].strip() for block in blocks for line in block.splitlines()]
        in_blocks += [(name_of(path), line) for line in lines]
        in_sentences += [(name_of(path), " ".join(code.split())) for code in re.findall(r"`([^`]+)`", rest)]
    return in_blocks, in_sentences


def options_of(part: typer.core.TyperCommand | typer.core.TyperGroup) -> set[str]:
    """Long options of a command, or of all below a group."""
    own = {option for parameter in part.params for option in (*parameter.opts, *parameter.secondary_opts)}
    below = [options_of(inner) for inner in getattr(part, "commands", {}).values()]
    return set().union({"--help"}, {option for option in own if option.startswith("--")}, *below)


def options_of_program(path: Path) -> set[str]:
    """Long options that a script's `case` or a program's parser names, or that of the program that it hands them to."""
    if path == ROOT / ".ci/run":
        return options_of_program(ROOT / "scripts/test")
    handed = re.search(r'-m tests\.(\w+) "\$@"', path.read_text())
    if handed:
        return options_of_program(next(ROOT.glob(f"tests/{handed[1]}/__main__.py")))
    found = re.findall(r'"(--[a-z][\w-]*)"|^ +(?:-\w \| )?(--[a-z][\w-]*)\)', path.read_text(), re.MULTILINE)
    return {"--help"}.union(*found) - {""}


def test_every_command_that_a_text_shows_exists_with_its_options() -> None:
    """Of `list|play` each; a sentence may name a group alone, and end in dots."""
    whole = whole_command()
    in_blocks, in_sentences = shown_code()
    shown = [(file, code, found[1]) for file, code in in_blocks + in_sentences if (found := OURS.fullmatch(code))]
    assert len(shown) > 100
    for file, code, rest in shown:
        part, words = whole, rest.split()
        while isinstance(part, typer.core.TyperGroup) and words and not words[0].startswith("-"):
            names = words.pop(0).split("|")
            assert set(names) <= set(part.commands), f"{file}: {code}"
            part = part.commands[names[0]]
        assert set(OPTION.findall(" ".join(words))) <= options_of(part), f"{file}: {code}"


def test_every_script_and_benchmark_that_a_text_shows_exists_with_its_options() -> None:
    in_blocks, in_sentences = shown_code()
    shown = [(file, code, found) for file, code in in_blocks + in_sentences if (found := PROGRAM.fullmatch(code))]
    assert len(shown) > 60
    for file, code, found in shown:
        name = found[1] if "/" in found[1] else f"benchmarks/{found[1]}"
        assert (ROOT / name).exists() or name == "benchmarks/NAME.py" or "/" not in found[1], f"{file}: {code}"
        if options := set(OPTION.findall(found[2] or "")):
            assert options <= options_of_program(ROOT / name), f"{file}: {code}"


def test_every_option_in_a_sentence_is_one_of_a_command_a_script_or_a_benchmark() -> None:
    known = options_of(whole_command()) | OTHER_OPTIONS
    known = known.union(*map(options_of_program, [*SCRIPTS, *(ROOT / "benchmarks").glob("*.py")]))
    unknown = [
        f"{file}: {option} in `{code}`"
        for file, code in shown_code()[1]
        if code.split()[0] not in OTHER_PROGRAMS
        for option in OPTION.findall(code)
        if option not in known
    ]
    assert unknown == []
