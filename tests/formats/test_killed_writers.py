"""What a killed recording leaves is read, shown and recovered, with words that are true."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from formats.fault_words import STILL_WRITTEN
from tests.fit.here import hangtime_here

WRITER = """
import sys
from pathlib import Path
from tests.formats.test_unfinished import a_writer, add
writer = a_writer(Path(sys.argv[1]))
add(writer, int(sys.argv[2]))
print("written", flush=True)
sys.stdin.read()
"""


def left_by_a_killed_writer(folder, frames):
    """Return the file that a process left which was killed after some frames, and its state before."""
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, folder, str(frames)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "written\n"
        before = hangtime_here("takes", "verify", "t.mcap.partial", folder=folder)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    return before


def test_the_whole_seconds_of_a_killed_recording_are_read_shown_and_recovered(tmp_path):
    """Of 100 frames, three blocks of 31 or 32 are on the disk."""
    before = left_by_a_killed_writer(tmp_path, 100)
    name, told = "t.mcap.partial", "94 frames in 3 blocks; missing: from 3.10 s on; "
    verified = hangtime_here("takes", "verify", name, folder=tmp_path)
    assert verified.stdout == f"incomplete  {name}: {told}`hangtime takes recover` makes a sound file\n"
    assert before.stdout == f"incomplete  {name}: {told}{STILL_WRITTEN}\n"
    assert (before.returncode, verified.returncode) == (2, 2)
    shown = hangtime_here("takes", "show", name, folder=tmp_path)
    assert (shown.returncode, shown.stdout.splitlines()[:2]) == (0, [
        "take      t   (INCOMPLETE)", "missing   from 3.10 s on",
    ])  # fmt: skip
    recovered = hangtime_here("takes", "recover", name, folder=tmp_path)
    assert recovered.stdout == "t.recovered.mcap: 94 frames, missing: from 3.10 s on\n"
    assert hangtime_here("takes", "verify", "t.recovered.mcap", folder=tmp_path).returncode == 0
    assert (tmp_path / name).exists()


@pytest.mark.parametrize("command", ["verify", "recover"])
def test_a_recording_that_was_killed_in_its_first_second_says_so(tmp_path, command):
    """Its file has the profile and no block; how much of the header left its buffer depends on the specification."""
    left_by_a_killed_writer(tmp_path, 5)
    done = hangtime_here("takes", command, "t.mcap.partial", folder=tmp_path)
    assert done.returncode == 2
    said = done.stdout.rstrip().partition("t.mcap.partial: ")[2]
    assert said in (
        "holds no readable header; the recording ended in its first second, or too little of it is left",
        "holds no frame; the recording ended in its first second or is cut off",
    )
