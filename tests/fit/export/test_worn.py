"""A fitted skirt or T-shirt on a walking figure: intersections, refused requests, and exported files."""

from __future__ import annotations

import dataclasses
import io

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.export import caches
from fit.export.animation import Scene, animate
from fit.export.fabric import fabric_of
from fit.export.moving import Moving
from fit.export.solids import Solids, mesh_of
from fit.export.worn import FigureOrder, _remarks, worn
from fit.figure.dressmaking import plain_skirt, sewn_skirt
from fit.figure.gait import walk
from fit.figure.parts import figure_in
from fit.figure.shirt import arms_out, neck_sides, plain_shirt, sewn_shirt
from fit.recordings.bodies import Body, placed, sphere
from fit.recordings.held_edge import place_along
from tests.fit.export.exported import a_fit
from tests.fit.figure.walking import bvh_of


@pytest.fixture(scope="module")
def moving():
    """A figure that walks for a second beside a triangle of cloth."""
    figure = figure_in(sewn_skirt(plain_skirt(0.2))[0], walk(1.0))
    time = np.arange(0, 1, 1 / 10)
    rest = np.array([[0.0, 0.0], [0.05, 0.0], [0.0, 0.05]])
    places = np.tile(np.column_stack([rest, [0.0, 0.0, 0.0]]), (len(time), 1, 1)).astype(np.float32)
    return Moving(
        "walk", time, places, np.array([[0, 1, 2]]), rest, np.zeros((len(time), 0, 3)), (),
        np.zeros((len(time), 2, 3)), Solids(figure.names, figure.bodies, figure.motion), ("It went well.",),
    )  # fmt: skip


def test_the_mesh_of_a_body_lies_on_its_surface_and_is_closed():
    for body in (
        sphere((0.0, 0.0, 0.0), 0.1), Body(centre=(0, 0, 0), half_size=(0.05, 0, 0.1), radius=0.08),
        Body(centre=(0, 0, 0), half_size=(0.0, 0.0, 0.2), radius=0.06, taper=-0.1),
    ):  # fmt: skip
        places, triangles = mesh_of(body)
        assert body.distance(places) == pytest.approx(0.0, abs=1e-3)
        a, b, c = (places[triangles[:, k]] for k in range(3))
        volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)
        assert volume > 0  # triangles are seen from outside
        if body.half_size == (0, 0, 0):
            assert volume == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.03)


def test_gltf_holds_every_part_where_it_is(moving):
    gltf = pytest.importorskip("pygltflib", reason="pygltflib is not installed")
    raw = caches.gltf(a_fit(), fabric_of(a_fit()), moving)
    file = gltf.GLTF2.load_from_bytes(raw)
    names = [node.name for node in file.nodes]
    assert names == ["cloth", *moving.figure.names]
    head = names.index("head")
    channel = next(c for c in file.animations[0].channels if c.target.node == head and c.target.path == "translation")
    accessor = file.accessors[file.animations[0].samplers[channel.sampler].output]
    view = file.bufferViews[accessor.bufferView]
    at = np.frombuffer(file.binary_blob()[view.byteOffset :][: view.byteLength], "<f4").reshape(-1, 3)
    x, y, z = moving.figure.motion.at(moving.time)[:, head - 1, :3].T
    assert at == pytest.approx(np.stack([x, z, -y], 1), abs=1e-5)


def test_trimesh_puts_the_parts_of_gltf_where_the_figure_stands(moving):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    scene = trimesh.load(io.BytesIO(caches.gltf(a_fit(), None, moving)), file_type="glb")
    low, high = scene.bounds
    places = moving.figure.places(0.0)
    assert high[1] == pytest.approx(places[:, 2].max(), abs=1e-3)
    assert low[0] == pytest.approx(places[:, 0].min(), abs=1e-3)
    assert -low[2] == pytest.approx(places[:, 1].max(), abs=1e-3)


def test_usd_core_reads_the_parts_where_they_are(moving, tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom

    path = tmp_path / "walk.usdc"
    path.write_bytes(caches.usd_cache(a_fit(), None, moving))
    stage = Usd.Stage.Open(str(path))
    part = moving.figure.names.index("left_shank")
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Garment/figure/left_shank"))
    code = 30.0 * moving.time[7]
    turn = np.array(UsdGeom.Xformable(mesh).ComputeLocalToWorldTransform(code))
    points = np.array(mesh.GetPointsAttr().Get()) @ turn[:3, :3] + turn[3, :3]
    first = sum(len(p) for p, _ in moving.figure.meshes[:part])
    expected = moving.figure.places(float(moving.time[7]))[first : first + len(points)]
    assert points == pytest.approx(expected, abs=1e-5)
    assert "It went well." in stage.GetRootLayer().documentation


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"figure": FigureOrder(kind="dance")}, "no figure moves by 'dance'; known: walk"),
        ({"figure": FigureOrder(height=17.0)}, "nobody is 17 m tall"),
        ({"figure": FigureOrder(height=17.0)}, "give 0.8 to 2.3 m"),
        ({"figure": FigureOrder(wear="hat")}, "no figure wears 'hat'; known: skirt, t-shirt"),
        ({"figure": FigureOrder(speed=9.0)}, "nobody walks at 9 m/s"),
        ({"figure": FigureOrder(), "seconds": 100.0}, "100 s is no length for a figure's walk"),
        ({"figure": FigureOrder(), "motion": "twist"}, "a figure moves by itself"),
        ({"figure": FigureOrder(), "result": a_fit("kinect-skirt")}, "none of its numbers has an SI value"),
    ],
)
def test_walks_that_cannot_be_are_refused_and_leave_nothing(changes, reason, tmp_path):
    scene = dataclasses.replace(Scene(result=a_fit(), seconds=3.0), **changes)
    with pytest.raises(FitError, match=reason):
        animate(scene, tmp_path / "walk.gif", size=(160, 120))
    assert list(tmp_path.iterdir()) == []


def test_the_summary_of_a_walk_names_crossings_overlap_and_stretch():
    assert _remarks("skirt", [0, 0], -1.8e-3, (0.12, 0.05)) == (
        "The skirt crosses itself in none of 2 frames.", "Cloth and body stay at least 1.8 mm apart.",
    )  # fmt: skip
    assert _remarks("T-shirt", [0, 3, 1], 2e-4, (0.3, 0.08)) == (
        "The T-shirt crosses itself in 2 of 3 frames, at 4 places in all.",
        "Cloth and body overlap by up to 0.2 mm; more than 12 mm are refused.",
        "The T-shirt is stretched by up to 30 %, and 99 % of it by 8 % at most. The T-shirt is tight for these "
        "steps, or its fabric is soft.",
    )


@pytest.mark.slow
def test_a_skirt_is_worn_through_a_walk_without_crossing_body_or_itself():
    """Five steps at 1.2 m/s: the band stays on the hips, the hem swings, nothing passes through anything."""
    told = []
    moving = worn(a_fit(), None, FigureOrder(), 4.0, progress=told.append)
    assert told[-1] == 1.0
    assert moving.remarks[0] == f"The skirt crosses itself in none of {len(moving.time)} frames."
    assert "apart" in moving.remarks[1] or float(moving.remarks[1].split()[7]) < 3.0
    top = np.flatnonzero(moving.rest[:, 1] > -1e-6)
    pelvis = moving.figure.motion.at(moving.time)[:, moving.figure.names.index("hips"), :3]
    apart = np.linalg.norm(moving.places[:, top] - pelvis[:, None], axis=2)
    assert np.ptp(apart, axis=0).max() < 2e-3
    hem = np.flatnonzero(moving.rest[:, 1] < -0.5 + 1e-6)
    ahead = moving.places[:, hem, 1].astype(float) - pelvis[:, None, 1]
    assert np.ptp(ahead[60:], axis=0).max() > 0.1


@pytest.mark.slow
def test_a_t_shirt_is_worn_through_a_walk_without_crossing_body_or_itself():
    """Four steps: the collar stays round the neck, the shoulders carry the cloth, and sleeves follow the arms."""
    moving = worn(a_fit(), None, FigureOrder(wear="t-shirt"), 3.0)
    assert moving.remarks[0] == f"The T-shirt crosses itself in none of {len(moving.time)} frames."
    assert "apart" in moving.remarks[1] or float(moving.remarks[1].split()[7]) < 3.0
    names, last = moving.figure.names, len(moving.time) - 1
    poses = moving.figure.motion.at(moving.time)
    sides = neck_sides(sewn_shirt(plain_shirt(0.2))[0])
    collar = np.flatnonzero(np.any([place_along(moving.rest, side)[1] for side in sides], axis=0))
    apart = np.linalg.norm(moving.places[:, collar] - poses[:, None, names.index("neck"), :3], axis=2)
    assert np.ptp(apart, axis=0).max() < 2e-3
    shoulder = (np.abs(np.abs(moving.rest[:, 0]) - 0.2) < 0.02) & (np.abs(moving.rest[:, 1] + 0.03) < 0.02)
    bodies = [placed(b, p) for b, p in zip(moving.figure.bodies, poses[last], strict=True)]
    touched = [n for n, name in enumerate(names) if name.endswith(("shoulder", "upper_arm", "shoulders"))]
    high = np.min([bodies[n].distance(moving.places[last, shoulder]) for n in touched], axis=0)
    assert np.median(high) < 0.02
    for side, tip in (("left", np.argmax(moving.rest[:, 0])), ("right", np.argmin(moving.rest[:, 0]))):
        arm = bodies[names.index(f"{side}_upper_arm")]
        assert arm.distance(moving.places[:, tip][last]) < 0.06


@pytest.mark.slow
def test_a_leg_that_goes_through_the_cloth_is_refused_with_the_frame(tmp_path, monkeypatch):
    """A knee that is half a metre farther ahead within 8 ms, at 2.4 s: no contact holds 60 m/s."""
    source = walk(6.0, 0.8)
    at = np.arange(len(source.pelvis)) * source.spacing
    kick = np.where((at > 2.4) & (at < 2.7), 0.5, 0.0)[:, None] * [0.0, -1.0, 0.3]
    source.joints["left_knee"] += kick
    source.joints["left_ankle"] += 2 * kick
    monkeypatch.setattr("fit.export.worn.walk", lambda *_: source)
    with pytest.raises(
        FitError, match=r"walks through the cloth with its left (thigh|shank) in frame 7\d, at 2.[45]\d s"
    ):
        worn(a_fit(), None, FigureOrder(), 3.0)


@pytest.mark.slow
def test_an_arm_that_goes_through_a_sleeve_is_refused_with_the_frame(monkeypatch):
    """An elbow that is a quarter of a metre farther ahead within 2 ms, at 1.5 s."""
    source = walk(6.0, 0.8, arms_out=arms_out(sewn_shirt(plain_shirt(0.2))[0]))
    at = np.arange(len(source.pelvis)) * source.spacing
    kick = np.where((at > 1.5) & (at < 1.8), 0.25, 0.0)[:, None] * [0.0, -1.0, 0.3]
    for joint in ("elbow", "wrist", "finger"):
        source.joints[f"left_{joint}"] += kick
    monkeypatch.setattr("fit.export.worn.walk", lambda *_: source)
    with pytest.raises(
        FitError,
        match=r"walks through the cloth with its left (shoulder|upper arm|forearm) in frame 4\d, at 1.[56]\d s",
    ):
        worn(a_fit(), None, FigureOrder(wear="t-shirt"), 2.0, spacing=0.05)


@pytest.mark.slow
def test_a_take_of_a_skirt_lends_its_cut_and_a_bvh_file_its_motion(tmp_path):
    path = tmp_path / "walk.bvh"
    path.write_text(bvh_of(walk(5.0, 1.0)))
    skirt = msgspec.structs.replace(plain_skirt(0.15), name="grey skirt")
    moving = worn(a_fit(), skirt, FigureOrder(bvh=path), 3.0, spacing=0.05)
    assert moving.name == "grey skirt"
    assert len(moving.time) == 91
    assert "ends early" not in moving.remarks[0]


@pytest.mark.slow
def test_a_bvh_file_that_is_shorter_than_the_film_says_so(tmp_path):
    path = tmp_path / "walk.bvh"
    path.write_text(bvh_of(walk(1.2, 1.0)))
    moving = worn(a_fit(), None, FigureOrder(bvh=path), 3.0, spacing=0.05)
    assert moving.remarks[0] == "walk.bvh ends early: the motion lasts 2.2 s, its lead included, and not 3 s."
    assert moving.time[-1] == pytest.approx(2.2, abs=0.05)
