"""Measure memory and lost frames of a long recording, while another process occupies a whole core.

Three processes run. One publishes pictures 30 times a second, as a live sensor's driver does, and keeps only the
newest. One records as `hangtime record` does (priority, queue, tracking, take on the disk). One keeps a processor
busy. Every `HITCH_EVERY` seconds tracking halts for `HITCH` seconds, as on a disk that does not respond. A
frame is lost if the recorder never got it, by the publisher's own count.

Run: python benchmarks/endurance.py [--minutes 30] [--hogs 1] [--ordinary]. Without an option it takes one minute. The
publisher stands for hardware, so it runs before all others if permitted (root). With --ordinary the recorder asks for
no precedence, like a user without the right.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

WIDTH, HEIGHT, FPS = 640, 480, 30.0
DEPTH_BYTES, COLOUR_BYTES = 2 * WIDTH * HEIGHT, 3 * WIDTH * HEIGHT
SLOT = DEPTH_BYTES + COLOUR_BYTES
SLOTS = 4  # the newest frame, the frame being written, and one that is still being read
MOST_MEMORY = 110.0  # MB
FLAT = 2.0  # MB from the first third of the recording to the last
WARM_UP = 5.0  # s after which memory is measured
HITCH, HITCH_EVERY = 1.0, 20.0  # s
CLOSEST = 0.9  # of a frame's time between two images; a late sensor does not catch up
HARDWARE = 50  # real-time priority of the publisher, that of the kernel's interrupt threads
COLOUR_NOISE = 3.0  # of 255, in light so dim that compression saves hardly a third
LOOP = 30  # pictures, a hanger that swings to and fro once


class Board:
    """Shared memory of images for another process: a counter and slots, of which the newest overwrites the oldest."""

    SIZE = 64 + SLOTS * SLOT

    def __init__(self, path: Path) -> None:
        self._memory = np.memmap(path, np.uint8, "r+")
        self.count = self._memory[:8].view(np.int64)

    def _slot(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        at = 64 + (number % SLOTS) * SLOT
        depth = self._memory[at : at + DEPTH_BYTES].view(np.uint16).reshape(HEIGHT, WIDTH)
        return depth, self._memory[at + DEPTH_BYTES : at + SLOT].reshape(HEIGHT, WIDTH, 3)

    def put(self, number: int, pictures: tuple[np.ndarray, np.ndarray]) -> None:
        """Publish image `number`, from 1."""
        for place, picture in zip(self._slot(number), pictures, strict=True):
            place[:] = picture
        self.count[0] = number

    def get(self) -> tuple[int, np.ndarray, np.ndarray]:
        """Return a copy of the newest image, and its number."""
        while True:
            number = int(self.count[0])
            depth, colour = (np.array(place) for place in self._slot(number))
            if self.count[0] - number < SLOTS - 1:  # was not overwritten meanwhile
                return number, depth, colour


def swung_pictures() -> list[tuple[np.ndarray, np.ndarray]]:
    """A hanger with a towel that swings to and fro by 8 cm, and the camera's faults; every colour has its own noise."""
    from tests.capture.stage import marker_plate, pictures, plain_plate

    rng = np.random.default_rng(1)
    shown = []
    for k in range(LOOP):
        middle = np.array([0.03, 0.0, 0.08]) * np.sin(2 * np.pi * k / LOOP) + np.array([0.0, -0.2, 1.6])
        plates = [marker_plate(i, middle + np.array([side, 0, 0])) for i, side in ((0, -0.15), (1, 0.15))]
        towel = plain_plate(middle + np.array([0, 0.29, 0]), (0.4, 0.4), (60, 70, 150))
        depth, colour = pictures([*plates, towel], rng)
        noisy = colour + COLOUR_NOISE * rng.standard_normal(colour.shape, np.float32)
        shown.append((depth, np.clip(np.rint(noisy), 0, 255).astype(np.uint8)))
    return shown


def publish(path: Path, seconds: float) -> None:
    """Publish images 30 times a second for a time [s], then set the counter to -1."""
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(HARDWARE))
    board = Board(path)
    shown = swung_pictures()
    print("ready", flush=True)
    sys.stdin.readline()
    start = time.monotonic()
    late, last = 0.0, -np.inf
    for number in range(1, round(seconds * FPS) + 1):
        due = start + number / FPS
        time.sleep(max(0.0, max(due, last + CLOSEST / FPS) - time.monotonic()))
        late = max(late, time.monotonic() - due)
        board.put(number, shown[number % LOOP])
        last = time.monotonic()
    time.sleep(0.5)
    board.count[0] = -1
    print(json.dumps({"published": round(seconds * FPS), "latest_ms": 1e3 * late}), flush=True)


def record_it(path: Path, out: Path, is_ordinary: bool) -> None:
    """Record from the shared memory; report the memory use over time."""
    from capture.recording.frame_queue import QueuedSensor
    from capture.recording.precedence import Precedence
    from capture.recording.session import record
    from firmware_host.depth_sensor import DepthSensor, SensorFrame, SensorInfo
    from formats.rig import Rig, Sensor
    from tests.capture.garment.towel import GARMENT, HANGER

    camera = Sensor(width=WIDTH, height=HEIGHT, fx=575.8, fy=575.8, cx=319.5, cy=239.5)

    class BoardSensor(DepthSensor):
        """The shared memory as a live sensor."""

        def __init__(self) -> None:
            self._board, self._last, self.missed = Board(path), 0, 0

        @property
        def info(self) -> SensorInfo:
            return SensorInfo(
                name="board", uri="board", width=WIDTH, height=HEIGHT, fps=FPS, intrinsics=camera, is_live=True
            )

        def read(self, timeout_s: float = 5.0) -> SensorFrame | None:
            while self._board.count[0] == self._last:
                time.sleep(0.001)
            if self._board.count[0] < 0:
                return None
            number, depth, colour = self._board.get()
            dropped, self._last = number - self._last - 1, number
            self.missed += dropped
            return SensorFrame(
                index=number - 1, time_s=number / FPS, host_time_s=time.monotonic(), depth=depth, colour=colour,
                dropped_before=dropped,
            )  # fmt: skip

        def close(self) -> None:
            pass

    rig = Rig(format="hangtime-rig/1", name="endurance", gravity=(0.0, 1.0, 0.0), hanger=HANGER, sensor=camera)
    memory: list[tuple[float, float]] = []
    reported, hitches, behind = 0, 0, 0.0  # no lists of frames: their memory would be counted as the recorder's
    begun = time.monotonic()
    print("ready", flush=True)

    def look(frame: SensorFrame, *sights: object) -> None:
        nonlocal reported, behind, hitches
        now = time.monotonic() - begun
        if now >= HITCH_EVERY * (hitches + 1):
            hitches += 1
            time.sleep(HITCH)
        reported += frame.dropped_before
        behind = max(behind, time.monotonic() - frame.host_time_s)
        if not memory or now - memory[-1][0] >= 1.0:
            memory.append((now, resident()))

    board, precedence = BoardSensor(), Precedence()
    with contextlib.nullcontext() if is_ordinary else precedence, QueuedSensor(board) as sensor:
        precedence.begin_tracking()
        report = record(sensor, rig, GARMENT, out, take_id="endurance", created="now", watch=look)
    print(
        json.dumps(
            {"frames": report.frames, "with_hanger": report.with_hanger, "reported": reported, "missed": board.missed,
             "memory": memory, "behind_ms": 1e3 * behind, "first": precedence.is_granted, "hitches": hitches}
        ),
        flush=True,
    )  # fmt: skip


def resident() -> float:
    """Return the current memory of this process [MB = 10^6 bytes], without the shared memory, which is the driver's."""
    lines = (line.split() for line in Path("/proc/self/status").read_text().splitlines())
    return sum(int(line[1]) for line in lines if line[0] in {"RssAnon:", "RssFile:"}) * 1024 / 1e6


def measure(seconds: float, hogs: int = 1, *, is_ordinary: bool = False) -> dict[str, float]:
    """Run all processes; return frames published, recorded, lost and reported, memory [MB], its growth, delays [ms]."""
    me = [sys.executable, "-W", "ignore", str(Path(__file__).resolve())]
    running: list[subprocess.Popen[str]] = []
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "cwd": ROOT}
    in_memory = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory() as folder, tempfile.NamedTemporaryFile(dir=in_memory) as board:
        Path(board.name).write_bytes(bytes(Board.SIZE))
        try:
            publisher = subprocess.Popen([*me, "--publish", board.name, "--seconds", str(seconds)], **pipes)
            running.append(publisher)
            publisher.stdout.readline()
            recorder = subprocess.Popen(
                [*me, "--record", board.name, "--out", f"{folder}/t.mcap", *["--ordinary"] * is_ordinary], **pipes
            )
            running.append(recorder)
            recorder.stdout.readline()
            running += [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(hogs)]
            publisher.stdin.write("go\n")
            publisher.stdin.flush()
            said = json.loads(recorder.stdout.readline()) | json.loads(publisher.stdout.readline())
        finally:
            for process in running:
                process.kill()
                process.wait()
                for pipe in (process.stdin, process.stdout):
                    if pipe is not None:
                        pipe.close()
    times, used = np.array(said.pop("memory")).T
    used = used[times >= WARM_UP] if (times >= WARM_UP).sum() >= 3 else used[-3:]
    third = max(len(used) // 3, 1)
    said["lost"] = said["published"] - said["frames"]
    return said | {"memory": float(used.max()), "growth": float(used[-third:].mean() - used[:third].mean())}


def main() -> None:
    """Print the table, or play one of the parts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--hogs", type=int, default=1, help="processes that take a core each")
    parser.add_argument("--ordinary", action="store_true", help="the recorder requests no real-time priority")
    for part in ("--publish", "--record", "--out", "--seconds"):
        parser.add_argument(part, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.publish:
        publish(Path(options.publish), float(options.seconds))
    elif options.record:
        record_it(Path(options.record), Path(options.out), options.ordinary)
    else:
        found = measure(60.0 * options.minutes, options.hogs, is_ordinary=options.ordinary)
        beside = f"{options.hogs} busy processes of its own, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
        print(f"{found['published']:.0f} frames in {options.minutes:g} minutes beside {beside}")
        rank = "before ordinary programs" if found["first"] else "an ordinary program"
        print(f"recorder {rank}, tracking stood still for {HITCH:g} s {found['hitches']:.0f} times")
        print(
            f"lost     {found['lost']:6.0f} frames   (target 0), {found['reported']:.0f} of them reported in the take"
        )
        print(
            f"         {found['missed']:6.0f} of them while the fetching thread was late, others found the queue full"
        )
        print(f"memory   {found['memory']:6.1f} MB at most   (target {MOST_MEMORY:g})")
        print(f"growth   {found['growth']:6.2f} MB from the first third to the last   (target {FLAT:g})")
        print(f"hanger   {100 * found['with_hanger'] / found['frames']:6.1f} % of the frames")
        print(f"behind   {found['behind_ms']:6.0f} ms at most from the sensor to the take")
        print(f"pictures {found['latest_ms']:6.0f} ms late at most, the publisher's own fault")


if __name__ == "__main__":
    main()
