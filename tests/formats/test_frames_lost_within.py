"""A marker file that holds fewer frames than it states: the frames that its numbers lack are named, with the place."""

from __future__ import annotations

import numpy as np
import pytest

from formats.errors import TakeError
from formats.importers.marker_files import read_marker_tracks
from tests.formats.test_other_programs_files import LABELS, motive, qualisys, trc

FRAMES = 40
CUT = (
    "holds {} of the 40 frames that it states; the file is cut off, or that number is wrong: copy or export the file "
    "again"
)


def numbered(positions):
    """Qualisys' table with numbers and times of the frames."""
    lines = qualisys(positions).splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("MARKER_NAMES")) + 1
    titles = "\t".join(["Frame", "Time", *(f"{label} {axis}" for label in LABELS for axis in "XYZ")])
    rows = [f"{k + 1}\t{k / 100:.5f}\t{line}" for k, line in enumerate(lines[head:])]
    return "\n".join([*lines[:head], titles, *rows, ""])


KINDS = {"a.trc": (trc, 1), "a.csv": (motive, 0), "a.tsv": (numbered, 1)}  # and the number of the first frame


def refused(tmp_path, name, lost):
    """The error for a file without some lines, counted from its first frame; and the line of its first frame."""
    write, _ = KINDS[name]
    lines = write(np.random.default_rng(0).uniform(1, 2, (FRAMES, 3, 3))).splitlines()
    begin = len(lines) - FRAMES
    (tmp_path / name).write_text("\n".join([line for k, line in enumerate(lines) if k - begin not in lost] + [""]))
    with pytest.raises(TakeError) as error:
        read_marker_tracks(tmp_path / name)
    return str(error.value).removeprefix(f"{tmp_path / name}: "), begin + 1


@pytest.mark.parametrize("name", KINDS)
def test_frames_lost_within_the_file_are_named(tmp_path, name):
    first = KINDS[name][1]
    told, line = refused(tmp_path, name, {12})
    assert told == (
        f"holds 39 of the 40 frames that it states: frame {first + 12} is missing behind line {line + 11}; copy or "
        "export the file again"
    )
    told, line = refused(tmp_path, name, {5, 12, 13, 14, 20, 30, 33})
    assert told == (
        f"holds 33 of the 40 frames that it states: frame {first + 5} is missing behind line {line + 4}, frames "
        f"{first + 12} to {first + 14} are missing behind line {line + 10}, frame {first + 20} is missing behind line "
        f"{line + 15} and 2 more; copy or export the file again"
    )


@pytest.mark.parametrize("name", KINDS)
def test_frames_lost_at_the_end_and_elsewhere_too_leave_both_causes_open(tmp_path, name):
    assert refused(tmp_path, name, {38, 39})[0] == CUT.format(38)
    assert refused(tmp_path, name, {12, 39})[0] == CUT.format(38)


def test_positions_are_no_numbers_of_frames(tmp_path):
    """Without a clock, the lines begin with a position, a whole number here."""
    positions = 1e-3 * np.arange(FRAMES * 9.0).reshape(-1, 3, 3)
    positions[:, 0, 0] = 1e-3 * (1 + np.arange(FRAMES) + (np.arange(FRAMES) > 20))
    text = qualisys(positions, gap=lambda value, digits: f"{value:.0f}", frames=FRAMES + 1)
    (tmp_path / "a.tsv").write_text(text)
    with pytest.raises(TakeError, match="holds 40 of the 41 frames that it states; the file is cut off"):
        read_marker_tracks(tmp_path / "a.tsv")
