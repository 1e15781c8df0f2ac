"""What Blender's engine asks of Blender and makes of its answer, with an answer that is the asked path itself."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fit.cloth.model import Resolution
from fit.engines import blender, check_engine
from fit.engines.blender import BlenderEngine, blender_settings
from fit.engines.plain_grid import plain_grid
from fit.errors import FitError
from fit.methods import KINECT_SKIRT
from fit.recordings.recording import prepare
from formats.garment import Garment, TrackedPoint
from tests.fit.scenes import hung, sheet, take_of

COARSE = Resolution(spacing=0.15)


class Echo:
    """Answers every candidate with the path of all nodes, shifted by a metre along y a candidate."""

    version = "5.2.3"

    def __init__(self, foreign):
        self.jobs = []

    def answer(self, **job):
        self.jobs.append(job)
        shifts = np.arange(len(job["settings"]))[:, None, None, None] * np.array([0.0, 1.0, 0.0])
        return {"nodes": (job["path"][None] + shifts).astype(np.float32)}


@pytest.fixture
def engine(monkeypatch):
    """The engine of a take at 25 frames a second whose hanger goes at 0.5 m/s along y from 1 m away."""
    monkeypatch.setattr(blender, "ForeignProcess", Echo)
    time = np.arange(0, 1.01, 1 / 25)
    path = np.stack([0 * time, 1.0 + 0.5 * time, 0 * time], 1)
    recording = prepare(take_of(sheet(), time, path, hung(sheet(), time) + path[:, None]))
    return BlenderEngine(recording, KINECT_SKIRT, (), COARSE), recording


def test_blender_gets_the_methods_settings_and_the_path_at_thirty_frames_a_second(engine):
    made, recording = engine
    vectors = np.stack([KINECT_SKIRT.initial, KINECT_SKIRT.maximum])
    made.points(vectors)
    (job,) = made._worker.jobs
    assert made.version == "5.2.3"
    assert job["settings"] == pytest.approx(blender_settings(vectors))
    assert job["fps"] == 30
    assert (job["quads"] == made.grid.quads).all()
    assert (job["pinned"] == made.grid.held_nodes).all()
    # Half a second to the first held ends, 1.5 s of rest, 1 s of the take and two frames to interpolate to.
    assert len(job["path"]) == 90 + 2
    assert recording.duration == pytest.approx(1.0)


def test_the_edge_goes_to_the_first_held_ends_in_half_a_second_rests_and_then_follows_the_take(engine):
    """The cloth begins flat with the middle of its held edge at the middle of the first held ends."""
    made, recording = engine
    held = made.grid.held_nodes
    path = made._path
    flat = np.stack([made.grid.rest[:, 0], np.full(len(made.grid.rest), 1.0), made.grid.rest[:, 1]], 1)
    assert path[0] == pytest.approx(flat, abs=1e-6)
    assert path[:61, held] == pytest.approx(np.tile(flat[held], (61, 1, 1)), abs=1e-6)
    later = np.arange(60, 91) / 30 - 2.0
    ends = recording.held(later).reshape(-1, 2, 3)
    share = np.linspace(0, 1, len(held))[None, :, None]
    assert path[60:91, held] == pytest.approx((1 - share) * ends[:, None, 0] + share * ends[:, None, 1], abs=1e-9)


def test_a_garment_that_starts_beside_its_held_ends_approaches_them_evenly():
    """The ends of the take are 4 cm nearer together than the flat edge: a third of it after 5 of 15 frames."""
    time = np.arange(0, 1.01, 1 / 30)
    recording = prepare(take_of(sheet(), time, np.zeros((len(time), 3)), hung(sheet(), time)))
    narrow = np.array([[-0.18, 0.0, 0.0, 0.18, 0.0, 0.0]])
    recording = dataclasses.replace(recording, held=lambda at: np.tile(narrow, (len(at), 1)))
    grid = plain_grid(sheet(), 0.15)
    left = blender._driven_path(recording, grid)[:, grid.held_nodes[0], 0]
    assert left[[0, 5, 10, 15, 60]] == pytest.approx([-0.2, -0.2 + 0.02 / 3, -0.2 + 0.04 / 3, -0.18, -0.18])


def test_the_points_are_those_of_the_cloth_at_the_recordings_own_instants(engine):
    """On a straight path interpolation between two of Blender's frames is exact, to single precision."""
    made, recording = engine
    first, second = made.points(np.stack([KINECT_SKIRT.initial] * 2))
    ends = recording.held(recording.time).reshape(-1, 2, 3)
    assert first.shape == (len(recording.time), 5, 3)
    assert first[:, :2] == pytest.approx(ends, abs=1e-6)
    assert first[:, 4] == pytest.approx(np.tile([0.0, 1.0, -0.225], (len(first), 1)), abs=1e-6)  # a free point stays
    assert second - first == pytest.approx(np.tile([0.0, 1.0, 0.0], (*first.shape[:2], 1)), abs=1e-6)


def test_bodies_and_a_missing_blender_are_refused(monkeypatch, engine, tmp_path):
    _, recording = engine
    with pytest.raises(FitError, match="is given no bodies"):
        BlenderEngine(dataclasses.replace(recording, bodies=(object(),)), KINECT_SKIRT, (), COARSE)
    monkeypatch.setenv(blender.BLENDER.variable, str(tmp_path / "nowhere"))
    with pytest.raises(FitError, match="bpy cannot be started"):
        check_engine("blender", KINECT_SKIRT, ())
    check_engine("own", KINECT_SKIRT, ())


def panel(*corners, points=(), held="edge"):
    return Garment(
        format="hangtime-garment/1", name="panel", kind="swatch", mass_kg=0.03, outline_m=corners, held=held,
        points=tuple(TrackedPoint(name=f"p{k}", at_m=at) for k, at in enumerate(points)),
    )  # fmt: skip


def test_an_even_grid_covers_a_trapeze_and_places_a_point_by_its_four_nodes():
    """Sides of 0.2 and 0.4 m make three faces across, and slanted sides of 0.41 m four down."""
    trapeze = ((-0.1, 0.0), (0.1, 0.0), (0.2, -0.4), (-0.2, -0.4))
    places = [(-0.1, 0.0), (0.2, -0.4), (0.0, -0.2), (0.05, -0.3)]
    grid = plain_grid(panel(*trapeze, points=places), 0.1)
    assert len(grid.rest) == 4 * 5
    assert grid.rest[:4] == pytest.approx(np.stack([np.linspace(-0.1, 0.1, 4), np.zeros(4)], 1))
    assert grid.rest[-4:] == pytest.approx(np.stack([np.linspace(-0.2, 0.2, 4), np.full(4, -0.4)], 1))
    assert grid.rest[8:12] == pytest.approx(np.stack([np.linspace(-0.15, 0.15, 4), np.full(4, -0.2)], 1))
    assert grid.quads[0].tolist() == [0, 4, 5, 1]
    assert len(grid.quads) == 3 * 4
    assert grid.triangles[[0, 12]].tolist() == [[0, 4, 5], [0, 5, 1]]
    assert grid.held_nodes.tolist() == [0, 1, 2, 3]
    assert grid.held_fraction == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert np.einsum("pw,pwx->px", grid.point_weights, grid.rest[grid.point_nodes]) == pytest.approx(np.array(places))
    assert (np.ptp(grid.point_nodes, axis=1) == 5).all()  # nodes of one face


def test_cloth_that_is_held_at_its_corners_is_pinned_there_alone():
    square = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4))
    grid = plain_grid(panel(*square, held="corners"), 0.1)
    assert grid.held_nodes.tolist() == [0, 4]
    assert grid.held_fraction.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("spacing", [0.0, 0.21])
def test_a_grid_needs_two_faces_along_the_shortest_side(spacing):
    square = ((-0.2, 0.0), (0.2, 0.0), (0.2, -0.4), (-0.2, -0.4))
    with pytest.raises(FitError, match=r"does not fit 4 corners, the shortest side 0\.400 m"):
        plain_grid(panel(*square), spacing)
    assert len(plain_grid(panel(*square), 0.2).rest) == 9
