"""The fitted cloth in motion: independent readers find the same positions in the files within 0.1 mm."""

from __future__ import annotations

import dataclasses
import io
import json
import struct
import sys
from importlib.util import find_spec

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.export import kinds
from fit.export.about import caution_lines
from fit.export.kinds import EXPORT_KINDS, Order, export
from fit.export.moving import Moving, moving_cloth
from formats.archive import write_take
from formats.results import save_fit_result
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.scenes import hung, sheet, swing, take_of

TENTH = 1e-4  # m


@pytest.fixture(scope="module")
def order():
    """A coarse sheet that swings for a second."""
    time = np.arange(0, 1.2, 1 / 30)
    garment = sheet()
    take = take_of(garment, time, swing(time, amplitude=0.1, hz=1.5, start=0.0), hung(garment, time))
    return Order(result=a_fit(unknown=("shear_stiffness",)), take=take, spacing=0.15)


def files_of(kind, order):
    return EXPORT_KINDS[kind].make(order)


def test_the_motion_follows_the_hanger_and_moves(order):
    moving = order.moving
    assert moving.places.shape == (36, len(moving.rest), 3)
    top = np.flatnonzero(np.isclose(moving.rest[:, 1], 0.0))
    left = moving.places[:, top[np.argmin(moving.rest[top, 0])]]
    assert np.abs(left - moving.held[:, 0]).max() < TENTH
    assert np.ptp(moving.places[..., 1]) > 0.1


def test_without_a_spacing_the_mesh_is_the_fits_own(order):
    fitted = dataclasses.replace(order, spacing=None, result=msgspec.structs.replace(order.result, spacing=0.15))
    assert np.array_equal(fitted.moving.places, order.moving.places)
    assert np.array_equal(fitted.sheet.rest, order.sheet.rest)
    assert len(dataclasses.replace(fitted, result=order.result).sheet.rest) != len(order.sheet.rest)


def test_usd_core_reads_the_same_motion(order, tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom

    (path,) = export(order, "usd", tmp_path / "swing.usdc")
    stage = Usd.Stage.Open(str(path))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/Garment/cloth")).GetPointsAttr()
    seconds = np.array(points.GetTimeSamples()) / stage.GetTimeCodesPerSecond()
    read = np.array([points.Get(t) for t in points.GetTimeSamples()])
    assert seconds == pytest.approx(order.moving.time, abs=1e-6)
    assert np.abs(read - order.moving.places).max() < TENTH
    assert stage.GetEndTimeCode() == pytest.approx(35.0)
    assert "shear: 90 % interval 24 to 37.5 N/m" in stage.GetRootLayer().documentation


def test_pygltflib_reads_the_same_motion(order, tmp_path):
    pygltflib = pytest.importorskip("pygltflib", reason="pygltflib is not installed")
    (path,) = export(order, "gltf", tmp_path / "swing.glb")
    read = pygltflib.GLTF2().load(str(path))
    blob = read.binary_blob()

    def array(number):
        accessor = read.accessors[number]
        view = read.bufferViews[accessor.bufferView]
        kind = {5126: np.float32, 5125: np.uint32}[accessor.componentType]
        width = {"VEC3": 3, "VEC2": 2, "SCALAR": 1}[accessor.type]
        return np.frombuffer(blob, kind, accessor.count * width, view.byteOffset).reshape(-1, width)

    (primitive,) = read.meshes[0].primitives
    base = array(primitive.attributes.POSITION)
    targets = np.stack([array(t["POSITION"]) for t in primitive.targets])
    (sampler,) = read.animations[0].samplers
    weights = array(sampler.output).reshape(len(order.moving.time), -1)
    assert array(sampler.input)[:, 0] == pytest.approx(order.moving.time, abs=1e-6)
    places = base + np.einsum("ft,tnx->fnx", weights, targets)
    upright = np.stack([places[..., 0], -places[..., 2], places[..., 1]], -1)
    assert np.abs(upright - order.moving.places).max() < TENTH
    assert "24 to 37.5" in " ".join(read.asset.extras["cautions"])
    turned = array(primitive.attributes.NORMAL) + array(primitive.targets[-1]["NORMAL"])
    assert np.linalg.norm(turned, axis=1) == pytest.approx(1.0, abs=1e-5)
    accessor = read.accessors[primitive.attributes.POSITION]
    assert accessor.min == pytest.approx(base.min(0).tolist())


def test_trimesh_reads_the_first_frame_of_the_gltf(order):
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    scene = trimesh.load(io.BytesIO(files_of("gltf", order)[".glb"]), file_type="glb")
    (mesh,) = scene.geometry.values()
    first = order.moving.places[0]
    assert mesh.bounds[1] - mesh.bounds[0] == pytest.approx(np.ptp(first, axis=0)[[0, 2, 1]], abs=TENTH)
    assert mesh.area == pytest.approx(0.4 * 0.45, rel=0.02)


def test_a_glb_is_laid_out_as_khronos_says(order):
    """Header 12 bytes, chunks of whole words, JSON before the binary; the lengths add up."""
    raw = files_of("gltf", order)[".glb"]
    magic, version, length = struct.unpack_from("<III", raw)
    text_length, text_kind = struct.unpack_from("<II", raw, 12)
    assert (magic, version, length) == (0x46546C67, 2, len(raw))
    assert (text_kind, text_length % 4) == (0x4E4F534A, 0)
    document = json.loads(raw[20 : 20 + text_length])
    binary_length, kind = struct.unpack_from("<II", raw, 20 + text_length)
    assert (kind, binary_length) == (0x004E4942, document["buffers"][0]["byteLength"])
    assert 28 + text_length + binary_length == length


def pc2_of(raw):
    """Samples of a PC2 file, (samples, points, 3), by its published layout."""
    sign, version, points, start, step, samples = struct.unpack_from("<12siiffi", raw)
    assert (sign, version, start, step) == (b"POINTCACHE2\0", 1, 0.0, 1.0)
    return np.frombuffer(raw, "<f4", offset=32).reshape(samples, points, 3)


def test_a_pc2_reader_reads_the_same_motion(order, tmp_path):
    cache, mesh = export(order, "pc2", tmp_path / "swing.pc2")
    assert np.abs(pc2_of(cache.read_bytes()) - order.moving.places).max() < TENTH
    lines = mesh.read_text().splitlines()
    places = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
    assert np.abs(places - order.moving.places[0]).max() < TENTH
    assert sum(line.startswith("f ") for line in lines) == len(order.moving.triangles)
    assert any("24 to 37.5" in line for line in lines if line.startswith("#"))


def test_uneven_frames_are_brought_to_an_even_rate():
    """sin(2 pi t) at 30 Hz with frames up to 8 ms off: a cubic spline is right to (2 pi)^4 5 h^4 / 384, h = 50 ms."""
    time = np.arange(61) / 30 + np.where(np.arange(61) % 2, 0.008, 0.0)
    wave = np.sin(2 * np.pi * time)
    places = np.repeat(wave[:, None, None], 3, 2).astype(np.float32)
    still = np.zeros((1, 2))
    uneven = Moving("t", time, places, np.zeros((0, 3), int), still, places.astype(float), ("a",), places[:, [0, 0]])
    even = uneven.even()
    assert np.ptp(np.diff(even.time)) < 1e-9
    assert np.abs(even.places[:, 0, 0] - np.sin(2 * np.pi * even.time)).max() < 1.3e-4


def test_the_motion_as_csv(order, tmp_path):
    table, motion = export(order, "csv", tmp_path / "fabric.csv")
    assert motion.name == "fabric.motion.csv"
    rows = [line.split(",") for line in motion.read_text().splitlines()]
    assert rows[0] == ["time_s", "point", "x_m", "y_m", "z_m"]
    assert len(rows) == 1 + 36 * 7
    centre = np.array([row[2:] for row in rows if row[1] == "centre"], float)
    assert np.abs(centre - order.moving.points[:, 4]).max() < 1e-12
    assert "not identified" in table.read_text()


def test_a_kinect_skirt_moves_although_it_has_no_fabric(order):
    skirt = Order(result=a_fit("kinect-skirt"), take=order.take, spacing=0.15)
    mesh = files_of("pc2", skirt)[".obj"].decode()
    assert "# mass: 90 % interval 0.8 to 1.25 x weighed; the takes do not identify it" in mesh
    assert np.ptp(skirt.moving.places[..., 1]) > 0.1


def test_the_motion_is_that_of_the_reports_simulation(order):
    """Twice the bending and half the damping move the cloth elsewhere, by far more than a tenth of a millimetre."""
    other = moving_cloth(a_fit(values={"bending_stiffness": 1e-4, "velocity_damping": 3.0}), order.take, 0.15)
    assert np.abs(other.places - order.moving.places).max() > 5e-3


@pytest.mark.parametrize("kind", ["usd", "gltf", "pc2"])
def test_motion_needs_a_take(kind, tmp_path):
    with pytest.raises(FitError, match="a fit alone holds no motion; name a take"):
        export(Order(result=a_fit()), kind, tmp_path / f"x{EXPORT_KINDS[kind].suffix}")


def test_motion_of_blenders_cloth_is_refused(order):
    with pytest.raises(FitError, match="its cloth is blender's, which keeps no shapes"):
        moving_cloth(a_fit("kinect-skirt", engine="blender"), order.take)


def test_the_command_writes_the_motion_beside_the_fit(order, tmp_path):
    save_fit_result(tmp_path / "fit.json", a_fit())
    write_take(tmp_path / "swing.mcap", order.take)
    words = ("export", "fit.json", "--to", "pc2", "--take", "swing.mcap", "--spacing", "0.15")
    done = hangtime_here(*words, folder=tmp_path)
    assert done.stdout.split() == ["fit.pc2", "fit.obj"]
    again = hangtime_here(*words, folder=tmp_path)
    assert again.returncode == 2


def test_an_obj_beside_a_cache_has_the_cautions_of_the_fabric(order):
    text = EXPORT_KINDS["pc2"].make(order)[".obj"].decode()
    cautions = caution_lines(order.result, order.fabric_if_any)
    assert cautions != caution_lines(order.result, None)
    for line in cautions:
        assert line in text


def test_the_last_parameter_that_is_not_identified_is_named_too():
    last = a_fit().parameters[-1].name
    (line,) = caution_lines(a_fit(unknown=(last,)), None)
    assert line.startswith(f"{last}: ")


def test_usd_does_not_round_the_corners_of_a_mesh(order, tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom

    (path,) = export(order, "usd", tmp_path / "swing.usdc")
    stage = Usd.Stage.Open(str(path))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert {str(mesh.GetSubdivisionSchemeAttr().Get()) for mesh in meshes} == {"none"}


def test_the_help_text_says_where_an_export_goes(tmp_path):
    shown = " ".join(hangtime_here("export", "--help", folder=tmp_path).stdout.split())
    assert "[default: (beside FIT; table: the terminal)]" in shown


def test_alembic_without_blender_says_what_to_take_instead_before_it_simulates(order, monkeypatch, tmp_path):
    monkeypatch.setenv("HANGTIME_BLENDER_PYTHON", str(tmp_path / "no-python"))
    shown = []
    fresh = Order(result=order.result, take=order.take, show=lambda *told: shown.append(told))
    with pytest.raises(FitError, match=r"Alembic is written by Blender, .*; or take --to usd"):
        export(fresh, "abc", tmp_path / "swing.abc")
    assert list(tmp_path.iterdir()) == shown == []


@pytest.mark.parametrize(("kind", "library"), [("usd", "pxr"), ("parquet", "pyarrow"), ("usd-physics", "pxr")])
def test_a_library_that_is_missing_is_named_before_anything_is_simulated(order, monkeypatch, tmp_path, kind, library):
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.setattr(kinds, "find_spec", lambda name: None if name == library else find_spec(name))
    shown = []
    fresh = Order(result=order.result, take=order.take, show=lambda *told: shown.append(told))
    with pytest.raises(ModuleNotFoundError, match=library):
        export(fresh, kind, tmp_path / f"swing{EXPORT_KINDS[kind].suffix}")
    assert list(tmp_path.iterdir()) == shown == []
