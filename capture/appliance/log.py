"""Log lines for journald: `<N>` before each states its priority (`man 3 sd-daemon`)."""

from __future__ import annotations

import logging
import os
import sys

LOG = logging.getLogger("hangtime")
# Priorities of syslog(3), which sd-daemon(3) reads.
PRIORITY = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}


class _Journal(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return f"<{PRIORITY.get(record.levelno, 5)}>" + super().format(record).replace("\n", " ")


def log_to_stderr() -> None:
    """Send the log to stderr, with priorities where journald reads it."""
    handler = logging.StreamHandler(sys.stderr)
    kind = _Journal if "JOURNAL_STREAM" in os.environ else logging.Formatter
    handler.setFormatter(kind("%(message)s"))
    LOG.handlers[:] = [handler]
    LOG.setLevel(logging.INFO)
    LOG.propagate = False
