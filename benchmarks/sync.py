"""Count takes that are lost, duplicated or damaged when sync is killed, the server fails, or the device is offline.

- --killed: SIGKILL ends a process of sync at random moments. Half of the rounds are against rclone's S3 server over
  TLS, half against a folder. Each round two takes are recorded; verified ones leave by a quota. The last run is not
  killed.
- --storms: a proxy stands between sync and server. It answers 500, 403, 503, 507 or another clock, slowly, not at all,
  or with a flipped bit. It resets before, within and after a request. The server is killed and started again. The first
  half of the rounds is against rclone, which ignores If-None-Match, the second against moto.
- --week: takes queue while nothing answers, then the server is there. Peak memory is that of the process, with a tenth
  of the takes and with all.

Every object on the server is hashed and compared with the take that was recorded.

Run: python benchmarks/sync.py [--killed 500] [--storms 200] [--week 500]. Without an option all three, in a few
minutes.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import logging
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from capture.appliance.receipts import receipts  # noqa: E402
from capture.appliance.spool import KeptTake, Spool  # noqa: E402
from capture.appliance.sync_status import read_status  # noqa: E402
from capture.sync.process import start  # noqa: E402
from capture.sync.rounds import Sync  # noqa: E402
from capture.sync.settings import SyncSetup  # noqa: E402
from tests.capture.appliance.spool_takes import record  # noqa: E402
from tests.capture.sync.servers import (  # noqa: E402
    CREDENTIALS,
    FAULTS,
    HOST,
    KEY,
    SECRET,
    Authority,
    Moto,
    Proxy,
    Rclone,
    setup_of,
)

MOST_GROWTH = 5.0  # MB of peak memory from a tenth of the takes to all
KILL_WITHIN = 1.15  # of the last run's duration: some runs end before their kill


@dataclass
class Ledger:
    """The recorded takes, each of which must be on the server."""

    takes: dict[int, str] = field(default_factory=dict)  # sequence to SHA-256

    def add(self, take: KeptTake) -> None:
        """Note a take that was kept."""
        self.takes[take.sequence] = take.facts["sha256"]

    def compare(self, objects: dict[str, bytes]) -> dict[str, int]:
        """Compare the server's objects with the recorded takes; return the counts."""
        names = [(int(found[1]), found[2]) for key in objects if (found := re.search(r"/(\d{6})-(\w{64})\.mcap$", key))]
        counted = Counter(number for number, _ in names)
        return {
            "recorded": len(self.takes),
            "lost": len(set(self.takes) - set(counted)),
            "doubled": len(objects) - len(counted),
            "damaged": sum(
                hashlib.sha256(content).hexdigest() not in key or self.takes.get(number) not in key
                for (key, content), (number, _) in zip(objects.items(), names, strict=True)
            )
            if len(names) == len(objects)
            else len(objects) - len(names),
        }


class Runs:
    """Starts runs of sync: a process with all modules loaded forks each run, so that it begins at once."""

    def __init__(self, config: Path) -> None:
        """Start the process and load all modules."""
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__)), "--fork-for", str(config)], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        self._line()

    def start(self) -> int:
        """Begin a run; returns its process id."""
        assert self._process.stdin is not None
        self._process.stdin.write("run\n")
        self._process.stdin.flush()
        return int(self._line())

    def wait(self) -> int:
        """Return the run's exit code, as of `os.waitstatus_to_exitcode`."""
        return int(self._line())

    def close(self) -> None:
        """Start no more."""
        self._process.kill()
        self._process.communicate()

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()


def fork_for(config: Path) -> None:
    """Fork a run for each line of stdin; print its process id, and how it ended."""
    print(0, flush=True)
    for _ in sys.stdin:
        pid = os.fork()
        if pid == 0:
            os._exit(start("run", config, None))
        print(pid, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)


def killed(rounds: int, folder: Path, *, seed: int = 1) -> dict[str, int]:
    """Kill runs of sync at random moments, half of them against a bucket and half against a folder."""
    chance = random.Random(seed)
    total: Counter[str] = Counter()
    authority = Authority.make(folder / "authority")
    with Rclone(folder / "s3", authority) as server:
        bucket = f'url = "s3://takes"\nendpoint = "https://{HOST}:{server.port}"\n'
        bucket += f'region = "us-east-1"\nca = "{authority.ca}"\n'
        for kind, lines in (("bucket", bucket), ("folder", f'url = "file://{folder}/folder-server"\n')):
            place = folder / kind
            place.mkdir()
            keys = place / "keys.toml"
            keys.touch(0o600)
            keys.write_text(f'access_key_id = "{KEY}"\nsecret_access_key = "{SECRET}"\n' if kind == "bucket" else "")
            config = place / "appliance.toml"
            config.write_text(
                f'[spool]\nfolder = "spool"\n[sync]\n{lines}device = "box"\ncredentials = "keys.toml"\n'
                "[sync.retention]\nquota_bytes = 0\nleast_free_bytes = 0\n"
            )
            ledger = Ledger()
            runs = Runs(config)
            with Spool(place / "spool") as spool:
                hits = _kill(spool, ledger, runs, rounds // 2, chance)
                code = -1
                for _ in range(3):  # left alone
                    runs.start()
                    code = runs.wait()
                waiting = len(spool.waiting())
            runs.close()
            objects = server.objects() if kind == "bucket" else _files(folder / "folder-server")
            total.update(ledger.compare(objects))
            total.update({"killed": hits, "waiting": waiting, "last exit code": code})
            total["receipts missing"] += len(set(ledger.takes) - {one.sequence for one in receipts(place / "spool")})
    return dict(total)


def _kill(spool: Spool, ledger: Ledger, runs: Runs, rounds: int, chance: random.Random) -> int:
    """Record two takes and kill a run, until this number of kills has hit a run."""
    lasted, hits = 0.5, 0
    while hits < rounds:
        for _ in range(2):
            ledger.add(record(spool, chance.randrange(35, 200), seed=chance.randrange(1 << 30)))
        begun = time.monotonic()
        pid = runs.start()
        time.sleep(chance.uniform(0.0, KILL_WITHIN * lasted))
        os.kill(pid, signal.SIGKILL) if Path(f"/proc/{pid}").exists() else None
        if runs.wait() == -signal.SIGKILL:
            hits += 1
        else:
            lasted = time.monotonic() - begun
    return hits


def storms(rounds: int, folder: Path, *, seed: int = 2, say: Callable[[str], None] = print) -> dict[str, int]:
    """Upload takes under every fault, half of the rounds to rclone and half to moto."""
    chance = random.Random(seed)
    total: Counter[str] = Counter()
    said: dict[str, str] = {}
    authority = Authority.make(folder / "authority")
    for kind in ("rclone", "moto"):
        server = Rclone(folder / kind, authority) if kind == "rclone" else Moto(authority)
        faults = [*FAULTS, "killed"] if kind == "rclone" else list(FAULTS)  # moto loses its objects when it is killed
        ledger = Ledger()
        with server, Proxy(server, authority) as proxy, Spool(folder / f"spool-{kind}") as spool:
            for number in range(rounds // 2):
                ledger.add(record(spool, chance.randrange(35, 100), seed=chance.randrange(1 << 30)))
                fault = faults[number % len(faults)]
                total.update(_storm(spool, server, proxy, authority, fault, chance))
                if (status := read_status(spool.folder)) and status.fault:
                    said[fault] = status.fault.sentence
            proxy.fault = lambda method, path: ""
            sync = _sync(setup_of(spool.folder, proxy, authority))
            for _ in range(5):
                if sync.once() is None:
                    break
            total["waiting"] += len(spool.waiting())
            total.update(ledger.compare(server.objects()))
    for fault, sentence in sorted(said.items()):
        say(f"  {fault}: {sentence}")
    total["faults that were reported"] = len(said)
    return dict(total)


def _storm(
    spool: Spool, server: Rclone | Moto, proxy: Proxy, authority: Authority, fault: str, chance: random.Random
) -> Counter[str]:
    """Upload the waiting takes while every other request hits the fault."""
    if fault == "killed" and isinstance(server, Rclone):
        server.kill()
        _sync(setup_of(spool.folder, server, authority)).once()
        server.start()
        return Counter({"requests that met a fault": 1})
    first = [True]

    def meet(method: str, path: str) -> str:
        meets = first[0] or chance.random() < 0.5
        first[0] = False
        return fault if meets else ""

    proxy.fault, proxy.done[:] = meet, []
    patience = {"timeout_s": 1.0} if fault == "silent" else {}
    for _ in range(2):
        _sync(setup_of(spool.folder, proxy, authority, **patience)).once()
    return Counter({"requests that met a fault": sum(met != "" for _, met in proxy.done)})


def _sync(setup: SyncSetup) -> Sync:
    return Sync(setup, CREDENTIALS, sleep=lambda seconds: None)


def week(count: int, folder: Path) -> dict[str, float]:
    """Queue takes while offline, then upload them; return peak memory [MB] with a tenth of them and with all."""
    authority = Authority.make(folder / "authority")
    found: dict[str, float] = {}
    for name, takes in (("tenth", count // 10), ("all", count)):
        ledger, spool_folder = Ledger(), folder / f"spool-{name}"
        with Rclone(folder / f"s3-{name}", authority) as server, Proxy(server, authority) as proxy:
            server.kill()
            order: list[int] = []
            proxy.fault = lambda method, path, order=order: order.append(_number(path)) or "" if method == "PUT" else ""
            with Spool(spool_folder) as spool:
                for number in range(takes):
                    ledger.add(record(spool, 35 + number % 20, seed=number))
                for _ in range(5):
                    assert _sync(setup_of(spool_folder, proxy, authority)).once() is not None
            server.start()
            order.clear()
            peak, code, seconds = _peak_of_run(folder, spool_folder, proxy.port, authority)
            found[f"MB, {name}"] = peak
            if name == "all":
                found |= {key: float(value) for key, value in ledger.compare(server.objects()).items()}
                found |= {
                    "out of order": float(sum(a > b for a, b in itertools.pairwise(order))),
                    "exit code": float(code), "seconds": seconds,
                }  # fmt: skip
    return found


def _peak_of_run(folder: Path, spool: Path, port: int, authority: Authority) -> tuple[float, int, float]:
    keys = folder / "keys.toml"
    keys.touch(0o600)
    keys.write_text(f'access_key_id = "{KEY}"\nsecret_access_key = "{SECRET}"\n')
    config = folder / "appliance.toml"
    config.write_text(
        f'[spool]\nfolder = "{spool}"\n[sync]\nurl = "s3://takes"\nendpoint = "https://{HOST}:{port}"\n'
        f'region = "us-east-1"\nca = "{authority.ca}"\ncredentials = "keys.toml"\n'
    )
    begun = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "capture.sync", "run", "--config", str(config)], cwd=ROOT, stderr=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_maxrss / 1024, process.returncode, time.monotonic() - begun


def _number(path: str) -> int:
    found = re.search(r"/(\d{6})-", path)
    return int(found[1]) if found else -1


def _files(top: Path) -> dict[str, bytes]:
    return {str(path.relative_to(top)): path.read_bytes() for path in sorted(top.rglob("*")) if path.is_file()}


def _print(name: str, found: dict[str, float] | dict[str, int], seconds: float) -> None:
    counts = ", ".join(f"{key} {value:g}" for key, value in found.items())
    print(f"{name}: {counts}; {seconds:.0f} s", flush=True)


def main() -> int:
    """Run the chosen tests; exit code 1 if a take was lost, duplicated or damaged, or memory grew."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--killed", type=int, metavar="COUNT", help="kills")
    words.add_argument("--storms", type=int, metavar="COUNT", help="rounds")
    words.add_argument("--week", type=int, metavar="COUNT", help="takes")
    words.add_argument("--fork-for", type=Path, help=argparse.SUPPRESS)
    options = words.parse_args()
    if options.fork_for is not None:
        fork_for(options.fork_for)
        return 0
    logging.getLogger("hangtime.sync").setLevel(logging.CRITICAL)
    counts = {"killed": options.killed, "storms": options.storms, "week": options.week}
    if not any(counts.values()):
        counts = {"killed": 500, "storms": 200, "week": 500}
    is_well = True
    for name, trial in (("killed", killed), ("storms", storms), ("week", week)):
        if not counts[name]:
            continue
        with tempfile.TemporaryDirectory(prefix="hangtime-sync") as place:
            begun = time.monotonic()
            found: dict[str, float] = dict(trial(counts[name], Path(place)))  # type: ignore[operator]
        _print(name, found, time.monotonic() - begun)
        is_well &= not any(found.get(key) for key in ("lost", "doubled", "damaged", "waiting", "out of order"))
        if name == "week":
            is_well &= found["MB, all"] - found["MB, tenth"] <= MOST_GROWTH
    return 0 if is_well else 1


if __name__ == "__main__":
    sys.exit(main())
