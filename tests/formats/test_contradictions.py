"""A contradiction between a header or end message and the blocks is reported, and costs no frame."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from formats.archive import read_with_report, write_take
from formats.take_writer import binding_of
from tests.fit.here import hangtime_here
from tests.formats.bombs import header_of
from tests.formats.damage import chunk_of, chunks_of
from tests.formats.test_archive import a_take

LAST = 250_000 + round(149e6 / 30)  # us of the sensor's clock


def with_end(raw, **changes):
    """The take with another end."""
    begin, end, content = next(chunk for chunk in chunks_of(raw) if "blocks" in chunk[2])
    return raw[:begin] + chunk_of({**content, **changes}) + raw[end:]


def with_missing(raw, missing):
    """The take with a header that says what is missing."""
    header, chunks = header_of(raw, missing=missing), chunks_of(raw)
    rest = b"".join(chunk_of({**c, "take": binding_of(header)}) for _, _, c in chunks if "format" not in c)
    return raw[: chunks[0][0]] + chunk_of(header) + rest + raw[chunks[-1][1] :]


@pytest.mark.parametrize(
    ("changes", "doubt"),
    [
        ({"frames": 149}, "its end counts 149 frames, and there are 150"),
        ({"blocks": 1}, "its end counts 1 block, and there are 5"),
        ({"scans": 0}, "its end counts 0 scans, and there are 2"),
        ({"from": 250_003}, "its end says that it begins at 0.250003 s, and its first frame is of 0.250000 s"),
        ({"from": -(10**15)}, "its end says that it begins at -1000000000.000000 s, and its first frame is of 0.25"),
        ({"until": LAST - 9}, "its end says that it ends at 5.216658 s, and its last frame is of 5.216667 s"),
        ({"until": LAST + 10**9}, "its end says that it ends at 1005.216667 s, and its last frame is of 5.216667 s"),
        ({"frames": 151, "until": 1}, "its end says that it ends at 0.000001 s, and its last frame is of 5.216667 s"),
    ],
)
def test_an_end_that_the_blocks_contradict_is_named(raw, tmp_path, changes, doubt):
    path = tmp_path / "a.mcap"
    path.write_bytes(with_end(raw, **changes))
    take, report = read_with_report(path)
    assert (len(take.time), report.is_sound, len(report.doubts)) == (150, False, 1)
    assert report.doubts[0].startswith(doubt)
    assert all(begin < end for begin, end in take.missing)


def test_an_end_that_is_a_microsecond_off_by_rounding_is_sound(raw, tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(with_end(raw, until=LAST + 1))
    assert read_with_report(path)[1].is_sound


def test_ends_that_differ_are_named(raw, tmp_path):
    path, chunks = tmp_path / "a.mcap", chunks_of(raw)
    path.write_bytes(raw[: chunks[1][0]] + chunk_of({**chunks[-1][2], "frames": 200}) + raw[chunks[1][0] :])
    take, report = read_with_report(path)
    assert (len(take.time), report.doubts) == (150, ("its several ends differ",))


@pytest.mark.parametrize(
    "missing", [[[float("nan"), 9.0]], [[9.0, float("nan")]], [[1e300, 2e300]], [[-1e300, 0.0]], [[5, 1]], [[0.5, 1.5]]]
)
def test_missing_times_that_cannot_be_are_left_out_and_named(raw, tmp_path, missing):
    """The frames go from 0.25 to 5.22 s; the pair that can be is kept."""
    path = tmp_path / "a.mcap"
    path.write_bytes(with_missing(raw, [*missing, [5.3, 7.0]]))
    take, report = read_with_report(path)
    assert (len(take.time), take.missing, report.is_sound) == (150, ((5.3, 7.0),), False)
    assert report.doubts == ("its header states impossible missing times",)
    said = hangtime_here("takes", "verify", "a.mcap", folder=tmp_path)
    assert said.returncode == 2
    assert "; its header states impossible missing times; an earlier file had lost 5.05 to 6.75 s; " in said.stdout


def test_verify_names_the_earlier_losses_of_a_take_that_is_incomplete(tmp_path):
    """The frames go on from 0.25 to 5.22 s; an earlier file had lost those up to 7 s, and this one its end."""
    take = a_take(frames=300)
    kept = (take.time < 5.23) | (take.time > 6.99)
    names = ("time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers")
    mended = replace(take, **{name: getattr(take, name)[kept] for name in names}, missing=((5.216667, 7.016667),))
    raw = write_take(tmp_path / "a.mcap", mended).read_bytes()
    (tmp_path / "a.mcap").write_bytes(raw[: chunks_of(raw)[-2][0]])
    told = hangtime_here("takes", "verify", "a.mcap", folder=tmp_path).stdout
    assert told.startswith("incomplete")
    assert "; missing: from 9.97 s on; an earlier file had lost 4.97 to 6.77 s; " in told
    assert np.isclose(read_with_report(tmp_path / "a.mcap")[0].missing[0], (5.216667, 7.016667)).all()


def test_show_and_list_name_a_doubt_and_damaged_blocks(raw, tmp_path):
    damaged = bytearray(with_end(raw, scans=0))
    damaged[next(begin for begin, _, told in chunks_of(raw) if "first" in told) + 200] ^= 1
    (tmp_path / "a.mcap").write_bytes(damaged)
    doubt = "its end counts 0 scans, and there are 2"
    shown = hangtime_here("takes", "show", "a.mcap", folder=tmp_path).stdout
    assert "\ndamaged   1 block; `hangtime takes recover` makes a sound file\n" in shown
    assert f"\nwarning   {doubt}\n" in shown
    assert shown.count(doubt) == 1
    told = hangtime_here("takes", "list", ".", "--json", folder=tmp_path).stdout
    (entry,) = json.loads(told)["takes"]
    assert (entry["damaged_blocks"], entry["doubts"], entry["earlier_doubts"]) == (1, [doubt], "")
    listed = hangtime_here("takes", "list", ".", folder=tmp_path).stdout
    assert "; 1 block damaged; missing: " in listed
    assert listed.endswith(f"; {doubt}\n")
