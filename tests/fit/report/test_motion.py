"""The error measure of the report, and the motion file beside a page."""

from __future__ import annotations

import hashlib
import json
import re
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.errors import FitError
from fit.methods import SI
from fit.observer.residuals import Observer
from fit.recordings.ready import Ready
from fit.recordings.recording import prepare
from fit.recordings.selection import content_of
from fit.report import sections
from fit.report.gather import _motion as motion_of
from fit.report.kept import load_motions, place_beside, save_motions
from fit.report.motion import Run, rms_of
from fit.report.origin import Origin, command_line, origin_of
from tests.fit.report.report_scene import fit_result, motion
from tests.fit.scenes import sheet, swing, take_of


@pytest.mark.parametrize("kind", ["material", "silhouette"])
def test_the_pages_error_is_the_diagnosis_own(kind):
    """Held points and, for a silhouette, each point's mean offset are no error; 3 mm and more are put there."""
    time = np.arange(0, 3, 1 / 30)
    garment = sheet()
    points = np.array([(x, 0.0, y) for x, y in (p.at_m for p in garment.points)]) + swing(time)[:, None]
    take = take_of(garment, time, swing(time), points=points)
    take = replace(take, garment=type(garment)(**{**_fields(garment), "points_are": kind}))
    recording = prepare(take)
    rng = np.random.default_rng(2)
    simulated = recording.points + 0.003 * np.arange(5)[:, None] + rng.normal(0, 0.004, recording.points.shape)
    observer = Observer([recording], SI, (), frequency=0.0, resolution=Resolution(spacing=0.15))
    shown = motion_of(recording, False, np.zeros((0, 3), int), {"base": Run(points=simulated)})
    wanted = observer.in_mm(observer.residuals_of([simulated[None]]))[0]
    assert 1e3 * rms_of([shown], "base") == pytest.approx(wanted, rel=1e-6)


def _fields(garment):
    return {name: getattr(garment, name) for name in garment.__struct_fields__}


def test_the_rms_of_a_frame_by_hand():
    """Three free points, 3, 4 and 12 mm off: the root of 169 / 3 is 7.51 mm. The held ones, 50 mm off, do not count."""
    still = np.zeros((2, 5, 3))
    off = still.copy()
    off[:, :, 1] = np.array([50, 50, 3, 4, 12]) * 1e-3
    shown = motion(time=np.array([0.0, 0.1]), real=still, runs={"base": Run(points=off)}, held=None, triangles=None)
    assert 1e3 * shown.rms("base") == pytest.approx([7.5056, 7.5056], abs=1e-3)
    hidden = still.copy()
    hidden[1, 4] = np.nan  # the worst one: the root of 25 / 2 is left
    assert 1e3 * replace(shown, real=hidden).rms("base")[1] == pytest.approx(3.5355, abs=1e-3)


def test_the_offset_of_a_silhouettes_point_is_its_mean_over_the_frames_that_show_it():
    """4 mm off in the frames that show it, of which there are two of four: no error is left, and none of the others."""
    still = np.zeros((4, 5, 3))
    off = still + np.array([0.0, 0.004, 0.0])
    seen = still.copy()
    seen[:2, 3] = np.nan
    shown = motion(
        time=np.arange(4) / 10, real=seen, runs={"base": Run(points=off)}, held=None, triangles=None, is_material=False
    )
    assert shown.offset("base")[2:] == pytest.approx(np.tile([0.0, -0.004, 0.0], (3, 1)))
    assert shown.rms("base") == pytest.approx(np.zeros(4))


def three_frames():
    """Real points at rest, of which frame 2 shows a third, and simulated ones that are 0, 30 and 90 mm off."""
    still = np.zeros((3, 5, 3))
    off = still.copy()
    off[1, :, 0], off[2, :, 0] = 0.03, 0.09
    real = still.copy()
    real[2, 3:] = np.nan
    return still, off, real


def test_the_worst_frame_is_one_that_shows_half_of_the_free_points():
    """Frame 2 is farther off than frame 1, but shows one point of three."""
    still, off, real = three_frames()
    given = {"time": np.arange(3.0), "runs": {"base": Run(points=off)}, "held": None, "triangles": None}
    assert motion(real=real, **given).worst_frame == 1
    assert motion(real=still, **given).worst_frame == 2
    assert motion(real=np.full_like(still, np.nan), **given).worst_frame == 0


def test_the_worst_frame_of_the_legend_is_the_one_that_the_player_shows():
    """Frame 1, 30 mm off: frame 2 shows one point of three."""
    _, off, real = three_frames()
    runs = {"base": Run(points=off), "fit": Run(points=off / 2)}
    made = motion(time=np.arange(3.0), real=real, runs=runs, held=None, triangles=None)
    assert made.rms("base")[made.worst_frame] == pytest.approx(0.03)
    page = re.sub("<[^>]*>", " ", str(sections.errors(None, [made], 1)))
    assert re.findall(r"worst frame ([\d.]+)\smm", page)[:2] == ["30.0", "15.0"]
    assert "A worst frame shows half or more of the most free points seen at once." in page


def test_the_largest_error_of_a_point_is_that_of_all_frames_also_where_the_curve_leaves_frames_out():
    """Of 1001 frames every third is drawn. Frame 100, which is not, is 20 mm off, and all others are 10 mm off."""
    still = np.zeros((1001, 5, 3))
    off = still + np.array([0.01, 0.0, 0.0])
    off[100, :, 0] = 0.02
    given = {"real": still, "runs": {"base": Run(points=off)}, "held": None, "triangles": None}
    page = re.sub("<[^>]*>", " ", str(sections.errors(None, [motion(time=np.arange(1001.0), **given)], 1)))
    assert re.findall(r"largest ([\d.]+)\smm", page)[0] == "20.0"


def test_a_curve_breaks_where_no_free_point_is_seen():
    """Before, the held points alone made it fall there from 48 mm to 4 mm."""
    real = motion().real.copy()
    real[100:110, 2:] = np.nan
    lost = motion(real=real)
    assert np.isnan(lost.rms("base")[100:110]).all()
    assert np.isfinite(lost.rms("base")[[99, 110]]).all()
    whole, broken = (str(sections.errors(None, [m], 0)) for m in (motion(), lost))
    begins = [page.split('class="is-after" d="')[1].split('"')[0].count("M") for page in (whole, broken)]
    assert begins == [1, 2]


def test_the_figures_of_charts_and_answer_are_of_one_measure():
    from fit.report.answer import verdict

    both = [motion("swing-02", is_held_out=True), motion(noise=0.02)]
    answer = str(verdict(fit_result(), None, [replace(m, runs=_renamed(m)) for m in both]))
    held_out = rms_of(both[:1], "base")
    assert f"misses the real cloth by {1e3 * held_out:.1f} mm (root mean square) on motion not used to fit" in answer
    assert f"→ {1e3 * held_out:.1f}\u00a0mm" in answer
    assert "mean distance" not in answer


def _renamed(shown):
    return {"before": shown.runs["fit"], "after": shown.runs["base"]}


def test_a_motion_kept_beside_a_page_comes_back(tmp_path):
    page = tmp_path / "report.html"
    shown = [motion(), motion("swing-02", is_held_out=True, is_material=False, pull_hz=1.5)]
    origin = Origin(facts=[("command", "hangtime fit a")], takes=[("a", "fitted to", "00")])
    save_motions(page, shown, origin, "2026")
    found, whose = load_motions(page, "2026")
    assert whose == origin
    for before, after in zip(shown, found, strict=True):
        assert after.shown == before.shown
        assert (after.take_id, after.is_held_out, after.pull_hz) == (before.take_id, before.is_held_out, before.pull_hz)
        assert np.array_equal(np.isnan(after.real), np.isnan(before.real))
        for name in before.shown:
            assert np.abs(after.runs[name].mesh - before.runs[name].mesh).max() < 0.51e-4
            assert after.rms(name) == pytest.approx(before.rms(name), abs=1e-4)
    assert load_motions(page, "2027") == ([], None)  # of another result
    assert load_motions(tmp_path / "other.html", "2026") == ([], None)


@pytest.mark.parametrize("content", [b"", b"PK not a file", b"\x93NUMPY"])
def test_a_damaged_motion_is_refused_in_one_sentence(content, tmp_path):
    place_beside(tmp_path / "report.html").write_bytes(content)
    with pytest.raises(FitError, match=r"report\.motion\.npz: is no motion of a report"):
        load_motions(tmp_path / "report.html", "2026")


def _with_head(arrays, **changes):
    """The arrays of a motion file, with other words about its first take."""
    head = json.loads(arrays["head"].tobytes())
    head["takes"][0].update(changes)
    return {**arrays, "head": np.frombuffer(json.dumps(head).encode(), np.uint8)}


DAMAGES = {
    "no points of the cloth": lambda found: {n: v for n, v in found.items() if n != "0_real"},
    "no time": lambda found: {n: v for n, v in found.items() if n != "0_time"},
    "time of no number": lambda found: {**found, "0_time": np.full_like(found["0_time"], np.nan)},
    "time that stands": lambda found: {**found, "0_time": np.zeros_like(found["0_time"])},
    "time in words": lambda found: {**found, "0_time": np.full(found["0_time"].shape, "x")},
    "one number for a track": lambda found: {**found, "0_held": np.int32(1)},
    "tracks of bytes": lambda found: {**found, "0_real": found["0_real"].astype(np.int8)},
    "a frame less": lambda found: {**found, "0_mesh_base": found["0_mesh_base"][1:]},
    "two coordinates": lambda found: {**found, "0_held": found["0_held"][..., :2]},
    "corners of no mesh": lambda found: {**found, "0_triangles": found["0_triangles"] + 10**6},
    "triangles of numbers with commas": lambda found: {**found, "0_triangles": found["0_triangles"] * 1.0},
    "no judged points": lambda found: {**found, "0_free": np.zeros(0, bool)},
    "an endless outline": lambda found: {**found, "0_outline": np.full((4, 2), np.inf)},
    "names of few points": lambda found: _with_head(found, point_names=["a"]),
    "a name for the points": lambda found: _with_head(found, point_names="a"),
    "a run that no fit has": lambda found: _with_head(found, runs=["salto"]),
    "a pull in words": lambda found: _with_head(found, pull_hz="x"),
    "a take of no name": lambda found: _with_head(found, take_id=None),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_motion_of_other_arrays_is_refused_in_one_sentence(damage, tmp_path):
    shown = motion(free=np.ones(5, bool), outline=np.array([[0, 0], [1, 0], [1, 1], [0, 1]]))
    save_motions(tmp_path / "report.html", [shown], Origin(facts=[], takes=[]), "2026")
    assert len(load_motions(tmp_path / "report.html", "2026")[0]) == 1
    kept = place_beside(tmp_path / "report.html")
    with np.load(kept) as arrays:
        found = DAMAGES[damage](dict(arrays))
    np.savez_compressed(kept, **found)
    with pytest.raises(FitError, match=r"report\.motion\.npz: is no motion of a report; remove it, or"):
        load_motions(tmp_path / "report.html", "2026")


def test_an_origin_names_garment_mass_sensor_and_the_digest_of_every_take():
    time = np.arange(0, 3, 1 / 30)
    take, other = (take_of(sheet(), time, swing(time), name=name) for name in ("a", "b"))
    ready = Ready([take], [other], [content_of(take)], [content_of(other)], ([0], [0]))
    found = origin_of(ready, take, "hangtime fit a.mcap")
    facts = dict(found.facts)
    assert facts["mass"] == "36 g"
    assert facts["garment"].startswith("sheet: swatch, 400 × 450 mm, held by its top edge, 5 tracked points (material)")
    assert facts["sensor"].startswith("none: imported points")
    assert facts["command"] == "hangtime fit a.mcap"
    assert found.takes == [("a", "fitted to", content_of(take)), ("b", "held out", content_of(other))]
    assert len(facts["simulation and libraries"].removeprefix("sha256 ")) == 2 * hashlib.sha256().digest_size


def test_a_command_that_names_a_file_in_no_utf8_is_kept_with_its_motion(monkeypatch, tmp_path):
    monkeypatch.setattr("sys.argv", ["hangtime", "fit", "a\udcff.mcap"])
    assert command_line() == r"hangtime fit $'a\xff.mcap'"
    save_motions(tmp_path / "report.html", [], Origin(facts=[("command", command_line())]), "")


def test_a_long_motion_at_rest_comes_back_though_it_is_packed_small(tmp_path):
    """Unpacked it is 36 MB, and a hundredth of that packed."""
    shown = motion(seconds=100.0)
    mesh = np.tile(np.linspace(0, 1, 3000).reshape(1000, 3), (3000, 1, 1))
    still = replace(shown, triangles=None, runs={"base": Run(points=shown.runs["base"].points, mesh=mesh)})
    save_motions(tmp_path / "report.html", [still], Origin(facts=[], takes=[]), "2026")
    (back,), _ = load_motions(tmp_path / "report.html", "2026")
    assert np.abs(back.runs["base"].mesh - mesh).max() <= 0.5e-4 + 1e-12


def test_motions_beyond_the_limit_keep_every_second_frame(tmp_path, monkeypatch):
    shown = motion()
    tracks = [shown.real, shown.held, *(track for run in shown.runs.values() for track in (run.points, run.mesh))]
    size = 4 * sum(track.size for track in tracks)
    monkeypatch.setattr("fit.report.kept.MOST_BYTES", size - 1)
    save_motions(tmp_path / "report.html", [shown], Origin(facts=[], takes=[]), "2026")
    (back,), _ = load_motions(tmp_path / "report.html", "2026")
    assert np.array_equal(back.time, shown.time[::2])
    assert np.nanmax(np.abs(back.real - shown.real[::2])) <= 0.5e-4 + 1e-12
    assert np.abs(back.held - shown.held[::2]).max() <= 0.5e-4 + 1e-12
    for name, run in shown.runs.items():
        assert np.abs(back.runs[name].mesh - run.mesh[::2]).max() <= 0.5e-4 + 1e-12
        assert np.abs(back.runs[name].points - run.points[::2]).max() <= 0.5e-4 + 1e-12
    save_motions(tmp_path / "report.html", [replace(shown, held=None, real=np.repeat(shown.real, 9, 1)[:, :5])] * 2,
                 Origin(facts=[], takes=[]), "2027")  # fmt: skip
    assert {len(one.time) for one in load_motions(tmp_path / "report.html", "2027")[0]} == {90}
    assert load_motions(tmp_path / "report.html", "2027")[0][0].held is None


def test_all_arrays_of_a_motion_together_have_a_largest_size(tmp_path, monkeypatch):
    save_motions(tmp_path / "report.html", [motion(seconds=2.0)], Origin(facts=[], takes=[]), "2026")
    with zipfile.ZipFile(place_beside(tmp_path / "report.html")) as archive:
        size = sum(part.file_size for part in archive.infolist())
    monkeypatch.setattr("fit.report.kept.MOST_BYTES", 0)
    monkeypatch.setattr("fit.report.kept.PLAIN_BYTES", size)
    assert len(load_motions(tmp_path / "report.html", "2026")[0]) == 1
    monkeypatch.setattr("fit.report.kept.PLAIN_BYTES", size - 1)
    with pytest.raises(FitError, match="is no motion of a report"):
        load_motions(tmp_path / "report.html", "2026")
