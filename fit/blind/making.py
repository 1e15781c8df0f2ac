"""Generate a sealed set of cases: labels first, then one case after the other, resumable at any time.

DIR/cases/<id>/take-1.mcap ... held-out-2.mcap      public
DIR/manifest.json                                   SHA-256 of every public file and of the sealed labels
DIR/sealed/labels.bin, DIR/sealed/key               see `fit.blind.seal`
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import msgspec

from fit import runtime
from fit.blind.cases import FILES, PERFECT_SENSOR, Kind, Truth, plan, write_case
from fit.blind.foreign.engines import OWN_GENERATOR, Generator, find_generator
from fit.blind.plants import Plant
from fit.blind.real import RealTruth, find_takes, plan_real, write_real_case
from fit.blind.seal import load_key, seal, sha256_of, unseal
from fit.errors import FitError
from formats.results import LARGEST_RESULT
from formats.system_causes import step_to_read
from formats.whole_files import read_bounded, write_whole


class Labels(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Sealed labels: settings of the random draw and the truth of every case."""

    format: str
    seed: int
    numbers: dict[str, int]
    plants: tuple[str, ...]
    side: float
    truths: tuple[Truth, ...]
    generator: str = "own"
    real: tuple[RealTruth, ...] = ()

    @property
    def cases(self) -> tuple[str, ...]:
        """Names of all cases, in order."""
        return tuple(sorted([t.id for t in self.truths] + [t.id for t in self.real]))


class Manifest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Public manifest of a set: `files` maps paths in the set's folder to their SHA-256."""

    format: str
    sealed: str
    cases: tuple[str, ...]
    files: dict[str, str]
    complete: bool


MANIFEST, LABELS, SEALED_KEY = "manifest.json", "sealed/labels.bin", "sealed/key"
LABELS_FORMAT, MANIFEST_FORMAT = "hangtime-blind-labels/1", "hangtime-blind-manifest/1"
Progress = Callable[[int, int], None]
Made = tuple[str, dict[str, str]]  # progress: a case's name and the SHA-256 of its files


def make_set(
    folder: Path, numbers: dict[Kind, int], plants: tuple[Plant, ...], seed: int, *, workers: int = 1,
    side: float | None = None, generator: Generator = OWN_GENERATOR, sensor: Mapping[str, float] = PERFECT_SENSOR,
    progress: Progress = lambda done, total: None,
) -> Manifest:  # fmt: skip
    """Generate or continue a set; files with the right hash are not generated again.

    `sensor` fixes parts of every look (`noise`, `away`, `rate`) that are random otherwise. The steps of a ladder with
    one seed have the same cases otherwise.

    Raises:
        FitError: nothing to make, the folder holds another set, the generator's engine is not there, the side fits no
            mesh, or a case cannot be simulated.
    """
    side = generator.side if side is None else side
    if generator.foreign is not None and not generator.foreign.is_installed():
        raise generator.foreign.absent()
    if sum(numbers.values()) < 1 or min(numbers.values()) < 0:
        raise FitError("there is no case to make", where=folder, advice="give --cases, --nulls, --pairs or --unknowns")
    if numbers["pair"] and len(plants) < 2:
        raise FitError("a pair needs two effects to choose from", where="--effect", advice="give a second --effect")
    truths = plan(numbers, plants, seed, generator.unknown_plants(), sensor)
    _check_side(side, truths)
    labels = Labels(
        format=LABELS_FORMAT, seed=seed, numbers={str(k): v for k, v in numbers.items()},
        plants=tuple(p.id for p in plants), side=side, truths=tuple(truths), generator=generator.name,
    )  # fmt: skip

    def made(left: frozenset[str]) -> Iterator[Made]:
        return _made(folder, [t for t in truths if t.id in left], (generator.name, side), workers)

    return _make_all(folder, labels, made, progress)


def make_real_set(
    folder: Path, takes_folder: Path, numbers: dict[Kind, int], plants: tuple[Plant, ...], seed: int, *,
    progress: Progress = lambda done, total: None,
) -> Manifest:  # fmt: skip
    """Generate or continue a set of real takes with planted measurement faults.

    Raises:
        FitError: too few takes, nothing to make, no untouched case, or the folder holds another set.
    """
    takes = find_takes(takes_folder)
    truths = plan_real(list(takes), numbers, plants, seed)
    labels = Labels(
        format=LABELS_FORMAT, seed=seed, numbers={str(k): v for k, v in numbers.items()},
        plants=tuple(p.id for p in plants), side=0.0, truths=(), generator="real", real=tuple(truths),
    )  # fmt: skip

    def made(left: frozenset[str]) -> Iterator[Made]:
        for truth in truths:
            if truth.id in left:
                yield truth.id, _hashes(write_real_case(folder / "cases" / truth.id, truth, takes))

    return _make_all(folder, labels, made, progress)


def _check_side(side: float, truths: list[Truth]) -> None:
    """Refuse a mesh side larger than half a sheet, before anything is sealed."""
    largest = min(min(t.look.width, t.look.height) for t in truths) / 2
    if not 0 < side <= largest:  # no comparison with NaN is true
        raise FitError(
            f"a mesh of side {side:g} m does not fit these cases", where="--side",
            advice=f"give metres, above 0 and up to {int(1e3 * largest) / 1e3:g}",
        )  # fmt: skip


def _make_all(
    folder: Path, labels: Labels, made: Callable[[frozenset[str]], Iterator[Made]], progress: Progress
) -> Manifest:
    """Seal the labels, then generate the missing cases; `made` yields each finished case."""
    manifest = _begin(folder, labels)
    files, total = dict(manifest.files), len(labels.cases)
    left = frozenset(case for case in labels.cases if not _is_made(folder, case, files))
    progress(total - len(left), total)
    for done, (case, hashes) in enumerate(made(left), total - len(left) + 1):
        files.update({f"cases/{case}/{name}": sha for name, sha in hashes.items()})
        manifest = msgspec.structs.replace(manifest, files=dict(sorted(files.items())))
        _write(folder, manifest)
        progress(done, total)
    manifest = msgspec.structs.replace(manifest, complete=True)
    _write(folder, manifest)
    return manifest


def open_labels(folder: Path) -> Labels:
    """Open the seal and return the labels.

    Raises:
        FitError: there is no seal or key, or either was changed since it was published.
    """
    manifest, path = read_manifest(folder), folder / LABELS
    if not path.exists():
        raise FitError("there are no sealed labels", where=path, advice="give a folder that `blind make` wrote")
    if sha256_of(path) != manifest.sealed:
        raise FitError("the sealed labels are not those of the manifest", where=path, advice="make a new set")
    try:
        sealed = read_bounded(path, LARGEST_RESULT)
    except OSError as error:
        raise FitError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    raw = unseal(sealed, load_key(folder / SEALED_KEY), where=path)
    return msgspec.json.decode(raw, type=Labels)


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest.

    Raises:
        FitError: there is none, or it cannot be read.
    """
    path = folder / MANIFEST
    try:
        return msgspec.json.decode(read_bounded(path, LARGEST_RESULT), type=Manifest)
    except FileNotFoundError as error:
        raise FitError(
            "there is no set of cases", where=folder, advice="make one with `hangtime blind make`"
        ) from error
    except OSError as error:
        raise FitError(f"cannot be read ({error.strerror})", where=path, advice=step_to_read(error)) from error
    except msgspec.MsgspecError as error:
        raise FitError(f"is not a manifest: {error}", where=path, advice="make a new set") from error


def changed_files(folder: Path, manifest: Manifest) -> list[str]:
    """Return the public files that are missing or changed."""
    return [n for n, sha in manifest.files.items() if not (folder / n).exists() or sha256_of(folder / n) != sha]


def _begin(folder: Path, labels: Labels) -> Manifest:
    """Seal the labels, or check that the folder's sealed labels are equal."""
    if (folder / MANIFEST).exists():
        found = open_labels(folder)
        if found != labels:
            raise FitError(
                "the folder holds another set of cases", where=folder,
                advice="use another folder, or the same numbers, effects, --side, --seed and sensor as before",
            )  # fmt: skip
        return read_manifest(folder)
    key = load_key(folder / SEALED_KEY, make=True)
    write_whole(folder / LABELS, seal(msgspec.json.encode(labels), key))
    manifest = Manifest(
        format=MANIFEST_FORMAT, sealed=sha256_of(folder / LABELS), cases=labels.cases,
        files={}, complete=False,
    )  # fmt: skip
    _write(folder, manifest)
    return manifest


def _is_made(folder: Path, case: str, files: dict[str, str]) -> bool:
    names = [f"cases/{case}/{name}" for name in FILES]
    return all(n in files and (folder / n).exists() and sha256_of(folder / n) == files[n] for n in names)


def _made(folder: Path, truths: list[Truth], how: tuple[str, float], workers: int) -> Iterator[Made]:
    """Generate cases in one or several processes and yield each finished one; an early exit cancels the rest."""
    if workers <= 1:
        for truth in truths:
            yield _make_one(folder, truth, how)
        return
    runtime.start_tracker()
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_start_worker)
    try:
        waiting = {pool.submit(_make_one, folder, truth, how) for truth in truths}
        while waiting:
            done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    except BrokenProcessPool as error:
        raise FitError(
            "a process ended while it simulated a case", where=folder,
            advice="the same command continues; with little memory, use fewer --workers",
        ) from error  # fmt: skip
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _start_worker() -> None:
    """Set up a worker process: one thread, and no reaction to Ctrl-C, on which the parent decides."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    runtime.start(1)


def _make_one(folder: Path, truth: Truth, how: tuple[str, float]) -> Made:
    """Generate one case with the generator of this name and a mesh of this side [m]."""
    name, side = how
    paths = write_case(folder / "cases" / truth.id, truth, side=side, generator=find_generator(name))
    return truth.id, _hashes(paths)


def _hashes(paths: list[Path]) -> dict[str, str]:
    return {path.name: sha256_of(path) for path in paths}


def _write(folder: Path, manifest: Manifest) -> None:
    write_whole(folder / MANIFEST, msgspec.json.format(msgspec.json.encode(manifest), indent=1) + b"\n")
