"""Every field of the moving cloth's files, from a square that moves for three uneven frames."""

from __future__ import annotations

import dataclasses
import json
import struct
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.errors import BlowUpError, FitError
from fit.export import caches
from fit.export import moving as moving_module
from fit.export.fabric import fabric_of
from fit.export.moving import known_effects, material_rows, motion_of
from fit.export.solids import Solids
from fit.export.video import film
from fit.figure.dressmaking import plain_skirt, sewn_skirt
from fit.figure.gait import walk
from fit.figure.parts import figure_in
from fit.recordings.recording import prepare
from tests.fit.export.exported import a_fit
from tests.fit.export.test_animation import square
from tests.fit.scenes import hung, sheet, take_of

TIMES = np.array([0.0, 0.1, 0.25])


def moved(**more):
    """The square of 0.2 m, by 0, 10 and 30 mm along y, and 0, 0 and 5 mm up."""
    still = square(0.0)
    places = np.stack(
        [still.places[0] + np.array([0, y, z], np.float32) for y, z in ((0, 0), (0.01, 0), (0.03, 0.005))]
    )
    held = places[:, [3, 2]].astype(float)
    return dataclasses.replace(
        still, time=TIMES, places=places, held=held, points=places[:, :1].astype(float), point_names=("left",),
        remarks=("It went well.",), **more,
    )  # fmt: skip


def with_figure():
    figure = figure_in(sewn_skirt(plain_skirt(0.2))[0], walk(1.0))
    return moved(figure=Solids(figure.names, figure.bodies, figure.motion))


def document_of(raw):
    (length,) = struct.unpack_from("<I", raw, 12)
    return json.loads(raw[20 : 20 + length]), raw[28 + length :]


def arrays_of(document, blob):
    """Every accessor as an array."""
    found = []
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        kind = {5126: np.float32, 5125: np.uint32}[accessor["componentType"]]
        wide = {"VEC4": 4, "VEC3": 3, "VEC2": 2, "SCALAR": 1}[accessor["type"]]
        assert view["byteOffset"] % 4 == 0
        found.append(np.frombuffer(blob, kind, accessor["count"] * wide, view["byteOffset"]).reshape(-1, wide))
    return found


def test_a_gltf_of_cloth_alone_has_one_mesh_one_material_and_one_channel():
    document, blob = document_of(caches.gltf(a_fit(), fabric_of(a_fit()), moved()))
    arrays = arrays_of(document, blob)
    (mesh,), (node,), (material,) = document["meshes"], document["nodes"], document["materials"]
    assert document["scenes"] == [{"nodes": [0], "name": "square"}]
    assert document["scene"] == 0
    assert node == {"mesh": 0, "name": "cloth"}
    assert mesh["weights"] == [0.0, 0.0]
    assert material["doubleSided"] is True
    assert material["pbrMetallicRoughness"] == {
        "baseColorFactor": [0.35, 0.45, 0.65, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9,
    }  # fmt: skip
    (primitive,) = mesh["primitives"]
    assert primitive["material"] == 0
    upright = moved().places[:, :, [0, 2, 1]] * [1, 1, -1]
    assert arrays[primitive["attributes"]["POSITION"]] == pytest.approx(upright[0])
    assert arrays[primitive["attributes"]["TEXCOORD_0"]] == pytest.approx(moved().rest)
    assert arrays[primitive["indices"]].ravel().tolist() == moved().triangles.ravel().tolist()
    for target, later in zip(primitive["targets"], upright[1:], strict=True):
        assert arrays[target["POSITION"]] == pytest.approx(later - upright[0], abs=1e-7)
        accessor = document["accessors"][target["POSITION"]]
        assert accessor["max"] == pytest.approx((later - upright[0]).max(0), abs=1e-7)
        assert accessor["min"] == pytest.approx((later - upright[0]).min(0), abs=1e-7)
    assert arrays[primitive["attributes"]["NORMAL"]] == pytest.approx(np.tile([0.0, 0.0, 1.0], (4, 1)))
    (animation,) = document["animations"]
    (sampler,), (channel,) = animation["samplers"], animation["channels"]
    assert channel == {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    assert sampler["interpolation"] == "LINEAR"
    assert arrays[sampler["input"]].ravel() == pytest.approx(TIMES)
    assert document["accessors"][sampler["input"]]["max"] == pytest.approx([0.25])
    assert arrays[sampler["output"]].reshape(3, 2).tolist() == [[0, 0], [1, 0], [0, 1]]
    targets = {document["bufferViews"][a["bufferView"]].get("target") for a in document["accessors"][:4]}
    assert targets == {34962, 34963}
    assert document["asset"]["version"] == "2.0"
    assert document["asset"]["extras"]["cautions"][-1] == "It went well."


def test_a_gltf_with_a_figure_moves_each_part_by_a_node_of_its_own():
    made = with_figure()
    document, blob = document_of(caches.gltf(a_fit(), None, made))
    arrays = arrays_of(document, blob)
    count = len(made.figure.names)
    assert [node["name"] for node in document["nodes"]] == ["cloth", *made.figure.names]
    assert [node["mesh"] for node in document["nodes"]] == list(range(1 + count))
    assert [material["name"] for material in document["materials"]] == ["cloth", "figure"]
    assert document["scenes"][0]["nodes"] == list(range(1 + count))
    assert document["materials"][1]["pbrMetallicRoughness"] == {
        "baseColorFactor": [0.77, 0.74, 0.71, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8,
    }  # fmt: skip
    (animation,) = document["animations"]
    assert [(c["sampler"], c["target"]["node"], c["target"]["path"]) for c in animation["channels"][1:]] == [
        (1 + 2 * k + (path == "rotation"), 1 + k, path) for k in range(count) for path in ("translation", "rotation")
    ]
    for k in range(count):
        (primitive,) = document["meshes"][1 + k]["primitives"]
        assert primitive["material"] == 1
        assert arrays[primitive["attributes"]["POSITION"]] == pytest.approx(made.figure.meshes[k][0], abs=1e-6)
        turns = arrays[animation["samplers"][2 + 2 * k]["output"]]
        assert (np.einsum("ni,ni->n", turns[1:], turns[:-1]) > 0).all()  # interpolated the short way
        node = document["nodes"][1 + k]
        assert node["rotation"] == pytest.approx(turns[0], abs=1e-6)
        assert node["translation"] == pytest.approx(arrays[animation["samplers"][1 + 2 * k]["output"]][0], abs=1e-6)


def test_usd_samples_points_and_extents_at_thirty_codes_a_second(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom

    made = with_figure()
    (tmp_path / "a.usdc").write_bytes(caches.usd_cache(a_fit(), None, made))
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    assert (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()) == (30.0, 30.0)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, 7.5)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Garment/cloth"))
    assert mesh.GetPointsAttr().GetTimeSamples() == pytest.approx(30 * TIMES)
    for code, places in zip(30 * TIMES, made.places, strict=True):
        assert np.array(mesh.GetPointsAttr().Get(code)) == pytest.approx(places)
        assert np.array(mesh.GetExtentAttr().Get(code)) == pytest.approx(np.stack([places.min(0), places.max(0)]))
    flat = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    assert np.array(flat.Get()) == pytest.approx(made.rest, abs=1e-6)
    assert flat.GetInterpolation() == "vertex"
    assert stage.GetRootLayer().documentation.endswith("It went well.")
    assert stage.GetPrimAtPath("/Garment/figure").GetTypeName() == "Xform"
    for name, (places, _) in zip(made.figure.names, made.figure.meshes, strict=True):
        part = UsdGeom.Mesh(stage.GetPrimAtPath(f"/Garment/figure/{name}"))
        assert np.array(part.GetExtentAttr().Get()) == pytest.approx(np.stack([places.min(0), places.max(0)]), abs=1e-6)
        assert np.array(part.GetDisplayColorAttr().Get()) == pytest.approx(np.array([[0.77, 0.74, 0.71]]))


def test_rows_of_motion_are_the_points_then_the_held_ends_of_each_frame():
    rows = list(caches.motion_rows(moved()))
    assert [row[:2] for row in rows] == [
        (t, name) for t in TIMES.tolist() for name in ("left", "held_left", "held_right")
    ]
    assert rows[5][2:] == pytest.approx(moved().held[1, 1])


def test_a_motion_in_text_has_the_shortest_decimal_of_each_32_bit_float():
    """It was written as a double, -0.20000000298023224; a double keeps every digit."""
    rng = np.random.default_rng(3)
    single = rng.normal(size=(3, 1, 3)).astype(np.float32) * np.float32([1.0, 1e-6, 1e9])
    single[0] = [-0.2, 0.1, 16777216.0]
    made = dataclasses.replace(moved(), points=single, held=rng.normal(size=(3, 2, 3)))
    rows = [line.split(",") for line in caches.motion_csv(made).splitlines()[1:]]
    assert rows[0][2:] == ["-0.2", "0.1", "16777216.0"]
    assert np.float32([row[2:] for row in rows[::3]]).tolist() == single[:, 0].tolist()
    shown = [cell.lstrip("-").split("e")[0].replace(".", "").strip("0") for row in rows[::3] for cell in row[2:]]
    assert max(map(len, shown)) <= 9
    assert [list(map(float, row[2:])) for row in rows if row[1] == "held_right"] == made.held[:, 1].tolist()


def test_an_obj_counts_from_one_and_holds_the_flat_places_and_the_rate():
    made = moved()
    lines = caches.obj(a_fit(), None, made).decode().splitlines()
    assert [line for line in lines if line.startswith("f ")] == ["f 1/1 2/2 3/3", "f 1/1 3/3 4/4"]
    flat = np.array([line.split()[1:] for line in lines if line.startswith("vt ")], float)
    assert flat == pytest.approx(made.rest)
    assert "# Motion: 3 samples at 8 a second, z up, metres." in lines


def test_a_motion_is_followed_only_where_a_figure_wears_it_and_on_the_floor():
    assert (moved().followed == np.zeros((3, 3))).all()
    made = moved(figure=object())
    assert made.followed == pytest.approx(made.held.mean(1) * [1, 1, 0])


def test_an_even_motion_is_left_and_another_rate_is_sampled_from_its_first_instant_on():
    made = moved()
    even = made.even(20.0)
    assert even.time == pytest.approx(np.arange(6) / 20)
    assert even.places[[0, 2]] == pytest.approx(made.places[[0, 1]], abs=1e-7)
    assert (even.points[2], even.held[5]) == (pytest.approx(made.points[1]), pytest.approx(made.held[2]))
    regular = dataclasses.replace(made, time=np.array([0.0, 0.1, 0.2]))
    assert regular.even() is regular
    assert regular.rate == pytest.approx(10.0)


class Asked:
    """A simulator that records what it is asked, of a mesh of 0.2 m^2."""

    def __init__(self, recording, effects, *, resolution):
        Asked.effects, Asked.spacing = [e.name for e in effects], resolution.spacing
        self.mesh = SimpleNamespace(area=0.2, triangles=np.array([[0, 1, 2]]), rest=np.zeros((3, 2)))
        self._frames = len(recording.time)

    def run(self, rows, amplitudes, *, shapes, progress):
        Asked.rows, Asked.amplitudes = rows, amplitudes
        points = np.zeros((1, self._frames, 5, 3)) + Asked.offset
        return SimpleNamespace(points=points, shapes=np.zeros((1, self._frames, 3, 3)) if Asked.has_shapes else None)


@pytest.fixture
def recording(monkeypatch):
    monkeypatch.setattr(moving_module, "Simulator", Asked)
    Asked.offset, Asked.has_shapes = 0.0, True
    time = np.arange(0, 1, 1 / 30)
    return prepare(take_of(sheet(mass=0.05), time, np.zeros((30, 3)), hung(sheet(), time)))


def test_moving_cloth_has_the_fits_material_at_the_garments_own_weight_and_all_of_its_effects(recording):
    result = a_fit(effects={"air_drag": 1.3, "clip_slip.left": 0.002, "clip_slip.right": 0.004})
    made = motion_of(result, recording, 0.1)
    assert Asked.rows == pytest.approx(material_rows(result, 0.25))
    assert Asked.effects == ["clip_slip", "air_drag"]
    assert Asked.amplitudes.tolist() == [[0.002, 0.004, 1.3]]
    assert Asked.spacing == 0.1
    assert made.triangles.dtype == np.int64
    assert made.held == pytest.approx(recording.held(recording.time).reshape(-1, 2, 3))
    motion_of(msgspec.structs.replace(result, spacing=0.07), recording)
    assert Asked.spacing == 0.07
    motion_of(result, recording)
    assert Asked.spacing == result.spacing or moving_module.find_method("si").spacing


def test_layers_are_kept_apart_by_contact_unless_the_fit_has_contact_itself(recording):
    motion_of(a_fit(), recording, 0.1, layers_apart=2e-3)
    assert (Asked.effects, Asked.amplitudes.tolist()) == (["self_contact"], [[2e-3]])
    motion_of(a_fit(effects={"self_contact": 4e-3}), recording, 0.1, layers_apart=2e-3)
    assert (Asked.effects, Asked.amplitudes.tolist()) == (["self_contact"], [[4e-3]])
    motion_of(a_fit(), recording, 0.1)
    assert Asked.effects == []


def test_motion_that_does_not_stay_finite_is_refused_with_its_take(recording):
    Asked.offset = np.nan
    with pytest.raises(BlowUpError, match=r"^scene: the simulation of this take blew up"):
        motion_of(a_fit(), recording, 0.1)
    Asked.offset, Asked.has_shapes = 0.0, False
    with pytest.raises(BlowUpError):
        motion_of(a_fit(), recording, 0.1)


def test_a_fit_of_an_effect_or_a_parameter_that_is_not_there_is_refused():
    with pytest.raises(FitError, match="knows no effect wind"):
        known_effects(msgspec.structs.replace(a_fit(), effects={"wind": 1.0, "hem": 0.01}))
    with pytest.raises(FitError, match="lacks shear_stiffness, a parameter of the method si"):
        material_rows(msgspec.structs.replace(a_fit(), parameters=a_fit().parameters[:1]), 0.2)


@pytest.mark.parametrize(("suffix", "library"), [(".gif", "PIL"), (".mp4", "av"), (".webm", "av")])
def test_a_film_tells_each_of_its_pictures_and_holds_its_remark(suffix, library):
    pytest.importorskip("PIL")
    pytest.importorskip(library)
    told = []
    made = dataclasses.replace(moved(), time=np.array([0.0, 0.1, 0.2]))
    raw = film(made, suffix, "A remark.", (64, 64), lambda done, total: told.append((done, total)))
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert b"A remark." in raw
