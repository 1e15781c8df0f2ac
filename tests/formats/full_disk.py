"""A disk that takes no more, for as long as a test wants."""

from __future__ import annotations

import resource
import signal
import sys
from contextlib import contextmanager


@contextmanager
def no_file_beyond(count):
    """Limit the size of files that this process writes; a larger file raises EFBIG."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    compiled, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # what Python compiles would be cut as well
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # LLVM, once Taichi has started, ends the process on it
    resource.setrlimit(resource.RLIMIT_FSIZE, (count, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        sys.dont_write_bytecode = compiled
        signal.signal(signal.SIGXFSZ, before or signal.SIG_IGN)
