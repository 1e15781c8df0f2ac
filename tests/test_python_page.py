"""The Python of the tutorial's page, run as it is printed."""

from __future__ import annotations

import re

import msgspec
import pytest

from formats.results import load_diagnosis
from tests.api_takes import command, written_takes
from tests.repository import ROOT

TUTORIAL = ROOT / "docs/tutorial/python.md"
SHORT_SEARCH = "    search='annealing',\n    iterations=8,\n"


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    return written_takes(tmp_path_factory.mktemp("page") / "demo")


def blocks(*, diagnosis):
    """The tutorial's Python, with or without its section about the diagnosis, which takes minutes."""
    sections = re.split(r"^## ", TUTORIAL.read_text(), flags=re.MULTILINE)
    chosen = [s for s in sections if diagnosis or not s.startswith("Diagnose")]
    return re.findall(r"^```python\n(.*?)^```", "".join(chosen), flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("search", [SHORT_SEARCH, pytest.param("", marks=pytest.mark.slow)])
def test_the_tutorial_runs_as_it_is_printed(takes, tmp_path, monkeypatch, capsys, search):
    """With the search that it prints, and with a short one."""
    (tmp_path / "demo").symlink_to(takes)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    found = blocks(diagnosis=False)
    assert len(found) == 7
    assert "".join(found).count("    seed=0,\n") == 1
    for block in found:
        exec(compile(block.replace("    seed=0,\n", f"    seed=0,\n{search}"), str(TUTORIAL), "exec"), names)
    said = capsys.readouterr().out
    assert "stretch_stiffness [N/m]" in said
    assert "no-such-take.mcap" in said
    assert (tmp_path / "report.html").read_text().startswith("<!doctype html>")


@pytest.mark.slow
def test_the_tutorials_diagnosis_is_the_commands_to_the_last_digit(takes, tmp_path, monkeypatch, capsys):
    (tmp_path / "demo").symlink_to(takes)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks(diagnosis=True):
        exec(compile(block, str(TUTORIAL), "exec"), names)
    paths = [takes / f"{name}.mcap" for name in ("mixed", "gentle")]
    mine, end = names["found"].result, 4 if names["found"].result.verdict == "inconclusive" else 0
    said = command("diagnose", *paths, "--held-out", takes / "swing.mcap", "--out", "out", folder=tmp_path, end=end)
    kept = load_diagnosis(tmp_path / "out/diagnosis.json")
    apart = {"cost": msgspec.structs.replace(kept.cost, seconds=0.0), "created": ""}
    assert msgspec.structs.replace(mine, **apart) == msgspec.structs.replace(kept, **apart)
    assert mine.cost.simulations == kept.cost.simulations
    assert said.splitlines()[0] == f"Verdict: {mine.verdict}"
    assert (tmp_path / "diagnosis.html").exists()
