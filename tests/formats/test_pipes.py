"""A pipe in place of a file is refused before it is opened, since opening it would block."""

from __future__ import annotations

import os
import signal

import pytest

from firmware_host.errors import RecordingError
from firmware_host.oni_records import read_records
from formats.descriptions import load_garment, load_rig
from formats.errors import HangtimeError
from formats.importers.marker_files import read_marker_tracks
from formats.importers.swung_cloth import import_swung_cloth
from formats.results import load_diagnosis, load_fit_result


def opens_bvh(path):
    pytest.importorskip("taichi")  # what belongs to the fitter comes with it
    from fit.figure.bvh import read_bvh

    read_bvh(path, 1.7)


@pytest.fixture
def _patience():
    """Five seconds, after which waiting is an error."""

    def end(number, frame):
        raise TimeoutError("it waits for the pipe")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(5)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.usefixtures("_patience")
@pytest.mark.parametrize(
    "read",
    [
        load_garment, load_rig, load_fit_result, load_diagnosis, import_swung_cloth, read_marker_tracks, opens_bvh,
        lambda path: list(read_records(path)),
    ],
)  # fmt: skip
def test_a_pipe_is_refused_at_once(read, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises((HangtimeError, RecordingError), match="a pipe or a device"):
        read(tmp_path / "pipe")
