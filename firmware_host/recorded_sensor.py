"""Play recordings with OpenNI2 in a separate process, so that a damaged file may crash the library but not the command.

The process opens the recording through a link of an ASCII name in its working folder, since the library crashes on
other names and folders. It sends the output of `OpenNI2Sensor`: `SensorInfo` first, then every frame, then None. An
error may replace any of them. It ends with the pipe that it writes to.
Run: python -m firmware_host.recorded_sensor LINK PIPE [--anyway].
"""

from __future__ import annotations

import contextlib
import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

from firmware_host.depth_sensor import STALL_TIMEOUT, DepthSensor, SensorFrame, SensorInfo
from firmware_host.errors import RecordingError, SensorError, SensorUnavailableError
from firmware_host.oni_records import summarise
from firmware_host.openni2_sensor import CLOCK, COPY_AGAIN, OpenNI2Sensor

LONGEST_SILENCE = 60.0  # s: OpenNI2 reads a recorded frame in milliseconds, on a busy computer in a second
LINK = "recording.oni"  # relative to the working folder, whose path may have letters that the library crashes on
LARGEST_MESSAGE = 1 << 26  # bytes of one message: a depth and a colour frame have 1.5 MB


class RecordedSensor(DepthSensor):
    """An `.oni` recording, played in a separate process."""

    def __init__(self, path: Path, *, anyway: bool = False) -> None:
        """Open a recording; anyway: accept its stamps at any stated rate.

        Raises:
            SensorUnavailableError: no library.
            RecordingError: the file is missing, not a recording, or one that crashes the library.
        """
        self._path = path
        summarise(path)  # raises an error with the cause if the file is not a recording
        self._folder = tempfile.TemporaryDirectory(prefix="hangtime-")
        (Path(self._folder.name) / LINK).symlink_to(path.resolve())
        reading, writing = os.pipe()
        self._pipe = os.fdopen(reading, "rb")
        words = [sys.executable, "-m", "firmware_host.recorded_sensor", LINK, str(writing)]
        words += ["--anyway"] if anyway else []
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(os.path.abspath(part) for part in sys.path if part)}
        # A new session: Ctrl-C reaches only the command, which ends this process by closing the pipe.
        self._process = subprocess.Popen(
            words, pass_fds=[writing], env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True, cwd=self._folder.name,
        )  # fmt: skip
        os.close(writing)
        self._is_at_end = False
        try:
            self._info: SensorInfo = replace(self._receive(), uri=str(path))
        except BaseException:
            self.close()
            raise

    @property
    def info(self) -> SensorInfo:
        """Return the recording's properties."""
        return self._info

    def read(self, timeout_s: float = STALL_TIMEOUT) -> SensorFrame | None:
        """Return the next frame, or None from the end of the recording on.

        Raises:
            RecordingError: the recording cannot be played any further.
        """
        if self._is_at_end:
            return None
        frame: SensorFrame | None = self._receive()
        if frame is None:
            self.close()
            return None
        return replace(frame, host_time_s=time.clock_gettime(CLOCK))

    def _receive(self) -> Any:
        """Return the next message; raise the error that it contains, or an error if the process crashed."""
        try:
            (size,) = struct.unpack("<Q", self._bytes(8))
            content = pickle.loads(self._bytes(min(size, LARGEST_MESSAGE)))
        except EOFError as error:
            self.close()
            raise RecordingError(
                "OpenNI2 crashed while it played this recording", where=self._path, advice=COPY_AGAIN
            ) from error
        if isinstance(content, tuple):
            self.close()
            is_missing, what, advice = content
            kind = SensorUnavailableError if is_missing else RecordingError
            raise kind(what, where=self._path, advice=advice)
        return content

    def _bytes(self, size: int) -> bytes:
        if not select.select([self._pipe], [], [], LONGEST_SILENCE)[0]:
            self.close()
            raise RecordingError(
                f"OpenNI2 gave no frame for {LONGEST_SILENCE:g} s", where=self._path, advice=COPY_AGAIN
            )
        found = self._pipe.read(size)
        if len(found) < size:
            raise EOFError
        return found

    def close(self) -> None:
        """End the process; closing twice is allowed."""
        self._is_at_end = True
        self._pipe.close()
        if self._process.poll() is None:
            self._process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(STALL_TIMEOUT)
            self._process.kill()
        self._process.wait()
        self._folder.cleanup()


def main() -> None:
    """Play the recording of the command line into its pipe."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    with os.fdopen(int(sys.argv[2]), "wb") as pipe:
        try:
            with OpenNI2Sensor(Path(sys.argv[1]), anyway="--anyway" in sys.argv[3:]) as sensor:
                _send(pipe, sensor.info)
                for frame in sensor.frames():
                    _send(pipe, frame)
            _send(pipe, None)
        except SensorError as error:
            _send(pipe, (isinstance(error, SensorUnavailableError), error.what, error.advice))


def _send(pipe: BinaryIO, content: object) -> None:
    raw = pickle.dumps(content, protocol=5)
    pipe.write(struct.pack("<Q", len(raw)) + raw)
    pipe.flush()


if __name__ == "__main__":
    main()
