"""Show the progress of a call as its command does, and end a call by Ctrl-C in one sentence."""

from __future__ import annotations

import contextlib
import functools
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from fit.api.turns import own_turn, paused
from fit.errors import FitError
from formats.interrupts import forget_interruption, raise_swallowed, remember_interruptions
from formats.terminal import ProgressLine, is_displayed

if TYPE_CHECKING:
    from fit.identification.request import Request

FitProgress = Callable[[int, int, float], None]
StageProgress = Callable[[str, float], None]
_Call = TypeVar("_Call", bound=Callable[..., object])


def fit_words(request: Request, done: int, total: int, best: float) -> str:
    """Return the words of a fit's progress: the least error so far, and the steps."""
    from fit.search.choice import OBSERVED

    error = f"{1e3 * best:.1f} mm mean distance" if request.method.is_in_metres else f"E/N {best:.3f}"
    count = f"step {done} of at most {total}" if request.search in OBSERVED else f"{done}/{total}"
    return f"{error} on fitted takes, {count}"


def check_progress(progress: object) -> None:
    """Refuse a progress that is neither a function nor True, False or None.

    Raises:
        FitError: names the argument.
    """
    if progress is not None and not isinstance(progress, bool) and not callable(progress):
        raise FitError("cannot be called", where="progress", advice="give a function, True or False")


@contextlib.contextmanager
def fit_shown(progress: FitProgress | bool | None, request: Request) -> Iterator[FitProgress]:
    """Yield what receives a fit's progress: the caller's function, a line where somebody sees it, or nothing."""
    if callable(progress):
        yield paused(progress)
        return
    with _line(request.search, is_wanted=progress is not False) as line:

        def show(done: int, total: int, best: float) -> None:
            raise_swallowed()
            if line is not None:
                line.show(done / total, fit_words(request, done, total, best))

        yield show


@contextlib.contextmanager
def diagnosis_shown(progress: StageProgress | bool | None) -> Iterator[StageProgress]:
    """Yield what receives a diagnosis' progress, as `fit_shown` does for a fit."""
    if callable(progress):
        yield paused(progress)
        return
    with _line("diagnosis", is_wanted=progress is not False) as line:

        def show(stage: str, share: float) -> None:
            raise_swallowed()
            if line is not None:
                line.show(share, stage)

        yield show


@contextlib.contextmanager
def _line(title: str, *, is_wanted: bool) -> Iterator[ProgressLine | None]:
    """Yield a line of progress, None where it is not wanted or nobody sees it."""
    line = ProgressLine(title) if is_wanted and is_displayed() else None
    try:
        yield line
    finally:
        if line is not None:
            line.end()


def one_at_a_time(call: _Call) -> _Call:
    """Return the call with one more promise: in another thread it waits for the one that runs, or for its progress."""

    @functools.wraps(call)
    def alone(*arguments: Any, **options: Any) -> object:
        __tracebackhide__ = True
        with own_turn():
            return call(*arguments, **options)

    return cast("_Call", alone)


def ends_in_a_sentence(call: _Call) -> _Call:
    """Return the call with one more promise: Ctrl-C names the saved state, and shows none of its inner frames.

    The state is in the file or folder of the call's argument `checkpoint`.
    """

    @functools.wraps(call)
    def ended(*arguments: Any, **options: Any) -> object:
        __tracebackhide__ = True  # IPython then leaves this frame out
        try:
            with _interruptions_remembered():
                return call(*arguments, **options)
        except KeyboardInterrupt:
            kept = _words_on(options.get("checkpoint"))
        raise KeyboardInterrupt(kept)

    return cast("_Call", ended)


def _words_on(checkpoint: object) -> str:
    if isinstance(checkpoint, str | Path) and Path(checkpoint).exists():
        return f"Interrupted; finished work is kept in {checkpoint}. The same call continues."
    if checkpoint is not None:
        return "Interrupted; nothing was finished yet. The same call begins anew."
    return "Interrupted; nothing is kept. With checkpoint=PATH, the same call would continue."


@contextlib.contextmanager
def _interruptions_remembered() -> Iterator[None]:
    """Within the block, a Ctrl-C that a library swallows is raised at the next progress, as in the command."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)
    remember_interruptions()
    within = signal.getsignal(signal.SIGINT)
    try:
        yield
    finally:
        forget_interruption()
        if within is not before and signal.getsignal(signal.SIGINT) is within:
            signal.signal(signal.SIGINT, before)
