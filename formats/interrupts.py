"""Ctrl-C where libraries swallow it: while they load, and while they compile.

The start of a native library takes seconds. It swallows an interruption, or takes it for a broken installation: the
interruption waits until the outermost import is done. One that was swallowed otherwise is remembered, and raised again
where the work shows its progress.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import FrameType, ModuleType
from typing import Any


class _Interruption:
    is_met = False


def remember_interruptions() -> None:
    """Remember a Ctrl-C from here on, for `raise_swallowed`; where Python's own handler stands, in the main thread."""
    _Interruption.is_met = False
    is_main = threading.current_thread() is threading.main_thread()
    if is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)


def raise_swallowed() -> None:
    """Interrupt the work where a Ctrl-C was met, and something went on all the same, as Taichi does in a compilation.

    Raises:
        KeyboardInterrupt: there was one.
    """
    if _Interruption.is_met:
        raise KeyboardInterrupt


def _interrupt(number: int, frame: FrameType | None) -> None:
    _Interruption.is_met = True
    signal.default_int_handler(number, frame)


class _Imports(MetaPathFinder):
    """Find modules as Python does; an interruption while one is executed waits until the outermost one is."""

    def __init__(self) -> None:
        self._depth = 0

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where a module is, with a loader that is not interrupted; None where others are to look for it."""
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.loader is None:
            return None
        for step in ("create_module", "exec_module"):
            setattr(spec.loader, step, self._patient(getattr(spec.loader, step)))
        return spec

    def _patient(self, step: Callable[..., Any]) -> Callable[..., Any]:
        def patient(*arguments: Any) -> Any:
            if self._depth or threading.current_thread() is not threading.main_thread():
                return step(*arguments)
            self._depth += 1
            try:
                with held():
                    return step(*arguments)
            finally:
                self._depth -= 1

        return patient


@contextmanager
def held() -> Iterator[None]:
    """Inside, Ctrl-C is only noted; at the end its former handler runs. For the main thread.

    Raises:
        KeyboardInterrupt: somebody interrupted, and nothing else handles that.
    """
    before = signal.getsignal(signal.SIGINT)
    if not callable(before):  # ignored, or left to the system
        yield
        return
    noted = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal noted
        noted = True

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is note:  # a library may have its own by now
            signal.signal(signal.SIGINT, before)
        if noted:
            before(signal.SIGINT, None)


def hold_while_importing() -> None:
    """Let Ctrl-C wait for imports from here on, in the whole process; asking again does nothing."""
    if not any(isinstance(finder, _Imports) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Imports())
