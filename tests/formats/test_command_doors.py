"""The command's own doors: which commands it builds, under which name, and which missing library is whose fault."""

from __future__ import annotations

import json
import sys

import pytest

from formats import command
from formats.command import app, whole
from tests.fit.here import hangtime_here


@pytest.fixture
def added():
    """A command that another package adds without a name of its own, as Typer lets it."""
    command.gather_commands()
    before = list(app.registered_commands)

    @app.command()
    def say_hello() -> None:
        """Say hello."""
        print("hello")

    yield "say-hello"
    app.registered_commands[:] = before


def test_a_command_named_by_its_function_is_built_alone_and_runs(added, monkeypatch, tmp_path):
    alone = whole(added)
    assert sorted(getattr(alone, "commands", {})) == [added]
    done = hangtime_here(added, folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "hello\n")


@pytest.mark.parametrize("package", ["", "formats", "firmware_host", "capture", "fit"])
@pytest.mark.parametrize("ending", ["", ".cli", ".deep.module"])
def test_a_module_of_our_own_that_is_missing_is_no_users_error(package, ending):
    """The traceback names the fault of the program."""
    name = f"{package}{ending}" if package else None
    assert command._spoken(ModuleNotFoundError(name=name)) is None


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("cv2.aruco", "cv2 is not installed; in Hangtime's checkout: pip install -e '.[capture]'"),
        ("PIL", "PIL is not installed; in Hangtime's checkout: pip install -e '.[export]'"),
        ("rerun", "rerun is not installed; in Hangtime's checkout: pip install -e '.[rerun]'"),
        ("pxr.Usd", "pxr is not installed; in Hangtime's checkout: pip install -e '.[export]'"),
        ("usb", "usb is not installed; in Hangtime's checkout: pip install -e '.[capture]'"),
        ("bokeh", "bokeh is not installed; in Hangtime's checkout: pip install -e '.[batch]'"),
        ("numpy", "numpy is not installed; in Hangtime's checkout: scripts/setup"),
        ("FORMATS", "FORMATS is not installed; in Hangtime's checkout: scripts/setup"),
    ],
)
def test_a_missing_library_is_named_with_the_extra_that_installs_it(name, told):
    assert str(command._spoken(ModuleNotFoundError(name=name))) == told


@pytest.mark.parametrize("program", ["/usr/lib/hangtime/__main__.py", "hangtime.exe"])
def test_the_help_names_the_command_however_it_was_started(program, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [program, "takes", "verify"])
    monkeypatch.setattr(command, "take_streams", lambda: None)
    with pytest.raises(SystemExit) as end:
        command.main()
    assert end.value.code == 2
    assert "hangtime takes verify" in capsys.readouterr().err


def test_a_shell_that_asks_for_completions_gets_those_of_every_command(monkeypatch, capsys):
    """Of which it knows no first word yet: `hangtime ta` begins the name of one."""
    monkeypatch.setenv(command.WORDS_ASKED, "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "hangtime ta")
    monkeypatch.setenv("COMP_CWORD", "1")
    monkeypatch.setattr(sys, "argv", ["hangtime", "swatch"])
    monkeypatch.setattr(command, "take_streams", lambda: None)
    with pytest.raises(SystemExit):
        command.main()
    assert capsys.readouterr().out.split() == ["takes"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("takes", "list", "--nope", "--json"), "No such option: --nope"),
        (("takes", "show", "--json"), "Missing argument 'TAKE'"),
        (("takes", "nope", "--json"), "No such command 'nope'."),
    ],
)
def test_a_wrong_use_is_one_sentence_in_the_document_too(words, sentence, tmp_path):
    done = hangtime_here(*words, folder=tmp_path)
    assert done.returncode == 2
    assert json.loads(done.stdout)["error"].startswith(sentence)
    assert sentence in done.stderr
