"""Start of Taichi, thread counts of libraries, and environment variables that affect simulations.

HANGTIME_THREADS=N lowers the number of processors. HANGTIME_JITTER=SEED moves every simulation by a rounding error.
"""

from __future__ import annotations

import contextlib
import functools
import io
import os
import sys
from collections.abc import Iterator
from multiprocessing import resource_tracker
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from fit.kernel_cache.place import mended_cache
from formats.arrays import Floats

JITTER_VARIABLE = "HANGTIME_JITTER"  # environment variable that `jittered` reads
JITTER_SIZE = 1e-7  # standard deviation, of the cloth's size: about half a unit in the last place of single precision
TASK = 512  # Taichi splits loops into tasks of at least 512 iterations: a kernel makes each group one task
ALIGNMENT = 64  # bytes of the longest vectors: sixteen single numbers, or eight double ones
# Option -W of Python: the beginning of the message, and its kind.
SILENT_TRACKER = "ignore:resource_tracker:UserWarning"
_started: dict[str, int] = {}


def start_tracker() -> None:
    """Start Python's process that frees what killed workers leave, so that it prints no warning of its own.

    It outlives a command that a signal ended, and would write its warning to the user's terminal.
    """
    sys.warnoptions.append(SILENT_TRACKER)  # a new Python process gets these options
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.remove(SILENT_TRACKER)


def available_threads() -> int:
    """Return the number of processors this process may use; HANGTIME_THREADS in the environment lowers it."""
    allowed = len(os.sched_getaffinity(0))
    wanted = os.environ.get("HANGTIME_THREADS", "")
    return min(int(wanted), allowed) if wanted.isdigit() and int(wanted) > 0 else allowed


@contextlib.contextmanager
def one_thread_of_algebra() -> Iterator[None]:
    """Context in which linear algebra uses one thread; afterwards the caller's own number applies again.

    Sums over several threads round differently. The last bit decides where a search ends among equally good values of
    an unidentified parameter. So a result must not depend on the number of processors, nor on the caller: command line,
    notebook or worker of a cluster.
    """
    import scipy.linalg  # noqa: F401 - it brings a BLAS of its own, which must be loaded before its threads can be set
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        yield


def jittered(places: Floats) -> Floats:
    """Return initial positions [m], (..., nodes, 3), with an added rounding error if HANGTIME_JITTER=SEED is set.

    Another processor or another compiler rounds differently. The tests must pass there too, so they are also run with
    this switch on. A seed moves node i of every candidate by the same vector: results still do not depend on which
    other candidates share a batch.

    Raises:
        FitError: the variable holds something else than a whole number.
    """
    seed = os.environ.get(JITTER_VARIABLE, "")
    if not seed:
        return places
    if not seed.isdecimal():
        raise FitError(
            f"{seed!r} is no whole number",
            where=JITTER_VARIABLE,
            advice=f"set it to a seed such as {JITTER_VARIABLE}=1, or unset it",
        )
    nodes = places.reshape(-1, places.shape[-2], 3)[0]
    size = float(np.linalg.norm(np.ptp(nodes, axis=0)))
    return places + np.random.default_rng(int(seed)).normal(0.0, JITTER_SIZE * size, nodes.shape)


@functools.cache
def lane_widths() -> tuple[int, ...]:
    """Return the possible numbers of SIMD lanes of a kernel.

    Without fast mathematics (`start`) kernels of all widths round alike, so that the number of candidates changes no
    bit of a result. A single candidate is faster in scalars than in vectors with one used lane.
    """
    try:
        with open("/proc/cpuinfo") as file:
            about = file.read()
    except OSError:
        about = ""
    return (1, 8, 16) if "avx512f" in about.split() else (1, 8)


def start(threads: int | None = None) -> None:
    """Start Taichi on the CPU, once per process; later calls do nothing.

    Single precision, and no fast mathematics: with it compilers divide by estimates of reciprocals, which differ
    between processors and, on some, between widths of vectors. Compiled kernels are kept in Taichi's offline cache, so
    that a second process starts at once; where it cannot be written, for this process alone.

    Raises:
        FitError: no folder can be written, not even a temporary one.
    """
    if _started:
        return
    import taichi as ti

    os.environ["TI_SKIP_VERSION_CHECK"] = "ON"  # else a thread asks a server, and no kernel is noted meanwhile
    cache = mended_cache(ti)
    _started["threads"] = threads or available_threads()
    with contextlib.redirect_stdout(io.StringIO()):  # it prints version and processor
        ti.init(
            arch=ti.cpu,
            default_fp=ti.f32,
            fast_math=False,
            offline_cache=True,
            cpu_max_num_threads=_started["threads"],
            log_level=ti.ERROR,
            **cache,
        )
    _read_kernels_quickly()


def _read_kernels_quickly() -> None:
    """Speed up Taichi 1.7's reading of kernel sources, which every process repeats.

    Taichi formats the lines around every node of the syntax tree for a possible error message. Without this, an error
    names only file and line. Taichi also looks up a function's source at each call.
    """
    from taichi.lang import kernel_impl

    class Context(kernel_impl.ASTTransformerContext):  # type: ignore[misc]
        def get_pos_info(self, node: Any) -> str:
            return f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {self.func.func.__name__}:\n'

    kernel_impl.ASTTransformerContext = Context
    kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
    kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)


@contextlib.contextmanager
def vectors_kept() -> Iterator[None]:
    """Context in which newly compiled kernels map Taichi's vectors to SIMD vectors.

    By default Taichi splits vectors and relies on LLVM to vectorise again. LLVM fails to do so in sums over stencils.
    Then 16 candidates in lanes cost as much as 16 single ones. Kernels of real vectors may use only the functions of
    `fit.cloth.lanes`, and their arrays must be aligned.
    """
    from taichi.lang import impl

    configuration = impl.current_cfg()
    configuration.real_matrix_scalarize = False
    try:
        yield
    finally:
        configuration.real_matrix_scalarize = True


def aligned_zeros(shape: tuple[int, ...], kind: type[np.floating[Any]]) -> NDArray[Any]:
    """Return zeros in memory aligned for SIMD loads, because a misaligned vector ends the process."""
    size = np.dtype(kind).itemsize * int(np.prod(shape))
    raw = np.zeros(size + ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % ALIGNMENT
    return raw[start : start + size].view(kind).reshape(shape)
