"""Take archives: what goes in comes out, and damage costs no more than it must."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest

from formats.archive import TakeWriter, read_take, verify_take, write_take
from formats.blocks import Frame
from formats.errors import OutputError, TakeError
from formats.garment import Garment, TrackedPoint
from formats.rig import Rig
from formats.surface import SurfaceScan
from formats.take import FrameState, Take
from tests.formats.damage import chunks_of
from tests.formats.full_disk import no_file_beyond

OUTLINE = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4))
GARMENT = Garment(
    format="hangtime-garment/1", name="sheet", kind="swatch", mass_kg=0.03, outline_m=OUTLINE, held="edge",
    points=tuple(TrackedPoint(name=f"p{k}", at_m=p) for k, p in enumerate(OUTLINE)),
)  # fmt: skip
RIG = Rig(format="hangtime-rig/1", name="bench", gravity=(0.0, 1.0, 0.0))


def a_take(frames=150, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(frames) / 30 + 0.25
    held = np.sin(3 * time)[:, None, None] * 0.1 + rng.normal(0, 0.002, (frames, 2, 3))
    points = np.sin(3 * time)[:, None, None] * 0.2 + rng.normal(0, 0.003, (frames, 4, 3)) + 1.5
    valid = rng.random((frames, 4)) > 0.05
    points[~valid] = np.nan
    state = np.zeros(frames, np.uint16)
    state[7:8] = FrameState.MARKER_LOST | FrameState.FRAMES_DROPPED_BEFORE
    return Take(
        take_id="a", created="2026-01-01T00:00:00Z", rig=RIG, garment=GARMENT, time=time, held=held,
        held_valid=np.ones((frames, 2), bool), held_sd=np.full((frames, 2, 3), 0.002), points=points,
        points_valid=valid,
        points_sd=np.full((frames, 4, 3), 0.003), state=state, markers=held, source="test", notes={"who": "me"},
    )  # fmt: skip


def test_a_take_comes_back_to_half_a_step(tmp_path):
    """Positions to 0.05 mm, times to half a microsecond, everything else exactly."""
    take = a_take()
    back = read_take(write_take(tmp_path / "a.mcap", take))
    assert np.nanmax(np.abs(back.points - take.points)) <= 0.5e-4 + 1e-12
    assert np.abs(back.held - take.held).max() <= 0.5e-4 + 1e-12
    assert np.abs(back.time - take.time).max() <= 0.5e-6 + 1e-12
    assert np.array_equal(back.points_valid, take.points_valid)
    assert np.array_equal(np.isnan(back.points), np.isnan(take.points))
    assert np.array_equal(back.state, take.state)
    assert (back.rig, back.garment, back.notes, back.is_complete) == (RIG, GARMENT, {"who": "me"}, True)


def test_a_clock_that_has_run_for_a_month_keeps_its_microseconds(tmp_path):
    take = a_take()
    take.time[:] += 2.6e6
    back = read_take(write_take(tmp_path / "a.mcap", take))
    assert np.abs(back.time - take.time).max() <= 0.6e-6


def test_a_sensor_that_pauses_for_an_hour_keeps_its_times(tmp_path):
    """Within a block, times reach 1073 s (31 bits of microseconds)."""
    take = a_take(frames=60)
    take.time[10:] += 3600.0
    back = read_take(write_take(tmp_path / "a.mcap", take))
    assert np.abs(back.time - take.time).max() <= 0.6e-6


def test_a_finished_take_leaves_no_partial_file(tmp_path):
    write_take(tmp_path / "a.mcap", a_take())
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]


def test_a_cut_at_any_byte_keeps_every_whole_block_before_it(tmp_path):
    raw = write_take(tmp_path / "a.mcap", a_take()).read_bytes()
    cut_file = tmp_path / "cut.mcap"
    kept = []
    for cut in range(1, len(raw), 211):
        cut_file.write_bytes(raw[:cut])
        try:
            report = verify_take(cut_file)
        except TakeError:
            kept.append(0)
            continue
        kept.append(report.frames)
    assert kept == sorted(kept), "a later cut never keeps less"
    assert kept[3 * len(kept) // 4] >= 60, "three quarters keep two seconds; a quarter is specification and header"
    assert kept[-1] == 150


def test_a_cut_take_says_that_it_is_incomplete(tmp_path):
    raw = write_take(tmp_path / "a.mcap", a_take()).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(raw[: raw.rindex(b"zstd") - 60])
    take = read_take(tmp_path / "cut.mcap")
    assert not take.is_complete
    assert take.missing == ((take.time[-1], np.inf),)


@pytest.mark.parametrize("seed", range(12))
def test_a_flipped_bit_costs_at_most_one_second(tmp_path, seed):
    """Five seconds in five blocks; one damaged block leaves at least 118 of 150 frames."""
    rng = np.random.default_rng(seed)
    raw = bytearray(write_take(tmp_path / "a.mcap", a_take()).read_bytes())
    raw[int(rng.integers(len(raw)))] ^= 1 << int(rng.integers(8))
    (tmp_path / "b.mcap").write_bytes(bytes(raw))
    report = verify_take(tmp_path / "b.mcap")
    assert report.frames >= 118
    if report.frames < 150:
        assert not report.is_sound


def test_an_interrupted_recording_leaves_a_readable_partial_file(tmp_path):
    take = a_take()

    def record_until_the_power_fails():
        with TakeWriter(tmp_path / "a.mcap", take_id="a", created="now", rig=RIG, garment=GARMENT) as writer:
            for k in range(70):
                writer.append(frame_of(take, k))
            raise RuntimeError("power")

    with pytest.raises(RuntimeError, match="power"):
        record_until_the_power_fails()
    assert not (tmp_path / "a.mcap").exists()
    back = read_take(tmp_path / "a.mcap.partial")
    assert len(back.time) == 70
    assert not back.is_complete


def test_a_recorder_cuts_blocks_where_a_whole_take_is_cut(tmp_path):
    """At 8 frames a second, whose times are exact, a block ends with the frame that reaches one second."""
    take = a_take(frames=40)
    take = replace(take, time=np.arange(40) / 8)
    with TakeWriter(tmp_path / "a.mcap", take_id="a", created="now", rig=RIG, garment=GARMENT) as writer:
        for k in range(40):
            writer.append(frame_of(take, k))
    assert verify_take(tmp_path / "a.mcap").blocks == verify_take(write_take(tmp_path / "b.mcap", take)).blocks == 5


def test_a_recorder_ends_a_block_before_a_gap_and_a_frame_alone_is_one(tmp_path):
    """Gaps of 2 s and more part the frames at 0, 0.5, 0.9, 2.5, 4.4, 9 and 11 s; a block of 1 s ends with 0.9 + 1.6."""
    take = replace(a_take(frames=7), time=np.array([0, 0.5, 0.9, 2.5, 4.4, 9, 11.0]))
    with TakeWriter(tmp_path / "a.mcap", take_id="a", created="now", rig=RIG, garment=GARMENT) as writer:
        for k in range(7):
            writer.append(frame_of(take, k))
    contents = [content for _, _, content in chunks_of((tmp_path / "a.mcap").read_bytes()) if "table" in content]
    assert [(content["first"], content["frames"]) for content in contents] == [(0, 3), (3, 2), (5, 1), (6, 1)]
    np.testing.assert_allclose(read_take(tmp_path / "a.mcap").time, take.time, atol=1e-6)


def test_behind_its_messages_an_archive_has_its_counts_alone(tmp_path):
    """No index and no second specification: records of kinds 15, 11 and 2, the end of the data, counts, the footer."""
    raw = write_take(tmp_path / "a.mcap", a_take()).read_bytes()
    at, found = chunks_of(raw)[-1][1], []
    while raw[at:] != raw[:8]:
        length = int.from_bytes(raw[at + 1 : at + 9], "little")
        found.append((raw[at], length))
        at += 9 + length
    assert found == [(15, 4), (11, 76), (2, 20)]
    assert raw[chunks_of(raw)[-1][1] + 9 :][:4] == bytes(4), "the sum of the data was not taken"


def frame_of(take, k):
    return Frame(
        time=float(take.time[k]), markers=take.markers[k], held=take.held[k], held_valid=take.held_valid[k],
        held_sd=take.held_sd[k], points=take.points[k], points_valid=take.points_valid[k], points_sd=take.points_sd[k],
    )  # fmt: skip


def test_a_valid_point_that_is_not_a_number_is_refused_with_its_frame(tmp_path):
    take = a_take()
    take.points[3, 2] = np.nan
    take.points_valid[3, 2] = True
    with pytest.raises(TakeError, match=r"frame 3.*point 2 .*not a number"):
        write_take(tmp_path / "a.mcap", take)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("time", [2.6e11, 1e20, -1e11])
def test_a_time_that_lies_centuries_away_is_refused_and_leaves_no_file(tmp_path, time):
    """1e10 s are three centuries; 260 s in nanoseconds lie beyond."""
    take = a_take(frames=30)
    take.time[:] = time + 1e5 * np.arange(30)
    with pytest.raises(TakeError, match=r"a, frame 0: the time .* s lies centuries away; give it in seconds"):
        write_take(tmp_path / "a.mcap", take)
    assert list(tmp_path.iterdir()) == []


def test_a_take_that_no_disk_holds_is_named_and_leaves_no_file(tmp_path):
    """The take has 7 kB."""
    with no_file_beyond(5000), pytest.raises(OSError, match="File too large") as full:
        write_take(tmp_path / "a.mcap", a_take())
    assert full.value.filename == str(tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_take_of_a_name_that_is_not_utf_8_is_refused_and_leaves_no_file(tmp_path):
    path = tmp_path / os.fsdecode(b"q\xff.mcap")
    with pytest.raises(OutputError, match="has a name that is not UTF-8"):
        write_take(path, replace(a_take(frames=3), take_id=path.stem))
    assert list(tmp_path.iterdir()) == []


def test_a_source_of_a_name_that_is_not_utf_8_is_kept_with_an_escape(tmp_path):
    take = replace(a_take(frames=3), source=os.fsdecode(b"caf\xe9.oni"))
    assert read_take(write_take(tmp_path / "a.mcap", take)).source == r"caf\xe9.oni"


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"notes": {"a": "b", "clock": "x\udce9"}}, "notes.clock holds what is no letter"),
        ({"created": "\ud800"}, "created holds what is no letter"),
        ({"missing": ((1.0, 0.5),)}, "missing: no frames can be missing from 1 to 0.5 s; give each span from the last"),
        ({"missing": ((-1.0, float("nan")),)}, "missing: no frames can be missing from -1 to nan s"),
        ({"missing": ((-1000.0, 1000.0),)}, "missing: no frames can be missing from -1000 to 1000 s"),
    ],
)
def test_a_value_that_would_not_be_read_back_is_refused_by_its_field_and_leaves_no_file(tmp_path, changes, says):
    with pytest.raises(TakeError) as refused:
        write_take(tmp_path / "a.mcap", replace(a_take(frames=3), **changes))
    assert str(refused.value).startswith(f"{tmp_path / 'a.mcap'}: {says}")
    assert list(tmp_path.iterdir()) == []


def test_a_recorder_refuses_times_without_frames_that_end_before_they_begin(tmp_path):
    take = a_take(frames=3)
    told = {"take_id": "t", "created": "", "rig": take.rig, "garment": take.garment}
    with pytest.raises(TakeError, match=r"no frames can be missing from 1 to 0\.5 s"):
        TakeWriter(tmp_path / "a.mcap", **told, missing=((1.0, 0.5),))
    assert list(tmp_path.iterdir()) == []


def test_time_that_goes_back_is_refused(tmp_path):
    take = a_take()
    take.time[5] = take.time[4]
    with pytest.raises(TakeError, match="time goes from"):
        write_take(tmp_path / "a.mcap", take)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"hello, I am a letter", "not a take archive"),
        (b"\x89MCAP0\r\n" + bytes(300), "no readable header"),
    ],
)
def test_a_file_that_is_not_a_take_is_refused(tmp_path, content, words):
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(TakeError, match=words):
        read_take(tmp_path / "x.mcap")


def test_a_missing_take_is_named(tmp_path):
    with pytest.raises(TakeError, match=r"gone\.mcap: cannot be read"):
        read_take(tmp_path / "gone.mcap")


def test_ten_minutes_take_at_most_30_bytes_a_frame(tmp_path):
    """Six tracked positions at 3 mm of noise, of which 15.7 bytes a frame are noise in steps of 0.1 mm."""
    path = write_take(tmp_path / "a.mcap", a_take(frames=18_000))
    assert path.stat().st_size / 18_000 < 30


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda take: take.points.__setitem__((7, 2), 200e3), r"frame 7: point 2 lies 200000 m away; give metres"),
        (lambda take: take.held.__setitem__((7, 1), -2e3), r"frame 7: held end 1 lies 2000 m away"),
        (lambda take: take.held_sd.__setitem__((7, 1), -1e-3), r"frame 7: held_sd has a standard deviation of -0.001"),
        (lambda take: take.points_sd.__setitem__((7, 1), 1e-12), r"frame 7: points_sd has .* of 1e-12"),
        (lambda take: take.time.__setitem__(7, take.time[6] + 2e-7), r"frame 7: time goes .* less than a microsecond"),
        (lambda take: take.quality.__setitem__(7, 1.5), r"frame 7: quality is 1.5, not between 0 and 1"),
    ],
)
def test_values_that_an_archive_cannot_hold_are_refused_with_its_frame_and_leaves_no_file(tmp_path, change, words):
    take = replace(a_take(frames=60), quality=np.full(60, 0.5))
    take = replace(take, held=take.held.copy())
    change(take)
    with pytest.raises(TakeError, match=words):
        write_take(tmp_path / "a.mcap", take)
    assert list(tmp_path.iterdir()) == []


def test_deviations_keep_one_per_cent_and_what_is_unknown_zero_or_infinite(tmp_path):
    """A step is 2^(1/32), so that half of one is 1.09 %."""
    take = a_take(frames=60)
    take.points_valid[:] = True
    take.points[:] = 1.0
    take.points_sd[:] = 10 ** np.random.default_rng(5).uniform(-6, 1, take.points_sd.shape)
    take.points_sd[3, 0] = 3e-5, 0.0, np.nan
    take.points_sd[4, 0] = np.inf
    back = read_take(write_take(tmp_path / "a.mcap", take))
    np.testing.assert_allclose(back.points_sd, take.points_sd, rtol=0.011)
    np.testing.assert_allclose(back.held_sd, take.held_sd, rtol=0.011)


@pytest.mark.parametrize(("sd", "step"), [(2e-3, 1e-4), (1e-3, 1e-4), (3e-4, 2e-5), (5e-5, 1e-6)])
def test_positions_are_kept_in_the_coarsest_step_that_is_a_tenth_of_their_deviation(tmp_path, sd, step):
    take = replace(a_take(frames=40), points_sd=np.full((40, 4, 3), sd))
    back = read_take(write_take(tmp_path / "a.mcap", take))
    whole = back.points[back.points_valid] / step
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-6)
    off = np.abs(back.points - take.points)[take.points_valid].max()
    assert 0.4 * step < off <= 0.5 * step + 1e-12


def test_the_position_before_a_gap_is_not_that_after_it(tmp_path):
    """A pause of 7 s lies between two blocks and is no missing span."""
    take = a_take(frames=90)
    take.time[40:] += 7.0
    back = read_take(write_take(tmp_path / "a.mcap", take))
    assert (back.missing, back.is_complete, len(back.time)) == ((), True, 90)


def a_scan(time, seed=1, size=7, around=40):
    rng = np.random.default_rng(seed)
    grid = rng.normal(0, 0.2, (size, size, 3)) + 1.5
    grid[2, 3] = np.nan
    contour = rng.normal(0, 0.2, (around, 3)) + 1.5
    contour[[0, 9]] = np.nan
    return SurfaceScan(time=time, grid=grid, contour=contour)


def test_a_second_scan_of_one_time_is_refused(tmp_path):
    """Times are stored in microseconds."""
    take = replace(a_take(), scans=(a_scan(0.4), a_scan(0.4000001, seed=2)))
    with pytest.raises(TakeError, match=rf"^{take.take_id}: has two scans of the surface at one time"):
        write_take(tmp_path / "a.mcap", take)
    assert not list(tmp_path.glob("*.mcap"))
    apart = replace(take, scans=(a_scan(0.4), a_scan(0.400001, seed=2)))
    assert len(read_take(write_take(tmp_path / "a.mcap", apart)).scans) == 2


def test_hidden_points_quality_and_scans_come_back(tmp_path):
    """Quality to half of 1/254, scans to 0.05 mm, what is hidden exactly."""
    rng = np.random.default_rng(2)
    take = a_take()
    hidden = ~take.points_valid & (rng.random(take.points_valid.shape) > 0.5)
    quality = rng.random(len(take.time))
    quality[11] = np.nan
    scans = (a_scan(0.4, 1), a_scan(0.6, 2, size=5, around=12))
    back = read_take(write_take(tmp_path / "a.mcap", replace(take, points_hidden=hidden, quality=quality, scans=scans)))
    assert np.array_equal(back.points_hidden, hidden)
    np.testing.assert_allclose(back.quality, quality, atol=0.5 / 254 + 1e-12)
    assert [scan.time for scan in back.scans] == pytest.approx([0.4, 0.6])
    for found, wanted in zip(back.scans, scans, strict=True):
        np.testing.assert_allclose(found.grid, wanted.grid, atol=0.5e-4 + 1e-12)
        np.testing.assert_allclose(found.contour, wanted.contour, atol=0.5e-4 + 1e-12)
    assert back.is_complete


def test_a_take_whose_points_nobody_judged_has_nothing_hidden_and_no_quality(tmp_path):
    back = read_take(write_take(tmp_path / "a.mcap", a_take()))
    assert not back.points_hidden.any()
    assert np.isnan(back.quality).all()
    assert back.scans == ()


def test_a_damaged_scan_costs_itself_and_no_frame(tmp_path):
    path = write_take(tmp_path / "a.mcap", replace(a_take(), scans=(a_scan(0.4, 1), a_scan(0.6, 2))))
    raw, without = bytearray(path.read_bytes()), write_take(tmp_path / "b.mcap", a_take()).read_bytes()
    # The first scan begins a little before the first byte that a take without scans does not have.
    first = next(k for k, (a, b) in enumerate(zip(raw, without, strict=False)) if a != b)
    raw[first + 200] ^= 0xFF
    path.write_bytes(bytes(raw))
    back = read_take(path)
    assert len(back.scans) == 1
    assert len(back.time) == 150
    assert not verify_take(path).is_sound
