"""What holds for the repository as a whole: import rules, texts, scripts, device rules."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import typer

from docs.generator.commands import whole_command

ROOT = Path(__file__).parent.parent
PACKAGES = ("formats", "firmware_host", "capture", "fit", "hangtime")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
SCRIPTS = [*sorted((ROOT / "scripts").iterdir()), ROOT / ".ci/run"]
SUFFIXES = {"", ".md", ".toml", ".py", ".js", ".css", ".html", ".json", ".rules", ".conf"}
FOLDERS = (*PACKAGES, "docs", "benchmarks", "scripts", "systemd", "tests")
TEXTS = [
    path
    for path in [*ROOT.glob("*.*"), ROOT / ".ci/run", *(p for folder in FOLDERS for p in (ROOT / folder).rglob("*"))]
    if path.is_file() and path.suffix in SUFFIXES and path.name != ".git"
    if not any(part == "__pycache__" or part.endswith("_cache") for part in path.parts)
]

# package: what of ours and of the large libraries its modules may import
MAY_IMPORT = {
    "formats": {"formats"},
    "firmware_host": {"formats", "firmware_host", "openni", "usb"},
    "capture": {"formats", "firmware_host", "capture", "cv2"},
    "fit": {"formats", "fit", "scipy", "taichi"},
    "hangtime": {"formats", "fit", "hangtime"},
}
GUARDED = set().union(*MAY_IMPORT.values())


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def imports(path: Path) -> set[str]:
    """First parts of the names that a module imports, at any depth of its code."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.split(".")[0])
    return found


def ruff_on(path: str, statement: str) -> str:
    """What ruff says of a module at this place that holds this statement."""
    ruff = [sys.executable, "-m", "ruff", "check", "--no-cache", "--select", "TID251", "--output-format", "concise"]
    code = f'"""A module."""\n\n{statement}\n'
    done = subprocess.run(
        [*ruff, "--stdin-filename", path, "-"], input=code, capture_output=True, text=True, cwd=ROOT, check=False
    )
    return done.stdout + done.stderr


# --- imports ------------------------------------------------------------------------------------


@pytest.mark.parametrize("package", PACKAGES)
def test_ruff_refuses_each_import_that_a_package_may_not_have(package: str) -> None:
    for guarded in [*sorted(GUARDED - MAY_IMPORT[package]), "typer"]:
        said = ruff_on(f"{package}/example.py", f"import {guarded}")
        assert "TID251" in said, f"{package} may import {guarded}: {said}"
    foreign = (
        "from capture.hanger.fiducial_tracker import find_markers"
        if package in {"fit", "hangtime"}
        else "from fit.cloth import mesh"
    )
    assert "TID251" in ruff_on(f"{package}/deeper/example.py", foreign)


@pytest.mark.parametrize("package", PACKAGES)
def test_ruff_allows_each_import_that_a_package_needs(package: str) -> None:
    allowed = "\n".join(f"import {name}" for name in sorted(MAY_IMPORT[package]))
    assert "TID251" not in ruff_on(f"{package}/example.py", allowed)


@pytest.mark.parametrize("module", MODULES, ids=name_of)
def test_every_module_imports_only_what_its_package_may(module: Path) -> None:
    """Ruff lets command-line modules off this rule because they import Typer; this does not."""
    package = name_of(module).split("/")[0]
    assert imports(module) & GUARDED <= MAY_IMPORT[package]
    if not module.name.endswith("cli.py") and name_of(module) not in (
        "formats/anyway.py",
        "formats/command.py",
        "formats/command_groups.py",
    ):
        assert "typer" not in imports(module)


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run import-linter with the rules of pyproject.toml on the packages of a folder."""
    linter = Path(sys.executable).with_name("lint-imports")
    there = {**os.environ, "PYTHONPATH": str(folder)}
    return subprocess.run([linter, "--no-cache"], cwd=folder, env=there, capture_output=True, text=True, check=False)


def test_every_room_imports_only_from_rooms_below_it() -> None:
    done = lint_imports(ROOT)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("module", "statement", "broken"),
    [
        ("fit/cloth/model.py", "from fit.gap import verdict", "Rooms of fit BROKEN"),
        ("fit/cloth/model.py", "from fit.cloth import launch", "A cloth's model never runs BROKEN"),
        ("fit/observer/edge.py", "from fit.observer import residuals", "No circles between modules of one room BROKEN"),
        ("capture/hanger/pose.py", "from capture.recording import session", "Rooms of capture BROKEN"),
        ("firmware_host/lamp.py", "from firmware_host import opening", "Rooms of firmware_host BROKEN"),
        ("fit/stray.py", "", "Rooms of fit BROKEN"),
    ],
)
def test_an_import_against_the_rules_of_the_rooms_is_refused(
    module: str, statement: str, broken: str, tmp_path: Path
) -> None:
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    path = tmp_path / module
    path.write_text((path.read_text() if path.exists() else '"""Stray."""\n') + f"\n{statement}\n")
    done = lint_imports(tmp_path)
    assert done.returncode == 1
    assert broken in done.stdout


def test_help_loads_none_of_the_four_heavy_libraries() -> None:
    code = """
        import sys
        sys.argv = ["hangtime", "--help"]
        from formats.command import main
        try:
            main()
        except SystemExit:
            pass
        print("loaded:", sorted({"cv2", "openni", "scipy", "taichi"} & set(sys.modules)))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert "diagnose" in done.stdout
    assert "loaded: []" in done.stdout


@pytest.mark.parametrize("benchmark", sorted((ROOT / "benchmarks").glob("*.py")), ids=name_of)
def test_what_a_benchmark_imports_from_us_is_there(benchmark: Path) -> None:
    wanted = [
        (node.module, alias.name)
        for node in ast.walk(ast.parse(benchmark.read_text()))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in {*PACKAGES, "tests"}
        for alias in node.names
    ]
    missing = []
    for module, name in wanted:
        if not hasattr(importlib.import_module(module), name):
            try:
                importlib.import_module(f"{module}.{name}")
            except ImportError:
                missing.append(f"{module}.{name}")
    assert missing == []


# --- modules and texts --------------------------------------------------------------------------


@pytest.mark.parametrize("module", [*MODULES, *sorted((ROOT / "benchmarks").glob("*.py"))], ids=name_of)
def test_every_module_says_what_it_is_for_and_stays_below_400_lines(module: Path) -> None:
    text = module.read_text()
    assert ast.get_docstring(ast.parse(text))
    assert text.count("\n") <= 400
    assert not {"utils", "common", "helpers", "misc"} & set(module.with_suffix("").parts)


def test_no_text_names_a_folder_of_somebodys_own_machine_or_a_package_index() -> None:
    private = re.compile(r"(?<![\w.$}])/(?:home|root|work|Users)/\w|index-url|\bpypi\.\w+", re.IGNORECASE)
    found = [
        f"{name_of(path)}: {match.group()}"
        for path in TEXTS
        if path != Path(__file__)
        for match in private.finditer(path.read_text())
    ]
    assert found == []


def test_every_link_to_a_file_leads_to_a_file() -> None:
    dead = [
        f"{name_of(path)}: {target}"
        for path in TEXTS
        if path.suffix == ".md"
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", path.read_text())
        if "://" not in target and not (path.parent / target).exists()
    ]
    assert dead == []


OURS = re.compile(r"(?:\w+=\S+ |sudo .* )*(?:\S*/)?hangtime (.+)")
PROGRAM = re.compile(r"(?:\w+=\S+ )*(?:\S*python3? )?((?:scripts|benchmarks)/\w[\w.]*|\.ci/run|\w+\.py)( .+)?")
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
# What texts say of other people's programs: in a line that begins with their name, or an option by itself.
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
    for path in TEXTS:
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
    """Long options that a script's `case` or a benchmark's parser names; those of another script that it hands on."""
    if path == ROOT / ".ci/run":
        return options_of_program(ROOT / "scripts/test")
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


# --- scripts ------------------------------------------------------------------------------------


@pytest.mark.parametrize("script", SCRIPTS, ids=name_of)
def test_every_script_is_plain_posix_shell(script: Path) -> None:
    assert script.read_text().startswith("#!/bin/sh\n")
    assert os.access(script, os.X_OK)
    subprocess.run(["sh", "-n", script], check=True)
    if shutil.which("shellcheck"):
        subprocess.run(["shellcheck", script], check=True)


@pytest.mark.parametrize("script", sorted((ROOT / "scripts").iterdir()), ids=name_of)
def test_every_script_explains_itself_without_setting_anything_up(script: Path, tmp_path: Path) -> None:
    copy = tmp_path / "scripts" / script.name
    copy.parent.mkdir()
    shutil.copy(script, copy)
    done = subprocess.run([copy, "--help"], capture_output=True, text=True, check=True)
    assert f"Usage: scripts/{script.name}" in done.stdout
    assert sorted(tmp_path.rglob("*")) == [copy.parent, copy]


def run_setup(folder: Path, pythons: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run scripts/setup where only these Pythons exist, with neither apt-get nor sudo."""
    programs = folder / "programs"
    programs.mkdir()
    for name in ("cat", "cksum", "cmp", "dirname", "env", "head", "id", "mkdir", "rm", "sleep", "uname"):
        found = shutil.which(name)
        assert found
        (programs / name).symlink_to(found)
    for name, text in pythons.items():
        (programs / name).write_text(f"#!/bin/sh\n{text}\n")
        (programs / name).chmod(0o755)
    (folder / "scripts").mkdir()
    shutil.copy(ROOT / "scripts/setup", folder / "scripts")
    shutil.copy(ROOT / "pyproject.toml", folder)
    return subprocess.run(
        ["/bin/sh", folder / "scripts/setup"], env={"PATH": str(programs)}, capture_output=True, text=True, check=False
    )


def test_setup_names_the_three_pythons_it_needs_when_there_is_none(tmp_path: Path) -> None:
    done = run_setup(tmp_path, {"python3": "exit 1"})
    assert done.returncode == 1
    assert "no Python 3.11, 3.12 or 3.13 on PATH" in done.stderr
    assert not (tmp_path / ".venv").exists()


def test_setup_names_the_one_debian_package_that_a_python_without_ensurepip_needs(tmp_path: Path) -> None:
    without = f'case "$*" in *ensurepip* | *"-m pip"*) exit 1 ;; esac\nexec {sys.executable} "$@"'
    done = run_setup(tmp_path, {"python3": without})
    assert done.returncode == 1
    assert f"sudo apt-get install python{sys.version_info[0]}.{sys.version_info[1]}-venv" in done.stderr
    assert not (tmp_path / ".venv").exists()


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


# --- device rules -------------------------------------------------------------------------------


def device_rules(path: Path) -> list[dict[str, str]]:
    """The rules of a udev file that name a product, each as key to value."""
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    pairs = [dict(re.findall(r'([A-Z]+(?:\{\w+\})?)(?:==|!=|\+=|:=|=)"([^"]*)"', line)) for line in lines]
    return [rule for rule in pairs if "ATTR{idProduct}" in rule]


def test_the_sensor_rules_win_over_debians_number_60_and_open_no_device_to_everybody() -> None:
    path = ROOT / "systemd/udev/55-hangtime-depth-sensor.rules"
    assert int(path.name.split("-")[0]) < 60
    for rule in device_rules(path):
        assert (rule["MODE"], rule["GROUP"], rule["TAG"]) == ("0660", "plugdev", "uaccess")
    assert path.read_text().count('MODE:="0660"') == len(device_rules(path)) >= 3


def test_the_sensor_rules_cover_every_device_that_debian_opens_to_everybody() -> None:
    debian = Path("/usr/lib/udev/rules.d/60-libopenni2-0.rules")
    if not debian.exists():
        debian = Path("/lib/udev/rules.d/60-libopenni2-0.rules")
    if not debian.exists():
        pytest.skip("libopenni2-0 is not installed")
    path = ROOT / "systemd/udev/55-hangtime-depth-sensor.rules"
    ours = {(r["ATTR{idVendor}"], p) for r in device_rules(path) for p in r["ATTR{idProduct}"].split("|")}
    theirs = {(r["ATTR{idVendor}"], r["ATTR{idProduct}"]) for r in device_rules(debian)}
    assert len(theirs) >= 10
    assert theirs <= ours


def test_systemd_folder_is_no_python_package() -> None:
    assert not list((ROOT / "systemd").rglob("*.py"))
