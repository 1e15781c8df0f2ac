"""The cost of reading files, each in a process of its own: a server that forks, so that imports are paid once.

Run: python -m tests.formats.measured; each line of the input is a JSON list: the reader's name, a file, and a small
file to read first, or null.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from firmware_host.oni_records import summarise
from formats.archive import read_with_report
from formats.descriptions import load_garment, load_rig
from formats.errors import HangtimeError
from formats.importers.marker_files import read_marker_tracks
from formats.results import load_result
from formats.toml_files import read_toml

READERS: dict[str, Callable[[Path], object]] = {
    "take": read_with_report, "toml": read_toml, "markers": read_marker_tracks, "result": load_result,
    "garment": load_garment, "rig": load_rig, "oni": summarise,
}  # fmt: skip


def measured(reader: str, path: Path) -> dict[str, object]:
    """Return the additional memory [MB] and processor time [s] of a call, and its output."""
    before, start, found = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time(), {}
    try:
        read = READERS[reader](path)
        said = ""
        if reader == "take":
            report = read[1]
            found = {"frames": report.frames, "is_sound": report.is_sound}
    except HangtimeError as error:
        said = str(error)
    except Exception as error:
        said = f"TRACEBACK {error!r}"
    seconds = time.process_time() - start
    most = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return {"megabytes": round(most, 1), "seconds": round(seconds, 3), "said": said, **found}


class MeasuredReading:
    """The server in a process of its own: it has one thread, and so it can fork."""

    def __enter__(self) -> Self:
        words = [sys.executable, "-m", "tests.formats.measured"]
        self._server = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        return self

    def __call__(self, reader: str, path: Path, after: Path | None = None) -> dict[str, Any]:
        """Read a file; return as `measured`.

        after: a small file that the same process reads before, uncounted. It brings the pages of libraries into memory,
        which are 3 to 9 MB by how the disk's cache holds them.
        """
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        self._server.stdin.write(json.dumps([reader, str(path), str(after) if after else None]) + "\n")
        self._server.stdin.flush()
        return dict(json.loads(self._server.stdout.readline()))

    def __exit__(self, *_: object) -> None:
        self._server.communicate()


def main() -> None:
    """Answer line by line."""
    for line in sys.stdin:
        reader, name, before = json.loads(line)
        child = os.fork()
        if child == 0:
            if before is not None:
                READERS[reader](Path(before))
            sys.stdout.write(json.dumps(measured(reader, Path(name))) + "\n")
            sys.stdout.flush()
            os._exit(0)
        os.waitpid(child, 0)


if __name__ == "__main__":
    main()
