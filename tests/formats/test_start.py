"""The command's first lines: Ctrl-C while its libraries load ends it in one line, by a shell's exit code."""

from __future__ import annotations

import os
import signal
import sys
from importlib.abc import MetaPathFinder

import pytest

from formats.start import main


class _Interrupting(MetaPathFinder):
    """An import finder that Ctrl-C meets at one module."""

    def find_spec(self, fullname, path, target=None):
        if fullname == "formats.interrupts":
            raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def handler():
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def interrupted(monkeypatch):
    """Ctrl-C comes while the first of the command's modules loads."""
    monkeypatch.delitem(sys.modules, "formats.interrupts", raising=False)
    monkeypatch.setattr(sys, "meta_path", [_Interrupting(), *sys.meta_path])


def test_an_interruption_during_the_imports_is_told_in_one_line(interrupted, capfd):
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130
    assert capfd.readouterr() == ("", "Interrupted.\n")


def test_an_interruption_where_stderr_is_closed_ends_by_the_same_code(interrupted):
    kept = os.dup(2)
    os.close(2)
    try:
        with pytest.raises(SystemExit) as end:
            main()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
    assert end.value.code == 130


def test_without_an_interruption_the_command_runs(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["hangtime", "--version"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    assert capsys.readouterr().out.startswith("hangtime ")
