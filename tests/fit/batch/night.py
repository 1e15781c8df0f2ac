"""Takes, commands and servers for the tests of `hangtime batch`."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil

from fit.cloth.model import Resolution
from formats.archive import write_take
from tests.fit.scenes import material, sheet, simulate_take, swing

SHORT = ("--method", "kinect-skirt", "--iterations", "8", "--spacing", "0.1")
PROGRAMS = Path(sys.executable).parent


def make_takes(folder, count):
    """Takes of one swatch, swung 0.7, 0.8, ... times a second."""
    frames, garment = np.arange(0, 2.5, 1 / 30), sheet()
    for k in range(count):
        path = swing(frames, amplitude=0.06, hz=0.7 + 0.1 * k)
        take = simulate_take(
            garment, frames, path, material(garment, velocity_damping=3.0), noise=0.002, seed=k, name=f"swing{k}",
            resolution=Resolution(spacing=0.1),
        )  # fmt: skip
        write_take(folder / f"swing{k}.mcap", take)
    return folder


STARTED: list[subprocess.Popen] = []  # by the test that runs; `conftest.py` ends them after it


def start(*words, folder, **environment):
    """Start `hangtime` with these words; its output goes to files of the folder."""
    with (folder / "stdout").open("w") as out, (folder / "stderr").open("w") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "formats.command", *map(str, words)], stdout=out, stderr=err, cwd=folder,
            env={**os.environ, **environment}, start_new_session=True,
        )  # fmt: skip
    STARTED.append(process)
    return process


def end(process):
    """Kill a process that leads a session, with all its children."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def said(folder):
    """What the last started command wrote, both streams."""
    return (folder / "stdout").read_text() + (folder / "stderr").read_text()


HANGS = 600.0  # s of wall time; less says nothing where each process has a tenth of a processor


def wait_for(condition, seconds=HANGS):
    """Return the first true value of a condition that another process brings about."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        found = condition()
        if found:
            return found
        time.sleep(0.02)
    raise AssertionError(f"not within {seconds:g} s")


def worker_pids(process):
    """Process ids of the dask workers that a batch started on this machine.

    Where setproctitle is installed, dask gives them a title in place of the words they were started with.
    """
    found = []
    with contextlib.suppress(psutil.Error):
        for child in psutil.Process(process.pid).children(recursive=True):
            with contextlib.suppress(psutil.Error):
                if any("spawn_main" in word or word.startswith("dask worker") for word in child.cmdline()):
                    found.append(child.pid)
    return found


def kill(pid):
    """End a process as a crash or the kernel would: at once, with nothing tidied up."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def free_port():
    """A port of the loopback interface that was free a moment ago."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def is_listening(port):
    """Whether something answers at this port."""
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


@contextlib.contextmanager
def running(*words, **environment):
    """Run a program for the length of a block, then kill it with all its children."""
    process = subprocess.Popen(
        [*map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        env={**os.environ, **environment},
    )  # fmt: skip
    try:
        yield process
    finally:
        end(process)


def scheduler_at(port):
    """The command of a dask scheduler on the loopback interface."""
    return PROGRAMS / "dask", "scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"


@contextlib.contextmanager
def serving(root, port):
    """Serve the buckets that are folders of `root`, as an S3 server that checks signatures."""
    program = shutil.which("rclone", path=str(PROGRAMS)) or "rclone"
    words = (program, "serve", "s3", root, "--addr", f"127.0.0.1:{port}", "--auth-key", "night,secret", "--config", "")
    with running(*words):
        wait_for(lambda: is_listening(port))
        yield


def keys_for(port):
    """The environment that opens these buckets."""
    return {
        "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}", "AWS_ALLOW_HTTP": "true", "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "night", "AWS_SECRET_ACCESS_KEY": "secret",
    }  # fmt: skip
