"""Fuzz the readers: guided by coverage (atheris), or a number of random damages to a take archive.

Run: scripts/fuzz --help
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import resource
import sys
import time
import traceback
from pathlib import Path

MOST_SECONDS, MOST_MEGABYTES = 2.0, 256
RUNS = 60_000  # of one process: what atheris adds to code keeps 6 kB a run, which its own limit of memory counts


def guided(target: str, seconds: int, corpus: Path) -> None:
    """Fuzz one reader with atheris; a finding ends the process with a traceback and leaves the input file."""
    import atheris

    with atheris.instrument_imports(include=["formats", "firmware_host"]):
        from tests.fuzz.targets import TARGETS, seeds
    from formats.errors import HangtimeError

    folder = corpus / target
    folder.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(seeds(target)):
        (folder / f"seed-{number}").write_bytes(seed)

    def try_one(raw: bytes) -> None:
        with contextlib.suppress(HangtimeError):
            TARGETS[target](raw)

    words = [sys.argv[0], str(folder), f"-max_total_time={seconds}", f"-runs={RUNS}", "-rss_limit_mb=1024",
             "-timeout=10", "-max_len=65536", f"-artifact_prefix={folder}-found-"]  # fmt: skip
    atheris.Setup(words, try_one)
    atheris.Fuzz()


def damages(count: int, seed: int) -> dict[str, int]:
    """Damage a take archive this number of times; return the counts of the faults."""
    import numpy as np

    from formats.archive import take_of
    from tests.formats.damage import damaged, is_wrong
    from tests.formats.vectors.make import HERE

    raw, rng = (HERE / "version-2.mcap").read_bytes(), np.random.default_rng(seed)
    sound = take_of(raw, "sound")
    found = {"wrong": 0, "tracebacks": 0, "over 2 s": 0, "over 256 MB": 0}
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(count):
        broken = damaged(raw, rng)
        start = time.process_time()
        try:
            found["wrong"] += is_wrong(broken, sound)
        except Exception:
            traceback.print_exc()
            found["tracebacks"] += 1
        found["over 2 s"] += time.process_time() - start > MOST_SECONDS
    most = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    found["over 256 MB"] = int(most > MOST_MEGABYTES)
    return found


def _damages(job: tuple[int, int]) -> dict[str, int]:
    return damages(*job)


def main() -> None:
    """Run the fuzzers that the command line selects."""
    parser = argparse.ArgumentParser(prog="scripts/fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", metavar="TARGET", help="archive, c3d, text, oni, toml; default: all")
    parser.add_argument("--seconds", type=int, default=600, help="for all targets together (600)")
    parser.add_argument("--damages", type=int, default=0, help="instead, so many random damages to a take archive")
    parser.add_argument("--hostile", metavar="WORDS", help="instead, measure the hostile files that WORDS name")
    parser.add_argument("--corpus", type=Path, default=Path(".fuzz"), help="folder of inputs that are kept (.fuzz)")
    parser.add_argument("--only", help=argparse.SUPPRESS)
    words = parser.parse_args()
    if words.hostile is not None:
        from tests.fuzz.hostile import measure

        sys.exit(int(bool(measure(words.hostile))))
    if words.damages:
        processes = os.cpu_count() or 1
        jobs = [(words.damages // (10 * processes) + 1, seed) for seed in range(10 * processes)]
        total: dict[str, int] = {}
        with multiprocessing.Pool(processes) as pool:
            for done, found in enumerate(pool.imap_unordered(_damages, jobs), 1):
                total = {name: total.get(name, 0) + count for name, count in found.items()}
                print(f"{done * jobs[0][0]} damages: {total}", flush=True)
        sys.exit(int(any(total.values())))
    if words.only:
        guided(words.only, words.seconds, words.corpus)
        return
    from tests.fuzz.targets import TARGETS

    targets = words.targets or list(TARGETS)
    failed = 0
    for target in targets:  # a process each: atheris ends the one it runs in
        until, ended = time.monotonic() + max(words.seconds // len(targets), 1), 0
        while not ended and (left := until - time.monotonic()) > 0:
            ended = os.spawnl(
                os.P_WAIT, sys.executable, sys.executable, "-m", "tests.fuzz", "--only", target, "--seconds",
                str(max(int(left), 1)), "--corpus", str(words.corpus),
            )  # fmt: skip
        print(f"{target}: {'found something, see above' if ended else 'nothing found'}", flush=True)
        failed |= ended
    sys.exit(int(bool(failed)))


if __name__ == "__main__":
    main()
