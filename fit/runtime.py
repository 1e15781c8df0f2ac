"""Start of Taichi, thread counts of libraries, and environment variables that affect simulations.

HANGTIME_THREADS=N lowers the number of processors. HANGTIME_JITTER=SEED moves every simulation by a rounding error.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import io
import math
import os
import shutil
import stat
import struct
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from fit.errors import FitError
from formats.arrays import Floats
from formats.whole_files import write_whole

JITTER_VARIABLE = "HANGTIME_JITTER"  # environment variable that `jittered` reads
JITTER_SIZE = 1e-7  # standard deviation, of the cloth's size: about half a unit in the last place of single precision
TASK = 512  # Taichi splits loops into tasks of at least 512 iterations: a kernel makes each group one task
ALIGNMENT = 64  # bytes of the longest vectors: sixteen single numbers, or eight double ones
CACHE = "TI_OFFLINE_CACHE_FILE_PATH"  # Taichi's own variable
INDEX, LOCK = "ticache.tcb", "ticache.lock"  # Taichi's names for files of its cache
INDEX_VERSION = (1, 7, 4)  # of Taichi, whose index `sizes_of_kernels` knows
LARGEST_INDEX = 1 << 26  # bytes: 400,000 kernels
NOTED = "hangtime-kernels.json"  # this program's own file in Taichi's cache, see `note_kernels`
HASH = 64  # letters of the SHA-256 with which Taichi ends the file of a kernel
LARGEST_NOTE = 1 << 26  # bytes; our choice: as of the index, since a note holds a line for each of its kernels
STALE_LOCK = 60.0  # s; Taichi holds its lock for milliseconds, and gives up after 0.2 s
_started: dict[str, int] = {}


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

    cache = _other_cache(ti)
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


def _other_cache(ti: Any) -> dict[str, str]:
    """Return a temporary kernel cache for `ti.init` if its own cannot be written, which would end the process."""
    own = Path(os.environ.get(CACHE) or ti.lang.impl.default_cfg().offline_cache_file_path)
    try:
        own.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=own):
            mend_cache(own)
            with contextlib.suppress(OSError):  # on a full disk, or of another user: the cache works without it
                note_kernels(own)
            atexit.register(_note_own_kernels, ti, own, time.time())
            return {}
    except OSError:
        os.environ.pop(CACHE, None)  # Taichi would warn that it is overridden
    try:
        folder = tempfile.mkdtemp(prefix="hangtime-kernels-")
    except OSError as error:
        raise FitError(
            f"compiled kernels cannot be kept ({error.strerror})", where=own,
            advice="set TMPDIR to a folder that can be written",
        ) from error  # fmt: skip

    def forget() -> None:
        ti.reset()  # it writes, and must find the folder
        shutil.rmtree(folder, ignore_errors=True)

    atexit.register(forget)
    return {"offline_cache_file_path": folder}


def mend_cache(folder: Path) -> None:
    """Rename a damaged index of compiled kernels, and remove the stale lock of a killed process.

    Taichi 1.7.4 trusts its index: a damaged one ends the process, or requests more memory than exists. Another kernel's
    file under a kernel's name ends the process, or computes something else. With a stale lock, or without a file of the
    index, every process compiles again. The damaged index becomes `ticache.tcb.damaged`, and Taichi writes all anew.
    So does an index of which a file differs from what `note_kernels` noted.

    Raises:
        OSError: a file cannot be read, renamed or removed.
    """
    index, lock = folder / INDEX, folder / LOCK
    with contextlib.suppress(FileNotFoundError):
        if abs(time.time() - lock.stat().st_mtime) > STALE_LOCK:  # the clock may have been put back since
            lock.unlink()
    for patience in (0.05, 0.1, 0.0):  # s: another process may be writing it
        try:
            if lock.exists() or _is_sound_cache(index):
                return
        except FileNotFoundError:
            return
        time.sleep(patience)
    with contextlib.suppress(FileNotFoundError):
        (folder / NOTED).unlink(missing_ok=True)
        for kernel in folder.glob("*.tic"):
            if not kernel.is_file():  # Taichi would write into a pipe for ever, and end for a folder or a dead link
                kernel.rename(kernel.with_name(kernel.name + ".damaged"))
        index.rename(index.with_name(INDEX + ".damaged"))


def note_kernels(folder: Path, since: float = math.inf) -> None:
    """Note which compiled kernel has which name, so that `mend_cache` finds exchanged files of one size.

    Taichi checks each file by the hash at the end of the file, and never whether the file is that of the name.

    since [s since 1970]: files changed after this time are noted anew; other files only where they are not noted yet

    Raises:
        OSError: a file cannot be read or written.
    """
    if (folder / LOCK).exists() or not (folder / INDEX).is_file():
        return
    before, now = _noted(folder), {}
    for name in sizes_of_kernels((folder / INDEX).read_bytes()) or {}:
        file = folder / f"{name}.tic"
        if file.is_file():
            is_known = name in before and file.stat().st_mtime < since
            now[name] = before[name] if is_known else _hash_of(file)
    if now != before:
        write_whole(folder / NOTED, msgspec.json.encode(now))


def _note_own_kernels(ti: Any, folder: Path, since: float) -> None:
    """Note the kernels of this process at its end; with other threads, which may simulate, the next process does."""
    if threading.active_count() > 1:
        return
    ti.reset()  # it writes the kernels
    with contextlib.suppress(OSError):
        note_kernels(folder, since)


def _noted(folder: Path) -> dict[str, str]:
    """Return the noted hashes of kernels by name; a damaged note holds none."""
    file = folder / NOTED
    try:
        if not file.is_file() or file.stat().st_size > LARGEST_NOTE:
            return {}
        return msgspec.json.decode(file.read_bytes(), type=dict[str, str])
    except (msgspec.MsgspecError, FileNotFoundError):
        return {}


def _hash_of(kernel: Path) -> str:
    with kernel.open("rb") as file:
        file.seek(-min(HASH, kernel.stat().st_size), os.SEEK_END)
        return file.read(HASH).decode("latin-1")


def _is_sound_cache(index: Path) -> bool:
    """Return whether an index is undamaged, and the file of each kernel is as long as stated and as noted."""
    state = index.stat()
    if not stat.S_ISREG(state.st_mode) or state.st_size > LARGEST_INDEX:
        return False
    sizes = sizes_of_kernels(index.read_bytes())
    if sizes is None:
        return False
    noted = _noted(index.parent)
    try:
        for name, size in sizes.items():
            kernel = index.parent / f"{name}.tic"
            if (
                not kernel.is_file()
                or kernel.stat().st_size != size
                or (name in noted and _hash_of(kernel) != noted[name])
            ):
                return False
        return True
    except FileNotFoundError:
        return False


def sizes_of_kernels(held: bytes) -> dict[str, int] | None:
    """Return the sizes of compiled kernels [bytes] by name, from the bytes of their index; None if it is damaged.

    - header: length of the file, version of Taichi, size of all kernels, number of entries
    - entry: the kernel's name twice, each after its length, then the size of its file and two dates

    Taichi itself discards the index of another version, which gives no sizes here.
    """
    header = struct.Struct("<q3HQQ")
    if len(held) < header.size:
        return None
    length, *version, _, count = header.unpack_from(held)
    if tuple(version) != INDEX_VERSION:
        return {}
    sizes: dict[str, int] = {}
    at = header.size
    for _ in range(min(count, len(held))):
        names = []
        for _ in range(2):
            end = at + 8 + int.from_bytes(held[at : at + 8], "little")
            names.append(held[at + 8 : end])
            if end > len(held):
                return None
            at = end
        if names[0] != names[1] or not names[0].isalnum():
            return None
        sizes[names[0].decode()] = int.from_bytes(held[at : at + 8], "little")
        at += 24
    return sizes if at == length == len(held) else None


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
