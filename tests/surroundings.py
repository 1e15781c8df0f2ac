"""What commands of the pages find around them: sensors on the USB bus, a running appliance, an appliance's takes."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from capture.appliance.control import ControlServer
from capture.appliance.spool import Spool
from tests.capture.appliance.spool_takes import record
from tests.capture.appliance.test_status_lines import told
from tests.firmware_host.usb_stage.models import KinectCameraModel, KinectMotorModel, Ps1080Model
from tests.fit.batch.night import free_port, keys_for, serving
from tests.fit.here import hangtime_here

PS1080, KINECT, EMPTY = "a PS1080", "a Kinect", "an empty bus"
APPLIANCE, BUCKET = "an appliance", "a bucket"
MODELS = {EMPTY: (), PS1080: (Ps1080Model,), KINECT: (KinectCameraModel, KinectMotorModel)}
STREAM = "synthetic:swing?seconds=1"
STATUS = {"ok": True, "state": "armed", "line": "nothing", **told()}


@contextlib.contextmanager
def surroundings(name: str, folder: Path) -> Iterator[None]:
    """Context of a name of `MODELS`, `APPLIANCE`, `BUCKET` with a take of the folder, or '' for none."""
    with pytest.MonkeyPatch.context() as patch:
        if name == BUCKET:
            with serving_bucket(folder) as environment:
                for key, value in environment.items():
                    patch.setenv(key, value)
                yield
            return
        if name == APPLIANCE:
            with answering_daemon() as socket:
                patch.setenv("HANGTIME_SOCKET", str(socket))
                yield
            return
        if name:
            put_on_the_bus(patch, name)
        yield


def put_on_the_bus(patch: pytest.MonkeyPatch, name: str) -> None:
    """Replace libusb by a bus of models, and OpenNI2's streams by a synthetic sensor: no test depends on what is there.

    OpenNI2 itself lists no sensor, and its driver counts as installed.
    """
    from firmware_host import openni2_library
    from firmware_host.doctor import stream_checks
    from firmware_host.opening import open_sensor
    from firmware_host.usb_control import devices
    from tests.firmware_host.usb_stage.in_process import ModelBackend

    backend = ModelBackend(*(model() for model in MODELS[name]))
    patch.setattr(devices, "load_backend", lambda: backend)
    patch.setattr(openni2_library, "live_uris", list)
    patch.setattr(openni2_library, "load", lambda: None)
    patch.setattr(openni2_library, "find_driver", lambda driver: Path(f"/drivers/lib{driver}.so.0"))
    patch.setattr(stream_checks, "OpenNI2Sensor", lambda device: open_sensor(STREAM))


@contextlib.contextmanager
def serving_bucket(folder: Path) -> Iterator[dict[str, str]]:
    """Serve a bucket that holds the folder's first swing, and yield the environment that opens it."""
    root, port = folder / "served", free_port()
    (root / "bucket/takes").mkdir(parents=True)
    shutil.copy(folder / "swing.mcap", root / "bucket/takes")
    with serving(root, port):
        yield keys_for(port)


@contextlib.contextmanager
def answering_daemon() -> Iterator[Path]:
    """Context with the real socket of an appliance, in a folder of a short name, that answers with `STATUS`."""
    with tempfile.TemporaryDirectory() as folder:
        server, is_over = ControlServer(Path(folder) / "control.sock"), threading.Event()

        def serve() -> None:
            while not is_over.wait(0.01):
                server.serve(lambda _: STATUS)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield Path(folder) / "control.sock"
        finally:
            is_over.set()
            thread.join()
            server.close()


def keep_appliance(folder: Path) -> None:
    """Write an appliance's configuration and two takes, of which sync has uploaded both to a folder."""
    with Spool(folder / "spool") as spool:
        for seed in range(2):
            record(spool, 40, seed=seed)
    (folder / "appliance.toml").write_text(
        f'[spool]\nfolder = "spool"\n[sync]\nurl = "file://{folder}/server"\ndevice = "box"\n'
    )
    done = hangtime_here("sync", "run", "--config", "appliance.toml", folder=folder)
    assert done.returncode == 0, done.stderr
