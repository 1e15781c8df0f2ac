"""`python -m capture.sync run`: the process that systemd starts; it logs to the journal and needs no Typer."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from capture.sync.process import EXIT_CODES, start
from capture.sync.settings import DEFAULT_FILE


def main() -> int:
    """Run sync until nothing waits; returns an exit code of `capture.sync.process`."""
    words = argparse.ArgumentParser(prog="python -m capture.sync", description=__doc__, epilog=EXIT_CODES)
    words.add_argument("command", choices=["run", "now", "prove"], help="run: until nothing waits; now: one round")
    words.add_argument("--config", type=Path, default=DEFAULT_FILE, metavar="FILE", help="the appliance's file")
    words.add_argument("--spool", type=Path, metavar="DIR", help="the folder of takes, instead of the file's")
    options = words.parse_args()
    return start(options.command, options.config, options.spool)


if __name__ == "__main__":
    sys.exit(main())
