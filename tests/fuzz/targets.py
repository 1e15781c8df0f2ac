"""The fuzzing targets: readers of foreign files. Each takes bytes and may raise only a `HangtimeError`."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from firmware_host.oni_records import summarise
from formats.archive import take_of
from formats.descriptions import dump_description, load_garment, load_rig
from formats.errors import HangtimeError
from formats.importers.c3d_file import read_c3d
from formats.importers.marker_text import read_marker_text
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.test_archive import GARMENT, RIG
from tests.formats.test_other_programs_files import LABELS, WRITERS, drawn
from tests.formats.vectors.make import HERE

_FOLDER = tempfile.TemporaryDirectory(prefix="hangtime-fuzz-")


@contextlib.contextmanager
def _file(raw: bytes, name: str) -> Iterator[Path]:
    path = Path(_FOLDER.name) / name
    path.write_bytes(raw)
    yield path


def archive(raw: bytes) -> None:
    """Read bytes as a take archive."""
    take_of(raw, "fuzz")


def c3d(raw: bytes) -> None:
    """Read bytes as a C3D file."""
    with _file(raw, "a.c3d") as path:
        read_c3d(path, "mm")


def text(raw: bytes) -> None:
    """Read bytes as a text file of marker paths."""
    with _file(raw, "a.csv") as path:
        read_marker_text(path, "mm")


def oni(raw: bytes) -> None:
    """Read bytes as an .oni recording."""
    with _file(raw, "a.oni") as path:
        summarise(path)


def toml(raw: bytes) -> None:
    """Read bytes as a garment and as a rig."""
    with _file(raw, "a.toml") as path:
        for load in (load_garment, load_rig):
            with contextlib.suppress(HangtimeError):
                load(path)


TARGETS: dict[str, Callable[[bytes], None]] = {"archive": archive, "c3d": c3d, "text": text, "oni": oni, "toml": toml}


def seeds(target: str) -> list[bytes]:
    """Return the files of a fuzzer's initial corpus."""
    if target == "archive":
        return [(HERE / f"version-{version}.mcap").read_bytes() for version in (1, 2)]
    if target == "c3d":
        return [c3d_bytes(1e3 * drawn(), LABELS, processor=kind) for kind in ("intel", "dec", "sgi")]
    if target == "text":
        return [write(drawn()).encode() for write in WRITERS.values()]
    if target == "oni":
        from tests.firmware_host.test_openni2_sensor import write_recording

        return [write_recording(Path(_FOLDER.name) / "seed.oni", 2).read_bytes()]
    return [dump_description(one).encode() for one in (GARMENT, RIG)]
