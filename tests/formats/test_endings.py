"""The command's output and exit code on a full disk, without a library, with closed streams, and on interruption."""

from __future__ import annotations

import os
import resource
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import formats.command
from formats.archive import write_take
from formats.results import save_diagnosis
from tests.formats.test_archive import a_take
from tests.formats.test_results import diagnosis

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", "formats.command"]
SAVES = """
from pathlib import Path
from formats.command import app, main
from formats.results import save_diagnosis
from tests.formats.test_results import diagnosis

@app.command("save")
def save(folder: Path) -> None:
    save_diagnosis(folder / "diagnosis.json", diagnosis())

main()
"""
INTERRUPTED = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
from formats.command import main
module = sys.argv.pop(1)
sys.addaudithook(lambda name, about: name == "import" and about[0] == module and os.kill(os.getpid(), 2))
main()
"""
WITHOUT = """
import platform, sys
sys.modules.update(dict.fromkeys(["cv2", "openni", "scipy", "taichi", "usb"]))  # none of them can be imported
machine = sys.argv.pop(1)
platform.machine = lambda: machine
from formats.command import main
main()
"""


def run(program, *words, **options):
    """Run a program in Python, from the checkout; it keeps nothing compiled, which a full disk would cut."""
    words = [sys.executable, "-B", "-c", program, *map(str, words)]
    return subprocess.run(words, capture_output=True, text=True, cwd=ROOT, **options)


def at_most(count):
    """Limit the size of files that a process writes; Python ignores the signal and raises EFBIG."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (count, count))


def test_a_full_disk_is_one_sentence_that_names_the_file_and_leaves_what_was_there(tmp_path):
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis())
    before = (tmp_path / "diagnosis.json").read_bytes()
    done = run(SAVES, "save", tmp_path, preexec_fn=at_most(100))
    assert done.returncode == 2
    assert done.stderr.startswith(
        f"hangtime: {tmp_path}/diagnosis.json: cannot be written (File too large); raise the limit"
    )
    assert "whole files stay" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert (tmp_path / "diagnosis.json").read_bytes() == before
    assert os.listdir(tmp_path) == ["diagnosis.json"]


@pytest.mark.slow
def test_a_file_where_a_folder_should_be_is_one_sentence(tmp_path):
    (tmp_path / "a").touch()
    done = run(SAVES, "save", tmp_path / "a")
    assert done.returncode == 2
    assert done.stderr.startswith(f"hangtime: {tmp_path}/a: cannot be used (File exists); check the path")


@pytest.mark.parametrize(
    ("where", "code"),
    [
        (">/dev/full", 2), (">/dev/full 2>&-", 2), ("| true", 141),
        *(pytest.param(one, 0, marks=pytest.mark.slow) for one in (">&-", "2>&-")),
    ],
)  # fmt: skip
def test_output_that_nobody_can_take_gives_no_traceback(tmp_path, where, code):
    words = shlex.join([*COMMAND, "takes", "show", str(write_take(tmp_path / "a.mcap", a_take()))])
    done = subprocess.run(
        ["bash", "-c", f"{words} {where}; exit ${{PIPESTATUS[0]}}"], capture_output=True, text=True
    )  # fmt: skip
    assert done.returncode == code
    assert len(done.stderr.splitlines()) == (where == ">/dev/full")


@pytest.mark.parametrize("where", ["2>/dev/full", "2>&-", "2>&1 >/dev/null | true"])
def test_printed_messages_end_no_work(tmp_path, where):
    said = "from formats.terminal import say; say(9 * 'half done'); say('done'); open('kept', 'w')"
    subprocess.run(["bash", "-c", f"{shlex.join([sys.executable, '-c', said])} {where}"], check=True, cwd=tmp_path)
    assert (tmp_path / "kept").exists()


def test_ctrl_c_before_the_commands_are_there_is_obeyed_and_said():
    done = run(INTERRUPTED, "fit.batch.cli")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "Interrupted.\n")


def test_ctrl_c_while_a_library_starts_is_obeyed_afterwards(tmp_path):
    """Taichi's native start takes an interruption for a broken installation, within milliseconds that no test meets.

    The library here does the same and meets them always.
    """
    (tmp_path / "taichi.py").write_text(
        "import os, signal\n"
        "try:\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "except KeyboardInterrupt:\n"
        "    raise ImportError('initialization failed') from None\n"
    )
    done = run(f"import sys\nsys.path.insert(0, {str(tmp_path)!r}){INTERRUPTED}", "none", "fit", "README.md")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "Interrupted.\n")


@pytest.mark.parametrize(
    ("machine", "words", "said"),
    [
        ("x86_64", ["fit", "README.md"], "taichi is not installed; in Hangtime's checkout: pip install -e '.[fit]'"),
        pytest.param(
            "x86_64", ["batch", "."], "taichi is not installed; in Hangtime's checkout: pip install -e '.[fit]'",
            marks=pytest.mark.slow,
        ),
        ("x86_64", ["markers", "print"], "cv2 is not installed; in Hangtime's checkout: pip install -e '.[capture]'"),
        (
            "aarch64", ["fit", "README.md"],
            "taichi is not installed; Taichi has no package for Linux on aarch64: this computer records takes but "
            "cannot fit them",
        ),
    ],
)  # fmt: skip
@pytest.mark.skipif(sys.platform != "linux", reason="Taichi's packages differ elsewhere")
def test_a_command_whose_library_is_not_installed_says_in_one_sentence_how_to_get_it(machine, words, said):
    done = run(WITHOUT, machine, *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"hangtime: {said}\n"


def test_an_extra_for_developers_is_named_only_where_no_other_has_the_library(monkeypatch):
    """The packages' own lists are sorted by name, so that `dev` comes before `parquet`."""
    listed = [f"pyarrow>=17; extra == '{extra}'" for extra in ("dev", "docs", "parquet")] + [
        "ruff>=0.9; extra == 'dev'"
    ]
    monkeypatch.setattr(formats.command, "requires", lambda name: listed)
    missing = [formats.command._spoken(ModuleNotFoundError(name=name)).advice for name in ("pyarrow", "ruff")]
    assert missing == [f"in Hangtime's checkout: pip install -e '.[{extra}]'" for extra in ("parquet", "dev")]


def test_help_lists_every_command_where_their_libraries_are_not_installed():
    done = run(WITHOUT, "x86_64", "--help")
    assert done.returncode == 0
    for command in ("fit", "batch", "record", "markers", "sensor", "takes"):
        assert f"  {command} " in done.stdout


def test_a_module_of_our_own_that_is_missing_is_a_fault_of_the_program():
    done = run("import sys; sys.modules['capture.hanger.fiducial_tracker'] = None\n"
               "from formats.command import main; main()",
               "record", "--sensor=synthetic:swing", "--rig=r", "--garment=g", "--out=a.mcap")  # fmt: skip
    assert done.returncode == 1
    assert "ModuleNotFoundError: import of capture.hanger.fiducial_tracker halted" in done.stderr
