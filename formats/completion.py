"""Choose the shell for command completion: the running shell, or the user's login shell where the former has none."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from formats.errors import HangtimeError

COMPLETED = ("bash", "zsh", "fish", "powershell", "pwsh")  # shells that Typer completes in
COMPLETION_OPTIONS = {"--show-completion", "--install-completion"}


def choose_shell() -> None:
    """Make Typer's two completion options use a shell that Typer knows.

    Typer asks shellingham for the shell that runs the command, and fails on a plain `sh`. A script's shell has no
    completion, but the user's shell may have it. `$SHELL` names the user's shell.
    """
    if not COMPLETION_OPTIONS & set(sys.argv[1:]):
        return
    import shellingham

    detect = shellingham.detect_shell

    def known() -> tuple[str, str]:
        own = os.environ.get("SHELL", "")
        try:
            running = detect()
        except shellingham.ShellDetectionFailure:
            running = ("", "")
        for name, program in (running, (Path(own).name, own)):
            if name in COMPLETED:
                return name, program
        found = running[0] or Path(own).name or "no shell"
        raise HangtimeError(
            f"bash, zsh, fish and PowerShell complete commands, and this is {found}",
            where=None,
            advice="run the command in one of these, or set SHELL to one",
        )

    shellingham.detect_shell = known
