"""Client of a simulator in another Python process, which exchanges jobs and answers as .npz files.

The simulator's library is never imported here: it may need another version of Python or of its dependencies. The
program is started once and prints "ready VERSION". It reads the names of job files from its standard input. It answers
each job with the name of a result file (`fit/foreign/workers/answering.py` is its counterpart).
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError

WORKER_FOLDER = Path(__file__).with_name("workers")
READY_LINE = "ready "
# s for a program to end after its last job. Our choice: a program that still runs then hangs. Half and double were
# not tried.
CLOSING_TIME = 10.0


@dataclass(frozen=True)
class Foreign:
    """Installation of a simulator.

    - `name`: as messages name it
    - `module`: Python module that must be importable
    - `extra`: extra of Hangtime that installs the module
    - `variable`: environment variable that names the Python with the module
    - `script`: worker that this Python runs
    """

    name: str
    module: str
    extra: str
    variable: str
    script: Path

    @property
    def python(self) -> str:
        """Absolute path of the Python that should have the module."""
        python = os.environ.get(self.variable) or sys.executable
        return os.path.abspath(python) if os.sep in python else python

    def is_installed(self) -> bool:
        """Return whether this Python has the module."""
        asked = f"import importlib.util, sys; sys.exit(importlib.util.find_spec({self.module!r}) is None)"
        try:
            return subprocess.run([self.python, "-c", asked], capture_output=True).returncode == 0
        except OSError:
            return False

    def absent(self) -> FitError:
        """Return the error with instructions to install the simulator."""
        return FitError(
            f"{self.name}'s Python module {self.module} cannot be started",
            where=self.python,
            advice=f"in Hangtime's checkout: pip install -e '.[{self.extra}]', or set {self.variable} to a Python that "
            f"has {self.module}",
        )


BLENDER = Foreign("Blender", "bpy", "blender", "HANGTIME_BLENDER_PYTHON", WORKER_FOLDER / "blender_worker.py")


class ForeignProcess:
    """A running simulator process, which ends with its owner."""

    def __init__(self, foreign: Foreign) -> None:
        """Start the simulator's process.

        Raises:
            FitError: its Python or its module is not there.
        """
        self.foreign = foreign
        self._folder = tempfile.TemporaryDirectory(prefix=f"hangtime-{foreign.module}-")
        self._log = (Path(self._folder.name) / "log").open("w+")
        try:
            self._process = subprocess.Popen(
                [foreign.python, str(foreign.script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=self._log, text=True, env={**os.environ, "PYTHONPATH": str(WORKER_FOLDER)},
                cwd=self._folder.name,  # simulators write logs where they are started
            )  # fmt: skip
        except OSError as error:
            self._log.close()
            self._folder.cleanup()
            raise foreign.absent() from error
        assert self._process.stdout is not None
        # Lines that a library prints while it is imported come before.
        first = next((line for line in self._process.stdout if line.startswith(READY_LINE)), "")
        if not first:
            raise foreign.absent()
        self.version = first.removeprefix(READY_LINE).strip()

    def answer(self, **job: NDArray[np.generic]) -> dict[str, NDArray[np.generic]]:
        """Return the program's answer to a job as arrays.

        Raises:
            FitError: the program ended before it answered.
        """
        name = Path(self._folder.name) / "job.npz"
        np.savez(name, **job)  # type: ignore[arg-type]
        assert self._process.stdin is not None
        result = ""
        with contextlib.suppress(OSError):  # a process that has ended accepts no input
            self._process.stdin.write(f"{name}\n")
            self._process.stdin.flush()
            result = self._read()
        if not result:
            raise FitError(
                f"{self.foreign.name} ended in the middle of a simulation", where=self._last_words(),
                advice="use a coarser mesh",
            )  # fmt: skip
        with np.load(result) as loaded:
            return {key: loaded[key] for key in loaded.files}

    def _read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def _last_words(self) -> str:
        self._log.seek(0)
        return (self._log.read().strip().splitlines() or [self.foreign.name])[-1]

    def close(self) -> None:
        """End the program and remove its files; a second call does nothing."""
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(timeout=CLOSING_TIME)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        self._log.close()
        self._folder.cleanup()

    def __del__(self) -> None:
        with contextlib.suppress(AttributeError, OSError):
            self.close()
