"""Every `hangtime` command of a page parses and runs, on small inputs and in what it finds around it."""

from __future__ import annotations

import functools
import importlib.util
import os
import re
import shlex
import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import typer

from docs.generator.commands import Part, every_command, whole_command
from fit.figure.dressmaking import plain_skirt
from fit.figure.gait import walk
from fit.foreign.process import BLENDER
from formats.archive import write_take
from tests import openni2
from tests.firmware_host.scenes import write_recording
from tests.fit.figure.walking import bvh_of
from tests.fit.here import hangtime_here
from tests.fit.scenes import hung, material, sheet, simulate_take, swing, take_of
from tests.shared_data import SHARED_DATA
from tests.surroundings import APPLIANCE, BUCKET, EMPTY, KINECT, PS1080, STREAM, keep_appliance, surroundings
from tests.test_docs import DOCS, PAGES, ROOT, name_of

# Pages that show how Hangtime is used now; notebook, decisions and changelog are records of their days.
GUIDE = [
    page
    for page in PAGES
    if not {"notebook", "decisions", "systemd"} & set(page.relative_to(ROOT).parts) and page.name != "CHANGELOG.md"
]
OPENNI, REAL, BPY = "libopenni2", "real recordings", "bpy"
MUJOCO = "HANGTIME_MUJOCO_PYTHON"
SHORT = " --iterations 8 --spacing 0.1"  # of methods that anneal
COARSE = (r"$", " --spacing 0.15")
ONE_COARSE_CASE = " --option=--spacing --option 0.15"  # half a minute of the processor
# Of real recordings, the fewest of which a blind case takes its takes.
SWUNG = " ".join(shlex.quote(str(path)) for path in sorted((SHARED_DATA / "swung-cloth").glob("*.npz"))[:5])
FEW_CASES = (
    (r"--cases \d+", "--cases 1"), (r"--nulls \d+", "--nulls 0"), (r"--pairs \d+", "--pairs 0"),
    (r"--unknowns \d+", "--unknowns 0"),
)  # fmt: skip
AS_NEW = (r"--out (\w+)", r"--out new-\1")  # the existing takes are of another garment


@dataclass(frozen=True)
class Rule:
    """The test of matching commands: run among the quick or the slow tests, reduced by changes."""

    pattern: str
    how: str
    changes: tuple[tuple[str, str], ...] = ()
    needs: tuple[str, ...] = ()  # without which the command is left out: modules, variables, `OPENNI`, `REAL`, `BPY`
    around: str = ""  # what it finds around it, of `tests.surroundings`
    ends: tuple[int, ...] = (0,)  # the exit codes it may end with


def of_models(pattern: str, around: str = PS1080, how: str = "quick") -> Rule:
    """Return the rule of commands of `hangtime sensor` that run on models of USB devices."""
    return Rule(rf"hangtime sensor {pattern}", how, around=around, needs=("usb",))


# The first rule that matches counts. A word in capitals is a form to fill in, and a change fills it in.
RULES = (
    Rule(r"hangtime sensor play FILE\.oni ", "quick", (("FILE", "recorded"),), needs=(OPENNI,)),
    Rule(
        r"hangtime import FILE\.\.\. ", "quick",
        ((r"FILE\.\.\.", "swing.csv"), ("swatch.toml", "other-swatch.toml"), (r"--frames \d+", "--frames 78"),
         (r"$", " --out imported")),
    ),
    Rule(r"hangtime record --sensor SOURCE ", "slow", (("SOURCE", "'synthetic:swing?seconds=3'"), ("TAKE", "taken"))),
    Rule(r"hangtime calibrate --sensor SOURCE ", "slow", (("SOURCE", "'synthetic:gentle?seconds=3'"),)),
    Rule(r"hangtime sensor synthesise DIR ", "slow", (("DIR", "made"), (r"--seconds \d+", "--seconds 4"))),
    Rule(r"hangtime (?:takes prune|sync (?:status|prove))\b", "quick", ((r"$", " --config appliance.toml"),)),
    Rule(r"hangtime status$", "quick", around=APPLIANCE),
    Rule(r"hangtime batch s3://", "slow", ((r"$", " --spacing 0.15 --workers 1"),), around=BUCKET),
    Rule(r"hangtime fit .*--engine blender", "slow", ((r"$", " --iterations 4 --spacing 0.15"),), needs=(BPY,)),
    Rule(
        rf"{MUJOCO}=\S+ hangtime blind make set", "slow",
        (("make set", "make mujoco-set"), *FEW_CASES, (r"$", " --side 0.06")), needs=(MUJOCO,),
    ),
    Rule(r"hangtime import swung-cloth/", "slow", ((r"swung-cloth/\*\.npz", SWUNG),), needs=(REAL,)),
    Rule(
        r"hangtime blind make set --real takes", "slow",
        (("make set", "make real-set"), (r"--cases \d+", "--cases 1"), (r"--nulls \d+", "--nulls 1")), needs=(REAL,),
    ),
    of_models("list$", EMPTY),
    of_models("(?:info|log|reset --reboot)$"),
    of_models("led ", KINECT),
    of_models("doctor(?! synthetic)", how="slow"),
    Rule(r"hangtime sensor play openni2:", "quick", (("openni2:", f"'{STREAM}'"),)),
    Rule(r"hangtime export .*--to usd", "quick", (AS_NEW,), needs=("pxr",)),
    Rule(r"hangtime export ", "quick", (AS_NEW,)),
    Rule(
        r"hangtime animate .*--wear t-shirt", "slow", ((r"$", " --size 64x64 --seconds 2"),), needs=("av",),
    ),
    Rule(r"hangtime animate .*--bvh", "slow", ((r"--seconds \d+", "--seconds 2"), COARSE)),
    Rule(
        r"hangtime animate .*--figure", "slow",
        ((" --seconds [0-9]+", ""), ("--take swing", "--take skirt"), COARSE, (r"$", " --size 64x64 --seconds 2")),
        needs=("av",),
    ),
    Rule(
        r"hangtime animate .*--motion", "slow",
        ((" --seconds [0-9]+", ""), COARSE, (r"$", " --size 64x64 --seconds 2")), needs=("av",),
    ),
    Rule(r"hangtime animate ", "slow", (COARSE, (r"$", " --size 64x64")), needs=("av",)),
    Rule(r"hangtime (?:takes (?:show|verify|export|labels)|fabric|report|compare|markers print|swatch) ", "quick"),
    Rule(r"hangtime import (?!demo-swatch)", "quick"),
    Rule(r"hangtime (?:sensor synthesise-swatch|import) ", "slow"),  # the second needs the first one's output
    Rule(r"hangtime sensor doctor synthetic:", "slow", (("synthetic:swing", "'synthetic:swing?seconds=1'"),)),
    Rule(r"hangtime calibrate ", "slow", (("openni2:", "'synthetic:gentle?seconds=3'"),)),
    Rule(r"hangtime record .*--out twist", "slow",
         (("air_drag'", "air_drag&seconds=3'"), ("demo/swing/", ""), ("--out twist", "--out twisted"))),
    Rule(r"hangtime record .*--out (?:wide|middle)", "slow", (("openni2:", "'synthetic:swing?seconds=3'"), AS_NEW)),
    Rule(r"hangtime record .*--out gentle", "slow", (("openni2:", "'synthetic:gentle?seconds=3'"), AS_NEW)),
    Rule(r"hangtime fit .*--method mocap-swatch", "slow", ((r"$", " --iterations 4 --spacing 0.1"),)),
    Rule(r"hangtime fit .*--method kinect-skirt", "slow", ((r"$", SHORT),)),
    Rule(r"hangtime fit ", "slow", (COARSE,)),
    # Short and weak takes may not decide: everything is written, and the exit code is 4 (docs/reference/exit-codes.md).
    Rule(r"hangtime diagnose ", "slow", ((r"$", " --spacing 0.15"),), ends=(0, 4)),
    Rule(r"hangtime batch takes ", "slow", (("batch takes", "batch demo"), (r"$", " --spacing 0.15 --workers 1"))),
    Rule(r"hangtime blind run ", "slow", ((r"$", ONE_COARSE_CASE),)),
    Rule(r"hangtime blind strike ", "slow", ((r"$", f"{ONE_COARSE_CASE} --least 0"),)),
    Rule(r"hangtime blind (?:score|report) ", "slow"),
    Rule(
        r"hangtime blind make set --cases", "slow", (*FEW_CASES, (r"$", " --side 0.04")),
    ),
)  # fmt: skip


def shown_commands() -> list[tuple[str, str]]:
    """The `hangtime` lines of the shell blocks of every guide page, as (page, command)."""
    found = []
    for page in GUIDE:
        for block in re.findall(r"^ *```sh\n(.*?)^ *```", page.read_text(), re.DOTALL | re.MULTILINE):
            for line in block.replace("\\\n", " ").splitlines():
                text = " ".join(line.split(" # ")[0].split())
                if re.match(r"(?:\w+=\S+ )*(?:\S*/)?hangtime ", text):
                    found.append((name_of(page), text))
    return found


def rule_of(text: str) -> Rule:
    return next(rule for rule in RULES if re.match(rule.pattern, text))


def words_of_command(text: str) -> list[str]:
    """Return the words of a command line after `hangtime`."""
    return shlex.split(re.sub(r"^(?:\w+=\S+ )*\S*hangtime ", "", text))


# --- parsing ------------------------------------------------------------------------------------


@functools.cache
def known_commands() -> dict[tuple[str, ...], tuple[str, Part]]:
    """Every command by its words after `hangtime`, with its whole name; Typer takes 0.2 s to make them."""
    return {tuple(name.split()[1:]): (name, part) for name, part in every_command(whole_command())}


def check_syntax(words: list[str]) -> None:
    """Parse as the command line does, but without asking whether files exist.

    Raises:
        AssertionError: there is no such command, or a required argument is missing.
        Exception: the parser's own, of an unknown option or a missing value.
    """
    known = known_commands()
    path = next((path for path in known if tuple(words[: len(path)]) == path), None)
    assert path is not None, f"no such command: {words}"
    name, part = known[path]
    context = typer.Context(part, info_name=name)
    options, _, _ = part.make_parser(context).parse_args(list(words[len(path) :]))
    if "help" not in options:
        missing = [p.name for p in part.params if p.required and not options.get(p.name)]
        assert missing == [], f"{words} lacks {missing}"


def test_every_command_of_a_page_parses_with_its_options_and_its_required_arguments() -> None:
    shown = shown_commands()
    assert len(shown) > 50
    for page, text in shown:
        try:
            check_syntax(words_of_command(text))
        except Exception as error:  # the parser has several, and each of them is a fault of the page
            pytest.fail(f"{page}: {text}: {error}")


@pytest.mark.parametrize(
    "text",
    ["hangtime fit a.mcap --no-such-option", "hangtime fit --out x", "hangtime fits a.mcap", "hangtime fit a --seed"],
)
def test_a_command_with_one_fault_does_not_parse(text: str) -> None:
    with pytest.raises(Exception, match=r"no-such-option|lacks|no such command|requires an argument"):
        check_syntax(words_of_command(text))


def test_contributing_says_how_many_commands_run() -> None:
    how = Counter(rule_of(text).how for _, text in shown_commands())
    stated = re.search(r"Of (\d+) commands, (\d+) run in the quick tests and (\d+) with `--slow`",
                       " ".join((ROOT / "CONTRIBUTING.md").read_text().split()))  # fmt: skip
    assert stated is not None
    assert [int(n) for n in stated.groups()] == [how.total(), how["quick"], how["slow"]]


def test_every_command_of_a_page_has_a_rule() -> None:
    assert [(page, text) for page, text in shown_commands() if not any(re.match(r.pattern, text) for r in RULES)] == []


# --- running ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the inputs of the pages' commands: descriptions, simulated takes, a fit, marker paths."""
    folder = tmp_path_factory.mktemp("workshop")
    text = (DOCS / "reference/file-formats.md").read_text()
    for name in ("garment", "rig"):
        (block,) = re.findall(rf'```toml\n(format = "hangtime-{name}/1".*?)```', text, re.DOTALL)
        (folder / f"{name}.toml").write_text(block)
    (folder / "demo").mkdir()
    time, garment = np.arange(0, 2.6, 1 / 30), sheet()
    for k, name in enumerate(("swing", "gentle", "other", "mixed", "wide", "middle", "twist")):
        path = twisted(time) if name == "twist" else swing(time, amplitude=0.06, hz=0.6 + 0.05 * k)
        take = simulate_take(
            garment, time, path, material(garment, velocity_damping=3.0), noise=0.002, seed=k, name=name
        )
        write_take(folder / f"{name}.mcap", take)
        if name in ("swing", "gentle", "mixed"):
            write_take(folder / "demo" / f"{name}.mcap", take)
    worn = plain_skirt(0.2)
    write_take(folder / "skirt.mcap", take_of(worn, time, np.zeros((len(time), 3)), hung(worn, time)))
    (folder / "dance.bvh").write_text(bvh_of(walk(3.0)))
    for name, hz in (("swing", 0.7), ("other", 0.9)):
        (folder / f"{name}.csv").write_text(marker_paths(time, hz))
    run(folder, "hangtime swatch other-swatch.toml --mass 0.05 --side 0.5 --markers 9")
    write_recording(folder / "recorded.oni", 20)
    run(folder, "hangtime fit swing.mcap --method si --search annealing --iterations 4 --spacing 0.15 --out results")
    for out in ("demo", "other-results"):
        shutil.copytree(folder / "results", folder / out, dirs_exist_ok=True)
    return folder


def twisted(time: np.ndarray) -> np.ndarray:
    """Displacement of the ends of the sheet's held edge, (frames, 2, 3), that swings 20 degrees about the vertical."""
    angle, half = swing(time, amplitude=np.radians(20.0))[:, 1], np.abs(sheet().outline_m[0][0])
    right = np.stack([half * (np.cos(angle) - 1), half * np.sin(angle), 0 * time], 1)
    return np.stack([-right, right], 1)


def marker_paths(time: np.ndarray, hz: float) -> str:
    """CSV of the 81 markers of a swatch of half a metre that swings as a board."""
    places = {(row, column): (column / 16 - 0.25, -row / 16) for row in range(9) for column in range(9)}
    names = [f"row{row + 1}_column{column + 1}_{axis}_m" for row, column in places for axis in "xyz"]
    lines = [",".join(["time_s", *names])]
    for t in time:
        shift = 0.05 * np.sin(2 * np.pi * hz * t)
        lines.append(",".join(f"{v:.5f}" for v in [t, *(v for x, z in places.values() for v in (x, shift, z))]))
    return "\n".join(lines) + "\n"


def copy_of(workshop: Path, folder: Path) -> Path:
    shutil.copytree(workshop, folder)
    return folder


def run_all(folder: Path, commands: list[Command]) -> None:
    """Run the commands of a page in turn; skip at the end, and say so, where modules of some are not installed."""
    if any("appliance.toml" in one.text for one in commands):
        keep_appliance(folder)
    missing = {name for one in commands for name in one.needs if not is_installed(name)}
    for one in commands:
        if not missing & set(one.needs):
            with surroundings(one.around, folder):
                run(folder, one.text, one.ends)
    if missing:
        left_out = [one.text for one in commands if missing & set(one.needs)]
        pytest.skip(f"{', '.join(sorted(missing))} is not installed; left out: {'; '.join(left_out)}")


def is_installed(name: str) -> bool:
    """Return whether a command's need is met: of `Rule.needs`."""
    if name == OPENNI:
        return openni2.is_available()
    if name == REAL:
        return (SHARED_DATA / "swung-cloth").is_dir()
    if name == BPY:
        return BLENDER.is_installed()
    return bool(os.environ.get(name)) if name.isupper() else importlib.util.find_spec(name) is not None


def run(folder: Path, text: str, ends: tuple[int, ...] = (0,)) -> None:
    """Run a command in this process, in a folder; it must end with one of these exit codes."""
    done = hangtime_here(*words_of_command(text), folder=folder)
    assert done.returncode in ends, f"{text}: {done.stderr}"


@dataclass(frozen=True)
class Command:
    """A command as it is run, the modules that it needs, and what it finds around it."""

    text: str
    needs: tuple[str, ...]
    around: str
    ends: tuple[int, ...]


def runnable(how: tuple[str, ...]) -> dict[str, list[Command]]:
    """Return each page's commands to run, in the page's order, with their reductions."""
    found: dict[str, list[Command]] = {}
    for page, text in shown_commands():
        rule = next((rule for rule in RULES if re.match(rule.pattern, text)), None)
        if rule is not None and rule.how in how:
            small = text
            for before, after in rule.changes:
                small = re.sub(before, after, small)
            found.setdefault(page, []).append(Command(small, rule.needs, rule.around, rule.ends))
    return found


@pytest.mark.parametrize("page", runnable(("quick",)))
def test_the_quick_commands_of_a_page_run_in_its_order(page: str, workshop: Path, tmp_path: Path) -> None:
    run_all(copy_of(workshop, tmp_path / "shop"), runnable(("quick",))[page])


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted(set(runnable(("slow",)))))
def test_all_commands_of_a_page_run_in_its_order_on_small_inputs(page: str, workshop: Path, tmp_path: Path) -> None:
    run_all(copy_of(workshop, tmp_path / "shop"), runnable(("quick", "slow"))[page])


@pytest.mark.parametrize("page", sorted({page for page, _ in shown_commands()}))
def test_a_page_exports_no_fabric_of_a_fit_that_has_none(page):
    """The papers' methods find the weight from motion, and `export` refuses their fabric."""
    commands = [text for of_page, text in shown_commands() if of_page == page]
    if any(re.search(r"hangtime export .*--to (table|usd-physics|newton|mujoco|u3m)", text) for text in commands):
        fitted = [t for t in commands if re.search(r"hangtime fit ", t)]
        assert [t for t in fitted if re.search(r"--method (kinect-skirt|mocap-swatch)(?!-weighed)", t)] == []


def test_the_twist_beside_the_takes_of_the_demo_swings_in_their_air():
    """It was recorded without air, and the misses of the fit were told as what a fit to face-on swings is worth."""
    (air,) = set(re.findall(r"synthesise .*--effect (\w+) ", (ROOT / "scripts" / "demo").read_text()))
    page = (DOCS / "tutorial" / "first-diagnosis.md").read_text()
    recorded = re.findall(r"record --sensor '?synthetic:(\S+?)'? --rig demo/", page)
    assert recorded
    assert all(f"effect={air}" in sensor for sensor in recorded)


def test_every_list_of_commands_fits_its_terminal(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for words in ([], ["takes"], ["sync"], ["sensor"], ["blind"], ["markers"]):
        shown = hangtime_here(*words, "--help", folder=tmp_path).stdout
        assert [line for line in shown.splitlines()[1:] if line.endswith("...")] == []
