"""A writer refuses whatever its own reader would refuse or change, names the argument, and leaves no file."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from formats.archive import TakeWriter, read_take, write_take
from formats.errors import HangtimeError, TakeError
from formats.surface import SurfaceScan
from tests.formats.test_archive import GARMENT, RIG, a_take, frame_of


def a_scan(**changes):
    return replace(SurfaceScan(time=0.5, grid=np.ones((2, 2, 3)), contour=np.ones((4, 3))), **changes)


def first_set(array, value):
    changed = array.copy()
    changed[0, 0, 0] = value
    return changed


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda take: {"notes": {1: "x"}}, "a key of notes must be text (got a whole number)"),
        (lambda take: {"notes": {"a": 1}}, "notes[...] must be text (got a whole number)"),
        (lambda take: {"notes": 5}, "notes must be a table (got a whole number)"),
        (lambda take: {"created": 5}, "created must be text (got a whole number)"),
        (lambda take: {"take_id": 5}, "take_id must be text (got a whole number)"),
        (lambda take: {"source": None}, "source must be text (got nothing)"),
        (lambda take: {"missing": 5}, "missing must be pairs of seconds"),
        (lambda take: {"missing": (("a", "b"),)}, "missing must be pairs of seconds"),
        (lambda take: {"missing": ((1.0, 2.0, 3.0),)}, "missing[0] must be a list of 2 (got 3)"),
        (lambda take: {"rig": None}, "rig must be a Rig (got NoneType)"),
        (lambda take: {"garment": take.rig}, "garment must be a Garment (got Rig)"),
        (lambda take: {"rig": msgspec.structs.replace(take.rig, name=5)}, "rig: name must be text (got a whole"),
        (lambda take: {"rig": msgspec.structs.replace(take.rig, name=5j)}, "rig has a value that no file can hold (of"),
        (lambda take: {"garment": msgspec.structs.replace(take.garment, mass_kg="0.2")}, "garment: mass_kg must be a"),
        (lambda take: {"points": take.points + 0j}, "points is an array of complex128, not of real numbers"),
        (lambda take: {"held": take.held.astype(object)}, "held is an array of object, not of real numbers"),
        (lambda take: {"time": take.time + 0j}, "time is an array of complex128, not of real numbers"),
        (lambda take: {"points": None}, "points is None; give an array"),
        (lambda take: {"source": "a\ud800"}, "source holds what is no letter, and no file can keep it; write it anew"),
        (lambda take: {"time": "now"}, "time is an array of <U3, not of real numbers"),
        (lambda take: {"time": take.time[:, None]}, "time has shape (3, 1)"),
        (lambda take: {"time": 1.0}, "time has shape ()"),
        (lambda take: {"points_valid": take.points_valid * 1.0}, "points_valid is an array of float64, not of true or"),
        (lambda take: {"held_valid": take.held_valid * 1}, "held_valid is an array of int64, not of true or false"),
        (lambda take: {"state": take.state + 0.5}, "frame 0: state is 0.5, no whole number; give one between 0 and"),
        (lambda take: {"quality": ["a"] * 3}, "quality is an array of <U1, not of real numbers"),
        (lambda take: {"pitch": [[1.0], [1.0, 2.0], 3.0]}, "pitch is no array; give an array of real numbers"),
        (lambda take: {"markers": first_set(take.markers, np.inf)}, "marker 0 is infinite; give NaN where it was"),
        (lambda take: {"markers": first_set(take.markers, -np.inf)}, "marker 0 is infinite; give NaN where it was"),
        (lambda take: {"scans": (a_scan(grid=np.ones((2, 6))),)}, "time, grid and contour have shapes (), (2, 6) and"),
        (lambda take: {"scans": (a_scan(contour=np.ones(12)),)}, "time, grid and contour have shapes (), (2, 2, 3)"),
        (lambda take: {"scans": (a_scan(time=np.ones(2)),)}, "time, grid and contour have shapes (2,), (2, 2, 3)"),
        (lambda take: {"scans": (a_scan(grid=np.ones((2, 2, 3)) + 0j),)}, "grid is an array of complex128, not of"),
        (lambda take: {"scans": (a_scan(contour=np.full((4, 3), np.inf)),)}, "a place is infinite; give NaN where"),
        (lambda take: {"scans": (a_scan(time="now"),)}, "time is an array of <U3, not of real numbers"),
    ],
)  # fmt: skip
def test_values_that_a_reader_would_refuse_or_change_are_refused_by_its_name(tmp_path, change, says):
    take = a_take(frames=3)
    with pytest.raises(HangtimeError) as refused:
        write_take(tmp_path / "a.mcap", replace(take, **change(take)))
    assert says in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_a_take_without_a_frame_is_refused_whole_or_frame_by_frame(tmp_path):
    none = {name: value[:0] for name, value in vars(a_take(frames=3)).items() if isinstance(value, np.ndarray)}
    with pytest.raises(TakeError, match=r"a\.mcap: holds no frame; give one frame or more"):
        write_take(tmp_path / "a.mcap", replace(a_take(frames=3), **none))
    told = {"take_id": "t", "created": "", "rig": RIG, "garment": GARMENT}
    with pytest.raises(TakeError, match=r"a\.mcap: holds no frame"), TakeWriter(tmp_path / "a.mcap", **told):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_writer_that_refused_to_finish_without_a_frame_may_go_on(tmp_path):
    take = a_take(frames=3)
    writer = TakeWriter(tmp_path / "a.mcap", take_id="t", created="", rig=take.rig, garment=take.garment)
    with pytest.raises(TakeError, match="holds no frame"):
        writer.finish()
    writer.append(frame_of(take, 0))
    assert len(read_take(writer.finish()).time) == 1


def test_lists_and_numpys_own_numbers_are_written_as_what_they_are(tmp_path):
    take = a_take(frames=3)
    rig = msgspec.structs.replace(take.rig, gravity=np.array(take.rig.gravity))
    garment = msgspec.structs.replace(take.garment, mass_kg=np.float64(take.garment.mass_kg))
    given = replace(take, rig=rig, garment=garment, time=take.time.tolist(), points=take.points.tolist())
    given = replace(given, missing=((np.float64(take.time[0]), np.float64(take.time[1])),))
    found, wanted = read_take(write_take(tmp_path / "a.mcap", given)), read_take(write_take(tmp_path / "b.mcap", take))
    assert (found.rig, found.garment) == (take.rig, take.garment)
    assert np.array_equal(found.points, wanted.points, equal_nan=True)
    assert np.array_equal(found.time, wanted.time)


@pytest.mark.parametrize("changes", [{"markers": np.full((2, 3), 1j)}, {"points_valid": np.ones(2)}, {"time": "now"}])
def test_a_frame_of_other_values_is_refused(tmp_path, changes):
    take = a_take(frames=3)
    writer = TakeWriter(tmp_path / "a.mcap", take_id="t", created="", rig=take.rig, garment=take.garment)
    with pytest.raises(TakeError, match=f"{next(iter(changes))} is an array of .*, not of"):
        writer.append(replace(frame_of(take, 0), **changes))
    writer.discard()


@pytest.mark.parametrize(
    ("kind", "scale"), [("f2", 1 / 32), ("f4", 1 / 32), ("i1", 1), ("u1", 1), ("i2", 3000), ("i4", 3000)]
)
def test_times_of_short_numbers_come_back_exactly(tmp_path, kind, scale):
    """Microseconds of these numbers would wrap, or be rounded to 16 bits."""
    time = (np.arange(5) * scale).astype(kind)
    write_take(tmp_path / "a.mcap", replace(a_take(frames=5), time=time, quality=np.ones(5, "i1")))
    assert np.array_equal(read_take(tmp_path / "a.mcap").time, np.arange(5) * scale)


def test_a_column_of_more_rows_than_frames_is_refused_with_both_counts(tmp_path):
    take = a_take(frames=3)
    with pytest.raises(TakeError, match=r"held_sd has shape \(6, 2, 3\) for 3 frames; give one row a frame"):
        write_take(tmp_path / "a.mcap", replace(take, held_sd=np.concatenate([take.held_sd, take.held_sd])))
