"""Hostile files for every reader, each beside an honest one of its kind; `scripts/fuzz --hostile` measures both.

An input may take 256 MB and 2 s more than an honest file of its kind with as many bytes.
"""

from __future__ import annotations

import json
import random
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from formats.descriptions import dump_description
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.formats.bombs import BOMBS
from tests.formats.c3d_by_hand import c3d_bytes
from tests.formats.measured import MeasuredReading
from tests.formats.test_archive import GARMENT, RIG
from tests.formats.vectors.make import HERE

MOST_SECONDS, MOST_MEGABYTES = 2.0, 256  # s and MB beyond the honest share: our target for every input
SIZE = 8_000_000  # bytes of a text file: 40 markers for 40 s at 200 frames a second
MARKERS, FRAMES = 40, 8000
Cell = Callable[[float, int, int], str]


@dataclass(frozen=True)
class Input:
    """A file for a reader: the name that tells what is wrong with it, its ending, and the honest file of its kind."""

    reader: str
    name: str
    ending: str
    make: Callable[[], bytes]
    honest: Callable[[], bytes]


@cache
def drawn(markers: int = MARKERS, frames: int = FRAMES) -> np.ndarray:
    """Return swinging markers [mm], (frames, markers * 3), around 1.5 m, so that numbers pass 1000 mm."""
    rng = np.random.default_rng(3)
    time, phase = np.arange(frames)[:, None] / 200, rng.uniform(0, 6, 3 * markers)
    swing = 700 * np.sin(2 * np.pi * 0.8 * time + phase) + rng.uniform(900, 1500, 3 * markers)
    return swing + rng.normal(0, 0.3, swing.shape)


def plain(value: float, frame: int, column: int) -> str:
    """Return a number as every program writes one."""
    return f"{value:.3f}"


def heads(kind: str, end: str, names: list[str]) -> list[str]:
    """Return the header lines of a maker's table."""
    if kind == "trc":
        return [
            "PathFileType\t4\t(X/Y/Z)\tx.trc",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
            f"200\t200\t{FRAMES}\t{len(names)}\tmm\t200\t1\t{FRAMES}",
            "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
            "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, len(names) + 1)), "",
        ]  # fmt: skip
    if kind == "vicon":
        return [
            "Trajectories", "200", end.join(["", "", *(f"Bar:{name}{2 * end}" for name in names)]),
            end.join(["Frame", "Sub Frame", *["X", "Y", "Z"] * len(names)]),
            end.join(["", "", *["mm"] * (3 * len(names))]),
        ]  # fmt: skip
    if kind == "motive":
        return [
            "Format Version,1.23,Take Name,a,Capture Frame Rate,200,Export Frame Rate,200,"
            f"Total Frames in Take,{FRAMES},"
            f"Total Exported Frames,{FRAMES},Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global",
            "", ",Type," + ",".join(["Marker"] * (3 * len(names))),
            ",Name," + ",".join(f"C:{name}" for name in names for _ in range(3)),
            ",ID," + ",".join(f"{name}" for name in names for _ in range(3)),
            ",," + ",".join(["Position"] * (3 * len(names))),
            "Frame,Time (Seconds)," + ",".join(["X,Y,Z"] * len(names)),
        ]  # fmt: skip
    if kind == "qualisys":
        return [
            f"NO_OF_FRAMES\t{FRAMES}", "NO_OF_CAMERAS\t8", f"NO_OF_MARKERS\t{len(names)}", "FREQUENCY\t200",
            "DATA_INCLUDED\t3D", "MARKER_NAMES\t" + "\t".join(names),
        ]  # fmt: skip
    return [end.join(["time_s", *(f"{name}_{axis}_mm" for name in names for axis in "xyz")])]


def table(kind: str, cell: Cell = plain, end: str = "", markers: int = MARKERS, decimal: str = ".") -> bytes:
    """Return a maker's table of `SIZE` bytes at most; `cell` formats a number by its value, frame and column."""
    end = end or ("\t" if kind in ("trc", "qualisys") else ",")
    lines = heads(kind, end, [f"m{k}" for k in range(markers)])
    size, frames = sum(map(len, lines)), SIZE // (24 * markers)
    for k, row in enumerate(drawn(markers, max(frames, FRAMES))):
        time = f"{k / 200:.3f}"
        clock = {"vicon": [str(k + 1), "0"], "qualisys": [], "ours": [time]}.get(kind, [str(k + 1), time])
        cells = [one.replace(".", decimal) for one in clock] + [cell(value, k, at) for at, value in enumerate(row)]
        lines.append(end.join(cells))
        size += len(lines[-1]) + 1
        if size > SIZE:
            break
    if kind == "trc":
        lines[2] = lines[2].replace(str(FRAMES), str(len(lines) - 6))
    if kind == "motive":
        lines[0] = lines[0].replace(str(FRAMES), str(len(lines) - 7))
    if kind == "qualisys":
        lines[0] = f"NO_OF_FRAMES\t{len(lines) - 6}"
    return ("\n".join(lines) + "\n").encode()


def _odd_cells() -> Iterator[tuple[str, Cell, str, str]]:
    """Yield a name, the cell, and the delimiter and decimal sign that it needs ('' for the usual ones)."""
    rng = random.Random(5)
    for sign, word in ((",", "commas"), ("'", "apostrophes"), ("\u202f", "narrow spaces"), (" ", "spaces")):
        yield f"thousands by {word}", lambda v, k, c, sign=sign: f"{v:,.3f}".replace(",", sign), "\t", "."
        yield (
            f"thousands by {word}, quoted",
            lambda v, k, c, sign=sign: '"' + f"{v:,.3f}".replace(",", sign) + '"',
            "",
            ".",
        )
    yield "thousands by points, decimal commas", lambda v, k, c: f"{v:,.3f}".translate({44: ".", 46: ","}), ";", ","
    yield "whole thousands by commas", lambda v, k, c: f"{v:,.0f}", "\t", "."
    yield "thousands by every sign in turn", lambda v, k, c: f"{v:,.3f}".replace(",", ",' \u2019"[c % 4]), "\t", "."
    yield "thousands in one column", lambda v, k, c: f"{v:,.3f}" if c == 7 else f"{v:.3f}", "\t", "."
    yield "thousands, and an odd number in each line", lambda v, k, c: "1e3" if c == 7 else f"{v:,.3f}", "\t", "."
    yield "thousands, and a minus of another sign", lambda v, k, c: f"{-v:,.3f}".replace("-", "\u2212"), "\t", "."
    yield "decimal commas, quoted", lambda v, k, c: f'"{v:.3f}"'.replace(".", ","), "", "."
    yield "decimal commas", lambda v, k, c: f"{v:.3f}".replace(".", ","), ";", ","
    yield "spaces around", lambda v, k, c: f"  {v:.3f}  ", "", "."
    yield "exponents", lambda v, k, c: f"{v:.5E}", "", "."
    yield "words for gaps", lambda v, k, c: ("NaN", "", "-1.#IND", "#N/A", "1.#QNAN0", "null")[(k + c) % 6], "", "."
    yield "a word for a gap in each line", lambda v, k, c: "-1.#IND00" if c == k % 120 else f"{v:.3f}", "", "."
    yield "zeros", lambda v, k, c: "0.000", "", "."
    yield "zeros in turn", lambda v, k, c: "0.000" if (k + c // 3) % 3 == 0 else f"{v:.3f}", "", "."
    yield "missing-value codes", lambda v, k, c: "-9999.000" if (k + c // 3) % 3 == 0 else f"{v:.3f}", "", "."
    yield "jumps everywhere", lambda v, k, c: f"{v + 5000 * ((k + c // 3) % 7 == 0):.3f}", "", "."
    leap = lambda k, c, share: (k * 7919 % 1000 < share) * (hash((k, c // 3)) % 5 < 2) * (hash((c, k)) % 4000)  # noqa: E731
    for share in (600, 800, 950):
        yield f"leaps in {share} of 1000 frames", lambda v, k, c, share=share: f"{v + leap(k, c, share):.3f}", "", "."
    yield "noise", lambda v, k, c: f"{rng.uniform(-5e3, 5e3):.3f}", "", "."
    yield "random counts of digits", lambda v, k, c: f"{v:.{rng.randrange(9)}f}", "", "."
    yield "long numbers", lambda v, k, c: f"{v:.300f}", "", "."
    yield "short numbers", lambda v, k, c: f"{v % 10:.0f}", "", "."
    yield "infinities", lambda v, k, c: "1e999" if k > 50 else f"{v:.3f}", "", "."
    yield "words", lambda v, k, c: "word" if k > 50 else f"{v:.3f}", "", "."
    yield "still numbers", lambda v, k, c: f"{c * 10:.3f}", "", "."
    yield "commas and points in turn", lambda v, k, c: f"{v:.3f}".replace(".", ".,"[k % 2]), "\t", "."


def _lines(kind: str, change: Callable[[int, str], str], markers: int = MARKERS) -> bytes:
    """Return a maker's table of which each line is changed."""
    lines = table(kind, markers=markers).decode().split("\n")
    return "\n".join(change(k, line) for k, line in enumerate(lines)).encode()


def _shuffled(kind: str, order: Callable[[list[bytes]], list[bytes]]) -> bytes:
    """Return a maker's table with its lines below the header in another order."""
    lines = table(kind).split(b"\n")
    return b"\n".join(lines[:8] + order(lines[8:]))


def _texts(kind: str) -> Iterator[tuple[str, Callable[[], bytes]]]:
    for name, cell, end, decimal in _odd_cells():
        if end and kind == "motive":  # it always writes commas
            continue
        delimiter = "\t" if kind in ("trc", "qualisys") else end
        yield name, lambda cell=cell, end=delimiter, decimal=decimal: table(kind, cell, end, decimal=decimal)
    end = "\t" if kind in ("trc", "qualisys") else ","
    yield "one marker", lambda: table(kind, markers=1)
    yield (
        "lines cut in turn",
        lambda: _lines(kind, lambda k, line: line[: len(line) // 2] if k > 20 and k % 2 else line),
    )
    yield "one line in two is lost", lambda: _lines(kind, lambda k, line: "" if k > 20 and k % 2 else line)
    joined = lambda k, line: line + "\0" if k > 20 and k % 3 else line  # noqa: E731
    yield "line ends lost", lambda: _lines(kind, joined).replace(b"\0\n", b"")
    yield "empty lines", lambda: table(kind)[:5000] + b"\n" * SIZE
    yield "lines of delimiters", lambda: table(kind)[:5000] + b"\n" + (end * 60 + "\n").encode() * (SIZE // 61)
    yield "a line of delimiters", lambda: table(kind)[:5000] + b"\n" + end.encode() * SIZE
    yield "a line of digits", lambda: table(kind)[:5000] + b"\n" + b"1" * SIZE
    yield "lines of quotation marks", lambda: table(kind)[:5000] + b"\n" + (b'"' * 99 + b"\n") * (SIZE // 100)
    yield (
        "cells of quotation marks",
        lambda: _lines(kind, lambda k, line: line.replace(end, end + '"') if k > 20 else line),
    )
    yield "other line ends", lambda: table(kind).replace(b"\n", b"\r")
    yield "UTF-16", lambda: table(kind)[: SIZE // 2].decode().encode("utf-16")
    yield "many names", lambda: "\n".join(heads(kind, end, [f"n{k}" for k in range(30_000)])).encode() + b"\n"
    yield "one name for all", lambda: "\n".join(heads(kind, end, ["n"] * 30_000)).encode() + b"\n"
    yield "lines twice", lambda: _lines(kind, lambda k, line: f"{line}\n{line}" if k > 20 else line)
    yield "lines backwards", lambda: _shuffled(kind, lambda lines: lines[::-1])
    yield "random lines", lambda: _shuffled(kind, lambda lines: random.Random(1).sample(lines, len(lines)))
    flipped = lambda at, part: part[:-1] + bytes([part[-1] ^ 1 << at % 7]) if at > 6000 else part  # noqa: E731
    yield "bytes flipped", lambda: pieces(table(kind), 997, flipped)
    yield "bytes lost", lambda: pieces(table(kind), 997, lambda at, part: part[:990])


def _c3d(change: Callable[[np.ndarray], np.ndarray] | None = None, **words: object) -> bytes:
    places = drawn(MARKERS, 10_000).reshape(10_000, MARKERS, 3).copy()
    places = places if change is None else change(places)
    return c3d_bytes(places, tuple(f"m{k}" for k in range(places.shape[1])), rate=200.0, **words)


def in_turn(places: np.ndarray, step: int, change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return positions of which one frame in so many is changed."""
    found = places.copy()
    found[::step] = change(places[::step])
    return found


def _c3ds() -> Iterator[tuple[str, Callable[[], bytes]]]:
    rng = np.random.default_rng(2)
    yield "one marker, many frames", lambda: _c3d(lambda p: p[:, :1].repeat(30, 0).reshape(-1, 1, 3)[:65_000])
    wide = lambda names: c3d_bytes(drawn(len(names), 160).reshape(160, -1, 3), names)  # noqa: E731
    yield "many markers, few frames", lambda: wide([f"m{k}" for k in range(2040)])
    yield "one name for all", lambda: wide(["m"] * 2040)
    yield "names of numbers", lambda: wide([f"*{k}" for k in range(2040)])
    yield "noise", lambda: _c3d(lambda p: rng.uniform(-5e3, 5e3, p.shape))
    yield "all still", lambda: _c3d(lambda p: np.ones_like(p) * p[:1])
    yield "all markers at one place", lambda: _c3d(lambda p: p[:, :1] * np.ones_like(p))
    yield "nothing seen", lambda: _c3d(lambda p: p * np.nan)
    for name, step, change in (
        ("gaps", 2, lambda p: p * np.nan), ("zeros", 3, lambda p: p * 0), ("jumps", 3, lambda p: p + 4e3),
        ("labels exchanged", 9, lambda p: p[:, ::-1]), ("labels shifted", 9, lambda p: np.roll(p, 1, 1)),
        ("two labels exchanged", 9, lambda p: p[:, [1, 0, *range(2, p.shape[1])]]),
        ("two labels exchanged, often", 2, lambda p: p[:, [1, 0, *range(2, p.shape[1])]]),
        ("labels exchanged, often", 2, lambda p: p[:, ::-1]),
    ):  # fmt: skip
        yield f"{name} in turn", lambda step=step, change=change: _c3d(lambda p: in_turn(p, step, change))
    yield "frames twice", lambda: _c3d(lambda p: p[:5000].repeat(2, 0))
    yield "labels shifted once", lambda: _c3d(lambda p: np.concatenate([p[:5000], np.roll(p[5000:], 1, 1)]))
    yield "integers", lambda: _c3d(scale=0.1)
    yield "integers that wrap", lambda: _c3d(lambda p: (p * 20 + 32768) % 65536 - 32768, scale=1.0)
    yield "huge numbers", lambda: _c3d(lambda p: p * 1e30)
    yield "not numbers", lambda: _c3d().replace(b"\x44", b"\x7f")
    yield "more values", lambda: _c3d(analogue=200)
    many = [(f"P{k}", b"x" * 30, -1, [30]) for k in range(1200)]
    yield "parameters by the thousand", lambda: _c3d(lambda p: p[:, :2], more=many)
    for width in (16, 17):
        yield f"{width} bytes lost in turn", lambda w=width: pieces(_c3d(), 9999, lambda at, part: part[:-w])
        yield f"{width} bytes lost once", lambda w=width: _c3d()[:900_000] + _c3d()[900_000 + w :] + bytes(w)
    zeroed = lambda at, part: part[:4096] + bytes(len(part[4096:])) if at > SIZE // 80 else part  # noqa: E731
    yield "blocks of zeros in turn", lambda: pieces(_c3d(), 4608, zeroed)
    yield "blocks twice in turn", lambda: pieces(_c3d(), 4608, lambda at, part: part[:512] * 2 + part[1024:])
    yield "bytes of noise in turn", lambda: with_noise(_c3d())


def pieces(raw: bytes, size: int, change: Callable[[int, bytes], bytes]) -> bytes:
    """Return bytes of which each piece of this size is changed, by its place and content."""
    return b"".join(change(at, raw[at : at + size]) for at in range(0, len(raw), size))


def with_noise(raw: bytes) -> bytes:
    """Return bytes of which one in 500, behind the header, is another one."""
    found, rng = np.frombuffer(raw, np.uint8).copy(), np.random.default_rng(7)
    at = rng.integers(8192, len(raw), len(raw) // 500)
    found[at] ^= rng.integers(1, 255, len(at), dtype=np.uint8)
    return found.tobytes()


def _garments() -> Iterator[tuple[str, Callable[[], bytes]]]:
    honest = dump_description(GARMENT).encode()
    turn = 2 * np.pi
    round_ = lambda n: ", ".join(f"[{np.cos(k * turn / n):.6f}, {np.sin(k * turn / n):.6f}]" for k in range(n))  # noqa: E731
    body = 'format = "hangtime-garment/1"\nname = "g"\nkind = "skirt"\nmass_kg = 0.2\nheld = "edge"\n'
    yield "many corners", lambda: f"{body}outline_m = [{round_(20_000)}]\n".encode()
    points = ", ".join(f'{{name = "p{k}", at_m = [0.0, 0.0]}}' for k in range(9000))
    yield "many points", lambda: f"{body}outline_m = [{round_(8)}]\npoints = [{points}]\n".encode()
    holes = ", ".join(f"[{round_(8)}]" for _ in range(900))
    yield "many holes", lambda: f"{body}outline_m = [{round_(8)}]\nholes_m = [{holes}]\n".encode()
    yield "deep lists", lambda: b"a = " + b"[" * 100_000
    yield "deep tables", lambda: b"[" + b"a." * 100_000 + b"b]\n"
    yield "long key", lambda: b"a." * 100_000 + b"b = 1\n"
    yield "tables by the thousand", lambda: honest + b"".join(b"[a%d]\nb = 1\n" % k for k in range(60_000))
    yield "lists of tables", lambda: honest + b"[[a]]\n" * 150_000
    yield "a number of a million digits", lambda: honest + b"a = " + b"9" * 1_000_000 + b"\n"
    yield "a long text", lambda: honest + b'a = """' + b"\\" * 500_000 + b'"""\n'
    yield "a comment of 1 MB", lambda: honest + b"#" * 1_000_000
    yield "empty lines", lambda: honest + b"\n" * 1_000_000
    yield "dates", lambda: honest + b"".join(b"d%d = 1979-05-27T07:32:00Z\n" % k for k in range(30_000))
    yield "zeros", lambda: bytes(1_000_000)


@cache
def _result(kind: int) -> bytes:
    from formats.results import result_bytes

    return result_bytes((fit_result, diagnosis)[kind](), Path("r.json"))


def _results() -> Iterator[tuple[str, Callable[[], bytes]]]:
    one = lambda **more: json.dumps(json.loads(_result(0)) | more).encode()  # noqa: E731
    yield "deep lists", lambda: b'{"format": ' + b"[" * 4_000_000
    yield "many notes", lambda: one(notes=["n"] * 2_000_000)
    yield "an unknown field of numbers", lambda: one(other=[0] * 4_000_000)
    yield "an unknown field of empty maps", lambda: one(other=[{}] * 4_000_000)
    yield "an unknown field of short maps", lambda: one(other=[{"a": 1}] * 1_000_000)
    yield "an unknown field of long numbers", lambda: one(other=[10**300] * 20_000)
    yield "a field a million times", lambda: _result(0)[:-3] + b',"a":1' * 1_200_000 + b"}"
    yield "many fields", lambda: one(**{f"f{k}": 1 for k in range(500_000)})
    yield "a number of a million digits", lambda: _result(0)[:-3] + b',"a":' + b"9" * 8_000_000 + b"}"
    yield "a long text", lambda: one(created="x" * 8_000_000)
    yield "a text of escapes", lambda: _result(0)[:-3] + b',"a":"' + b"\\u0041" * 1_300_000 + b'"}'
    yield "spaces", lambda: _result(0) + b" " * 8_000_000
    yield "a wrong digest, a diagnosis", lambda: _result(1).replace(b'"created": "', b'"created": "x')
    yield "zeros", lambda: bytes(8_000_000)


@cache
def _recording() -> bytes:
    from tests.firmware_host.test_openni2_sensor import write_recording

    with tempfile.TemporaryDirectory() as folder:
        return Path(write_recording(Path(folder) / "a.oni", 30)).read_bytes()


def _onis() -> Iterator[tuple[str, Callable[[], bytes]]]:
    from firmware_host.oni_records import RECORD_HEADER, RECORD_MAGIC

    record = lambda kind, size=0: RECORD_HEADER.pack(RECORD_MAGIC, kind, 1, 28, size, 0)  # noqa: E731
    head = lambda: _recording()[:24]  # noqa: E731
    for kind in range(16):
        yield f"records of kind {kind} without content", lambda kind=kind: head() + record(kind) * 280_000
    yield "records without content behind a whole recording", lambda: _recording() + record(10) * 280_000
    yield "zeros behind a whole recording", lambda: _recording() + bytes(8_000_000)
    yield "a seek table of 8 MB", lambda: head() + record(14, 8_000_000) + bytes(8_000_000)
    yield "zeros", lambda: bytes(8_000_000)
    yield "noise", lambda: head() + random.Random(1).randbytes(8_000_000)


def inputs() -> Iterator[Input]:
    """Yield every hostile file."""
    for kind in ("trc", "vicon", "motive", "qualisys", "ours"):
        ending = {"trc": ".trc", "qualisys": ".tsv"}.get(kind, ".csv")
        for name, make in _texts(kind):
            yield Input("markers", f"{kind}: {name}", ending, make, lambda kind=kind: table(kind))
    for name, make in _c3ds():
        yield Input("markers", f"c3d: {name}", ".c3d", make, _c3d)
    for name, make in _garments():
        for reader, honest in (("garment", GARMENT), ("rig", RIG)):
            yield Input(reader, f"{reader}: {name}", ".toml", make, dump_description(honest).encode)
    for name, make in _results():
        yield Input("result", f"result: {name}", ".json", make, lambda: _result(0))
    for name, make in _onis():
        yield Input("oni", f"oni: {name}", ".oni", make, _recording)
    raw = (HERE / "version-2.mcap").read_bytes()
    for name, bomb in BOMBS.items():
        yield Input("take", f"take: {name}", ".mcap", lambda bomb=bomb: bomb(raw), lambda: raw)


def measure(words: str = "") -> int:
    """Measure the inputs whose names hold these words, print each, and return the number of dear ones."""
    found = 0
    with tempfile.TemporaryDirectory(prefix="hangtime-hostile-") as folder, MeasuredReading() as reading:
        shares: dict[tuple[str, str], tuple[float, float]] = {}
        for one in inputs():
            if words not in one.name:
                continue
            path, kind = Path(folder) / f"a{one.ending}", one.name.partition(":")[0]
            if (kind, one.reader) not in shares:
                path.write_bytes(one.honest())
                cost = reading(one.reader, path)
                length = path.stat().st_size
                shares[kind, one.reader] = (cost["seconds"] / length, cost["megabytes"] / length)
                assert not cost["said"], (one.name, cost)
            path.write_bytes(one.make())
            size, cost = path.stat().st_size, reading(one.reader, path)
            share = [size * part if size > SIZE // 2 else 0.0 for part in shares[kind, one.reader]]
            seconds, megabytes = cost["seconds"] - share[0], cost["megabytes"] - share[1]
            is_dear = seconds > MOST_SECONDS or megabytes > MOST_MEGABYTES or cost["said"].startswith("TRACEBACK")
            found += is_dear
            print(
                f"{'DEAR ' if is_dear else ''}{one.name}: {seconds:.2f} s and {megabytes:.0f} MB beyond "
                f"{share[0]:.2f} s and {share[1]:.0f} MB of {size / 1e6:.1f} MB; {cost['said'][:110] or 'read'}",
                flush=True,
            )
    return found
