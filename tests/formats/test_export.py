"""What is written for other programs comes back to the precision of its format, gaps as gaps."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from formats.archive import write_take
from formats.errors import OutputError, TakeError
from formats.exporters.arrays import write_npz, write_parquet
from formats.exporters.marker_files import at_one_rate, marker_tracks, write_c3d, write_csv
from formats.exporters.rerun_file import _send_moving, about, write_rrd
from formats.garment import TrackedPoint
from formats.importers.marker_files import read_marker_tracks
from formats.importers.marker_tracks import MarkerTracks
from tests.fit.here import hangtime_here
from tests.formats.full_disk import no_file_beyond
from tests.formats.test_archive import a_scan, a_take

MANY = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def takes(draw):
    """Takes of 20 frames at a rate and size of any kind, with gaps anywhere."""
    take = a_take(frames=20, seed=draw(st.integers(0, 1000)))
    rate = draw(st.sampled_from([30.0, 69.99, 100.0, 240.0]))
    valid = np.array(draw(st.lists(st.booleans(), min_size=80, max_size=80))).reshape(20, 4)
    valid[0, 0] = True
    points = np.random.default_rng(1).normal(0, draw(st.sampled_from([0.01, 1.0, 50.0])), (20, 4, 3))
    return replace(
        take, time=np.arange(20) / rate + draw(st.sampled_from([0.0, 12345.0])), points_valid=valid,
        points=np.where(valid[..., None], points, np.nan),
    )  # fmt: skip


def same(tracks, take, tolerance):
    assert tracks.labels == ("p0", "p1", "p2", "p3", "held_left", "held_right")
    np.testing.assert_allclose(tracks.positions[:, :4], take.points, atol=tolerance, rtol=1e-7)
    np.testing.assert_allclose(tracks.positions[:, 4:], take.held, atol=tolerance, rtol=1e-7)


@given(take=takes())
@MANY
def test_csv_comes_back_to_a_micrometre_and_a_microsecond(tmp_path, take):
    write_csv(tmp_path / "a.csv", take)
    tracks = read_marker_tracks(tmp_path / "a.csv")
    same(tracks, take, 0.51e-6)
    np.testing.assert_allclose(tracks.time, take.time - take.time[0], atol=0.51e-6)


@pytest.mark.parametrize("room", [0, 1000, 20_000])
def test_a_c3d_file_for_which_there_is_no_room_is_refused_and_leaves_nothing(tmp_path, room):
    """The whole file has more than 20 kB."""
    take = a_take(frames=600)
    write_c3d(tmp_path / "whole.c3d", take)
    assert (tmp_path / "whole.c3d").stat().st_size > 20_000
    sentence = r"a\.c3d: cannot be written \(File too large\); raise the limit on the size of files"
    with no_file_beyond(room), pytest.raises(OutputError, match=sentence):
        write_c3d(tmp_path / "a.c3d", take)
    assert [path.name for path in tmp_path.iterdir()] == ["whole.c3d"]


@given(take=takes())
@settings(MANY, max_examples=6)
def test_c3d_comes_back_to_a_32_bit_float(tmp_path, take):
    write_c3d(tmp_path / "a.c3d", take)
    tracks = read_marker_tracks(tmp_path / "a.c3d")
    same(tracks, take, 1e-7)
    np.testing.assert_allclose(tracks.time, take.time - take.time[0], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    "names", [("\u00c4rmel", "\u00d6rmel", "\u65e5\u672c", "a,b"), ("x" * 127, "y" * 126, "\u00e4" * 63, "z")]
)
@pytest.mark.parametrize("write", [write_csv, write_c3d])
def test_names_beyond_ascii_and_long_ones_come_back(tmp_path, write, names):
    path = tmp_path / f"a.{write.__name__[-3:]}"
    write(path, _named(names))
    assert read_marker_tracks(path).labels[:4] == names


def test_a_take_that_a_marker_file_cannot_hold_is_lost_under_the_name_of_its_file(tmp_path):
    write_take(tmp_path / "a.mcap", _named(("p ", "b", "c", "d")))
    write_take(tmp_path / "b.mcap", a_take())
    done = hangtime_here("takes", "export", "--to", "csv", "--out", "out", "a.mcap", "b.mcap", folder=tmp_path)
    assert done.returncode == 2
    assert done.stdout.splitlines()[-1].startswith("lost: a.mcap: the name 'p ' has characters that no marker file")


def test_a_name_that_c3d_cannot_hold_is_refused_and_more_points_than_one_parameter_names_are_kept(tmp_path):
    with pytest.raises(TakeError, match="has 128 bytes, a C3D file holds 127; export it as CSV"):
        write_c3d(tmp_path / "a.c3d", _named(("\u00e4" * 64, "b", "c", "d")))
    assert not (tmp_path / "a.c3d").exists()
    take = a_take(20)
    flat = tuple(TrackedPoint(name=f"point {k}", at_m=(1e-3 * k - 0.15, -0.1)) for k in range(300))
    places = np.random.default_rng(0).normal(size=(20, 300, 3))
    many = replace(
        take, garment=msgspec.structs.replace(take.garment, points=flat), points=places,
        points_valid=np.ones((20, 300), bool), points_sd=np.ones((20, 300, 3)), points_hidden=None,
    )  # fmt: skip
    write_c3d(tmp_path / "b.c3d", many)
    back = read_marker_tracks(tmp_path / "b.c3d")
    assert back.labels[:300] == many.garment.point_names
    np.testing.assert_allclose(back.positions[:, :300], places, atol=1e-6)


def _named(names):
    take = a_take(20)
    points = tuple(
        msgspec.structs.replace(point, name=name) for point, name in zip(take.garment.points, names, strict=True)
    )
    return replace(take, garment=msgspec.structs.replace(take.garment, points=points))


def test_a_dropped_frame_is_a_gap_in_c3d_and_an_unsteady_clock_is_refused():
    """Frames 0, 1, 2, 4 at 100 a second: the fourth of five is missing."""
    tracks = MarkerTracks(("a",), np.array([0, 0.01, 0.0201, 0.04, 0.05]), np.arange(15.0).reshape(5, 1, 3))
    rate, positions, moved = at_one_rate(tracks, "t")
    assert moved == pytest.approx(1e-4, abs=2e-5)
    assert rate == pytest.approx(100, rel=2e-3)
    assert np.isnan(positions[3]).all()
    assert positions[4, 0, 0] == 9
    with pytest.raises(TakeError, match="its frames come at no steady rate"):
        at_one_rate(replace(tracks, time=np.array([0, 0.01, 0.024, 0.03, 0.04])), "t")


def test_held_ends_that_are_tracked_points_are_written_once():
    take = a_take()
    take.points[:, 0], take.points[:, 1] = take.held[:, 0], take.held[:, 1]
    assert marker_tracks(take).labels == ("p0", "p1", "p2", "p3")


def test_npz_holds_every_array_exactly(tmp_path):
    take = replace(a_take(), scans=(a_scan(0.4),))
    write_npz(tmp_path / "a.npz", take)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        for name in ("time", "held", "points", "points_sd", "points_valid", "state", "markers"):
            np.testing.assert_array_equal(arrays[name], getattr(take, name))
        np.testing.assert_array_equal(arrays["scan0_grid"], take.scans[0].grid)
        about = json.loads(str(arrays["about"]))
    assert (about["take_id"], about["garment"]["mass_kg"], about["is_complete"]) == ("a", 0.03, True)


def test_parquet_holds_many_takes_of_different_garments_and_null_where_nothing_was_seen(tmp_path):
    """Two takes of 30 and 20 frames of six positions each: 300 rows."""
    pq = pytest.importorskip("pyarrow.parquet")
    takes = [a_take(frames=30), replace(a_take(frames=20, seed=1), take_id="b")]
    write_parquet(tmp_path / "a.parquet", takes)
    table = pq.read_table(tmp_path / "a.parquet").to_pylist()
    assert len(table) == 300
    rows = [row for row in table if row["take_id"] == "b" and row["place"] == "p2"]
    assert [row["frame"] for row in rows] == list(range(20))
    for row, place, seen in zip(rows, takes[1].points[:, 2], takes[1].points_valid[:, 2], strict=True):
        assert row["x_m"] == (place[0] if seen else None)
    assert rows[3]["time_s"] == takes[1].time[3]
    assert rows[3]["sd_z_m"] == 0.003


def test_a_note_of_several_lines_is_one_line_of_the_words_for_rerun():
    take = replace(a_take(20), notes={"a": "one\ntwo = \x1b[2J", "take_id\n": "b"})
    *_, first, second = about(take).split("\n")
    assert (first, second) == ("a = one\\ntwo = \\x1b[2J", "take_id\\n = b")


def test_rerun_gets_every_position_where_it_was_seen_and_nothing_where_it_was_not(tmp_path):
    """Places to a 32-bit float, times to a microsecond; the third point is not seen in some frames."""
    pytest.importorskip("rerun")
    take = replace(a_take(), scans=(a_scan(0.4),))
    write_rrd(tmp_path / "a.rrd", take)
    assert (tmp_path / "a.rrd").read_bytes()[:4] == b"RRF2"
    found = rerun_columns(tmp_path / "a.rrd", "/take/points/p2")
    assert len(found["places"]) == len(take.time)
    for places, place, seen in zip(found["places"], take.points[:, 2], take.points_valid[:, 2], strict=True):
        expected = place.astype(np.float32)[None] if seen else np.empty((0, 3))
        np.testing.assert_array_equal(np.reshape(places, (-1, 3)), expected)
    assert 0 < sum(len(places) == 0 for places in found["places"]) < len(take.time)
    np.testing.assert_allclose(found["sensor"] / 1e9, take.time, atol=0.51e-6)
    assert len(rerun_columns(tmp_path / "a.rrd", "/take/surface")["places"]) == 1


def test_rerun_gets_times_in_nanoseconds_rounded_to_microseconds():
    """Of a stand-in for the library, which is not everywhere; 0.1 and 2.0000004 s."""
    columns = {}
    rerun = SimpleNamespace(
        TimeColumn=lambda name, **values: (name, values), Points3D=MagicMock(), Scalars=MagicMock(),
        new_entity_path="/".join,
    )  # fmt: skip
    stream = MagicMock(send_columns=lambda entity, times, _: columns.update({entity: dict(times)}))
    _send_moving(rerun, stream, replace(a_take(2), time=np.array([0.1, 2.0000004])))
    assert {"take/points/p0", "take/held/left", "take/markers/right", "state"} <= columns.keys()
    for times in columns.values():
        duration = times["sensor"]["duration"]
        assert (duration.dtype, duration.astype(int).tolist()) == ("timedelta64[ns]", [100_000_000, 2_000_000_000])
        assert times["frame"]["sequence"].tolist() == [0, 1]


def rerun_columns(path, entity):
    """Return the positions and the times [ns] of one entity in a Rerun file."""
    from rerun.chunk import RrdReader

    for chunk in RrdReader(path).stream():
        rows = chunk.to_record_batch()
        if chunk.entity_path == entity and "sensor" in rows.schema.names:
            found = {"places": rows.column("Points3D:positions").to_pylist()}
            return found | {"sensor": rows.column("sensor").to_numpy(zero_copy_only=False).astype(float)}
    raise AssertionError(f"nothing of {entity}")


def test_the_command_exports_every_kind_and_replaces_nothing(tmp_path):
    pytest.importorskip("pyarrow")
    path = write_take(tmp_path / "a.mcap", a_take())

    def export(kind, out):
        return hangtime_here("takes", "export", path, "--to", kind, "--out", out, folder=tmp_path)

    for kind in ("csv", "c3d", "npz", "parquet"):
        out = tmp_path / ("all.parquet" if kind == "parquet" else "out")
        done = export(kind, out)
        assert done.returncode == 0, done.stderr
        assert (out if kind == "parquet" else out / f"a.{kind}").stat().st_size > 1000
    again = export("csv", tmp_path / "out")
    assert (again.returncode, len(again.stderr.splitlines())) == (2, 1)
    assert "is already there" in again.stderr


@pytest.mark.parametrize("kind", ["csv", "npz", "parquet"])
def test_takes_that_are_lost_keep_no_other_from_being_exported(tmp_path, kind):
    """The end names them. Where nothing is exported, no folder is left behind."""
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    (tmp_path / "a.mcap").write_bytes(b"no take")
    write_take(tmp_path / "b.mcap", a_take())
    out = Path("all.parquet" if kind == "parquet" else "out")
    words = ("takes", "export", "--to", kind, "--out", out)
    done = hangtime_here(*words, "a.mcap", "b.mcap", "c.mcap", folder=tmp_path)
    assert done.returncode == 2
    first, *lost = done.stdout.splitlines()
    assert first.startswith(f"{out}: 1 take" if kind == "parquet" else f"out/b.{kind}: ")
    assert [line.split(":")[:2] for line in lost] == [["lost", " a.mcap"], ["lost", " c.mcap"]]
    told = json.loads(hangtime_here(*words, "a.mcap", "c.mcap", "--json", "--overwrite", folder=tmp_path).stdout)
    assert [one["file"] for one in told["lost"]] == ["a.mcap", "c.mcap"]
    assert [line.removeprefix("lost: ") for line in lost] == [one["error"] for one in told["lost"]]
    assert hangtime_here(*words[:-1], "none", "a.mcap", "c.mcap", folder=tmp_path).returncode == 2
    alone = hangtime_here(*words[:-1], "none", "a.mcap", folder=tmp_path)
    assert (alone.returncode, alone.stdout, alone.stderr.count("a.mcap: ")) == (2, "", 1)
    assert not (tmp_path / "none").exists()


def whole_take():
    """A take in which nothing is left out: pitch, what is hidden, quality, a gap, two scans."""
    rng = np.random.default_rng(3)
    return replace(
        a_take(frames=12), pitch=rng.normal(size=12), pitch_sd=np.full(12, 0.01), quality=rng.random(12),
        points_hidden=rng.random((12, 4)) > 0.7, missing=((1.5, 2.25), (9.0, np.inf)), is_complete=False,
        scans=(a_scan(0.4), a_scan(0.6, 2)),
    )  # fmt: skip


def test_npz_holds_everything_under_the_names_of_a_take(tmp_path):
    take = whole_take()
    write_npz(tmp_path / "a.npz", take)
    names = (
        "time", "held", "held_valid", "held_sd", "points", "points_valid", "points_sd", "state", "markers", "pitch",
        "pitch_sd", "points_hidden", "quality",
    )  # fmt: skip
    scans = [f"scan{k}_{part}" for k in (0, 1) for part in ("time", "grid", "contour")]
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert set(arrays.files) == {"about", *names, *scans}
        for name in names:
            np.testing.assert_array_equal(arrays[name], getattr(take, name))
        for k, scan in enumerate(take.scans):
            assert arrays[f"scan{k}_time"] == scan.time
            np.testing.assert_array_equal(arrays[f"scan{k}_contour"], scan.contour)
        about = json.loads(str(arrays["about"]))
    assert about == {
        "take_id": "a", "created": "2026-01-01T00:00:00Z", "source": "test", "notes": {"who": "me"},
        "is_complete": False, "missing_s": [["1.5", "2.25"], ["9.0", "inf"]],
        "rig": json.loads(msgspec.json.encode(take.rig)), "garment": json.loads(msgspec.json.encode(take.garment)),
    }  # fmt: skip
    bare = replace(take, pitch=None, pitch_sd=None, points_hidden=None, quality=None, scans=())
    write_npz(tmp_path / "b.npz", bare)
    with np.load(tmp_path / "b.npz") as arrays:
        assert set(arrays.files) == {"about", *names[:9]}


def test_parquet_has_each_position_of_each_frame_whole(tmp_path):
    """Two held ends and four points; the ends are never hidden."""
    pq = pytest.importorskip("pyarrow.parquet")
    take = whole_take()
    write_parquet(tmp_path / "a.parquet", [take])
    rows = pq.read_table(tmp_path / "a.parquet").to_pylist()
    places = ["held_left", "held_right", "p0", "p1", "p2", "p3"]
    assert [(row["frame"], row["place"]) for row in rows] == [(k, place) for k in range(12) for place in places]
    assert {row["take_id"] for row in rows} == {"a"}
    assert [row["state"] for row in rows[::6]] == take.state.tolist()
    for k, row in enumerate(rows):
        frame, at = divmod(k, 6)
        where, sd = (
            (take.held[frame, at], take.held_sd[frame, at]) if at < 2
            else (take.points[frame, at - 2], take.points_sd[frame, at - 2])
        )  # fmt: skip
        assert [row["x_m"], row["y_m"], row["z_m"]] == [None if np.isnan(value) else value for value in where]
        assert [row["sd_x_m"], row["sd_y_m"], row["sd_z_m"]] == sd.tolist()
        assert row["is_hidden"] == (at >= 2 and bool(take.points_hidden[frame, at - 2]))
        assert row["time_s"] == take.time[frame]


def test_rows_of_two_takes_of_one_id_are_not_put_into_one_table(tmp_path):
    pytest.importorskip("pyarrow")
    for name, frames in (("a", 20), ("b", 30)):
        write_take(tmp_path / f"{name}.mcap", a_take(frames))
    words = ("--to", "parquet", "--out", "all.parquet")
    done = hangtime_here("takes", "export", "a.mcap", "b.mcap", *words, folder=tmp_path)
    assert done.returncode == 2
    told = (
        "all.parquet: takes have one id: a.mcap and b.mcap; name each take once, and write another one of this id to "
    )
    assert done.stderr == f"hangtime: {told}a file of its own\n"
    assert not (tmp_path / "all.parquet").exists()
    twice = hangtime_here("takes", "export", "a.mcap", "a.mcap", *words, folder=tmp_path)
    assert (twice.returncode, (tmp_path / "all.parquet").exists()) == (2, False)
    assert twice.stderr == "hangtime: a.mcap: was given twice; give it once\n"
    assert hangtime_here("takes", "export", "a.mcap", *words, folder=tmp_path).returncode == 0
