"""Handle Ctrl-C in spite of libraries that swallow it while they load or compile.

A native library takes seconds to load. It may swallow an interruption, or report it as a broken installation. So an
interruption waits until the outermost import is complete. An interruption that was swallowed otherwise is remembered,
and raised again where the work shows its progress.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import FrameType, ModuleType
from typing import Any

ENDING = (signal.SIGTERM, signal.SIGHUP)  # signals that end a command from outside


class _Interruption:
    is_met = False


def remember_interruptions() -> None:
    """From now on, remember a Ctrl-C for `raise_swallowed`.

    This has an effect only in the main thread, and only where Python's own handler is active.
    """
    _Interruption.is_met = False
    is_main = threading.current_thread() is threading.main_thread()
    if is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)


def raise_swallowed() -> None:
    """Raise the interruption that a library swallowed, such as Taichi during compilation.

    Only the main thread receives interruptions. So the work of other threads goes on.

    Raises:
        KeyboardInterrupt: there was one.
    """
    if _Interruption.is_met and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt


def forget_interruption() -> None:
    """Forget a Ctrl-C that has ended its work, so that it does not end the next."""
    _Interruption.is_met = False


def end_undisturbed() -> None:
    """From now on, while the process ends, ignore one Ctrl-C; the system's default action follows for a second one.

    Libraries still do short work then, such as keeping compiled kernels. An interruption would print their stack.
    """

    def ignore(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    if callable(signal.getsignal(signal.SIGINT)):  # a shell ignores Ctrl-C for a command in the background
        signal.signal(signal.SIGINT, ignore)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _Interruption.is_met = True
    signal.default_int_handler(number, frame)


class _Imports(MetaPathFinder):
    """An import finder that delays interruptions until the outermost running import is complete."""

    def __init__(self) -> None:
        self._depth = 0

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return a module's spec with a loader that is not interrupted; None where other finders are to look."""
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
    """Within the block, only note Ctrl-C, SIGTERM and SIGHUP; at the end, call their former handlers.

    A signal that is ignored or left to the system stays so. For the main thread.

    Raises:
        KeyboardInterrupt: there was an interruption, and no other handler.
    """
    before = {one: handler for one in (*ENDING, signal.SIGINT) if callable(handler := signal.getsignal(one))}
    noted: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        if number not in noted:
            noted.append(number)

    for one in before:
        signal.signal(one, note)
    try:
        yield
    finally:
        for one, handler in before.items():
            if signal.getsignal(one) is note:  # a library may have its own by now
                signal.signal(one, handler)
        for number in noted:
            before[signal.Signals(number)](number, None)


@contextmanager
def handled(signals: Iterable[signal.Signals], handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Within the block, call a handler on these signals; at the end, their former handlers come back.

    A signal that is already ignored, as SIGHUP under `nohup`, stays ignored. Only the main thread receives signals; in
    other threads the context does nothing.
    """
    is_main = threading.current_thread() is threading.main_thread()
    before = {one: signal.getsignal(one) for one in signals if is_main}
    before = {one: former for one, former in before.items() if former not in (signal.SIG_IGN, None)}
    for one in before:
        signal.signal(one, handler)
    try:
        yield
    finally:
        for one, former in before.items():
            signal.signal(one, former)


@contextmanager
def ended_like_ctrl_c() -> Iterator[None]:
    """Within the block, the first SIGTERM or SIGHUP has the effect of Ctrl-C; the next ones do nothing.

    The end of a login sends both. `handled` tells which signals it leaves alone.
    """
    is_asked = False

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal is_asked
        if is_asked:
            return
        is_asked = True
        if callable(signal.getsignal(signal.SIGINT)):
            signal.raise_signal(signal.SIGINT)
        else:  # a shell ignores Ctrl-C for a command in the background
            raise KeyboardInterrupt

    with handled(ENDING, stop):
        yield


def hold_while_importing() -> None:
    """From now on, delay Ctrl-C until imports are complete, in the whole process; further calls change nothing."""
    if not any(isinstance(finder, _Imports) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Imports())
