"""Exported files of a fit: their content, and refused requests."""

from __future__ import annotations

import ast
import json
import re
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from datetime import datetime

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.export.cli import ExportKind
from fit.export.fabric import fabric_of
from fit.export.kinds import EXPORT_KINDS, Order, export
from fit.export.sheet import garment_sheet, strip
from fit.export.usd_stage import new_stage, usd_bytes
from fit.identification.read_again import read_fit
from formats import command
from formats.errors import HangtimeError, OutputError
from formats.results import fit_result_from, save_diagnosis, save_fit_result
from tests.fit.export.exported import a_fit, text_of
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis
from tests.fit.scenes import hung, sheet, take_of
from tests.formats.full_disk import no_file_beyond

OF_FABRIC = ("table", "usd-physics", "newton", "mujoco", "u3m")


def test_a_strip_has_its_area_and_faces_the_front():
    """0.3 m x 0.2 m at 0.05 m: 7 x 5 nodes, 48 triangles; the front looks towards -y, so x cross z turns to -y."""
    flat = strip(0.3, 0.2, 0.05)
    assert len(flat.rest) == 35
    assert len(flat.triangles) == 48
    assert flat.node_areas.sum() == pytest.approx(0.06)
    assert np.diff(np.unique(flat.rest[:, 0])) == pytest.approx(0.05)
    a, b, c = (flat.start[flat.triangles[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 1].max() < 0
    assert flat.start[flat.held, 2] == pytest.approx(0.0)


def test_a_garments_sheet_faces_the_front_too():
    made = garment_sheet(sheet(), 0.1)
    a, b, c = (made.start[made.triangles[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 1].max() < 0
    assert made.node_areas.sum() == pytest.approx(0.4 * 0.45)


def test_usd_holds_the_proposals_quantities_one_to_one():
    pxr = pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom, UsdShade

    assert pxr
    made = EXPORT_KINDS["usd-physics"].make(Order(result=a_fit(unknown=("shear_stiffness",)), thickness=5e-4))
    stage = Usd.Stage.CreateInMemory(".usda")
    stage.GetRootLayer().ImportFromString(made[".physics.usda"].decode())
    cloth = stage.GetPrimAtPath("/Garment/cloth")
    bound = UsdShade.MaterialBindingAPI(cloth).ComputeBoundMaterial("physics")[0].GetPrim()
    read = {a.GetName(): a.Get() for a in bound.GetAttributes()}
    assert read["physics:surfaceStretchStiffness"] == pytest.approx(100.0)
    assert read["physics:surfaceShearStiffness"] == pytest.approx(30.0)
    assert read["physics:surfaceBendStiffness"] == pytest.approx(1.4e-5)
    assert read["physics:density"] * 5e-4 == pytest.approx(0.2)
    assert read["hangtime:velocity_damping"] == pytest.approx(0.5)
    assert tuple(read["hangtime:stretch_warp:interval90"]) == pytest.approx((80.0, 125.0))
    assert read["hangtime:shear:isIdentified"] is False
    assert "do not identify it" in stage.GetRootLayer().documentation
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert "PhysicsSurfaceDeformableSimAPI" in cloth.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert stage.GetDefaultPrim().GetCustomDataByKey("hangtime:takes") == "swing-01"


def test_the_command_offers_every_kind_that_there_is():
    assert [kind.value for kind in ExportKind] == list(EXPORT_KINDS)


@pytest.mark.parametrize("kind", ["csv", "blender", *OF_FABRIC])
def test_every_file_says_which_number_is_not_identified(kind):
    text = text_of(kind, a_fit(unknown=("stretch_stiffness",)))
    assert "not identif" in text.lower()
    assert "80" in text
    assert "125" in text


def test_a_take_brings_its_garment_with_all_its_layers():
    """The sheet of a garment of two layers weighs and pulls as both do."""
    garment = sheet()
    time = np.arange(0, 1, 1 / 30)
    take = take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time))
    root = ElementTree.fromstring(text_of("mujoco", a_fit(layers=2), take=take, spacing=0.1))
    masses = [float(b.find("inertial").get("mass")) for b in root.findall("worldbody/body")]
    assert sum(masses) == pytest.approx(0.2 * garment.area_m2, rel=1e-6)


@pytest.mark.parametrize("kind", OF_FABRIC)
def test_a_kinect_skirt_has_no_file_of_a_fabric(kind, tmp_path):
    with pytest.raises(FitError, match="none of its numbers has an SI value"):
        export(Order(result=a_fit("kinect-skirt")), kind, tmp_path / f"x{EXPORT_KINDS[kind].suffix}")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_stays_unless_it_is_to_be_overwritten(tmp_path):
    path = tmp_path / "fabric.csv"
    path.write_text("mine")
    with pytest.raises(OutputError):
        export(Order(result=a_fit()), "csv", path)
    assert path.read_text() == "mine"
    assert export(Order(result=a_fit()), "csv", path, overwrite=True) == [path]
    assert path.read_text().startswith("kind,name,value")


def test_thickness_in_millimetres_is_refused(tmp_path):
    with pytest.raises(FitError, match="no fabric is 500 mm thick"):
        export(Order(result=a_fit(), thickness=0.5), "usd-physics", tmp_path / "x.usda")


def test_a_folder_is_as_good_as_its_fit_and_a_diagnosis_is_none(tmp_path):
    save_fit_result(tmp_path / "fit.json", a_fit())
    assert read_fit(tmp_path) == (a_fit(), tmp_path / "fit.json")
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis())
    with pytest.raises(FitError, match=r"is a diagnosis, which has no fabric; give the fit\.json"):
        read_fit(tmp_path / "diagnosis.json")
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(HangtimeError, match="is not a fit result"):
        read_fit(tmp_path / "other.json")


def test_the_command_writes_beside_the_fit_and_prints_the_table(tmp_path):
    save_fit_result(tmp_path / "fit.json", a_fit())
    done = hangtime_here("export", tmp_path / "fit.json", "--to", "newton", folder=tmp_path)
    assert done.stdout.strip() == str(tmp_path / "fit.newton.json")
    assert json.loads((tmp_path / "fit.newton.json").read_text())["format"] == "hangtime-newton/1"
    assert "Stretch warp" in hangtime_here("export", tmp_path, "--to", "table", folder=tmp_path).stdout
    again = hangtime_here("export", tmp_path, "--to", "newton", folder=tmp_path)
    assert again.returncode == 2
    assert "--overwrite" in again.stderr


# What U3M 1.1 requires of a file of physics alone, in the words of its published schema.
KEYS_OF_U3M = {"schema", "material", "custom"}
KEYS_OF_MATERIAL = {
    "name", "id", "created", "modified", "front", "back", "side", "physics", "metadata", "description",
}  # fmt: skip
KEYS_OF_PHYSICS = {"thickness", "weight", "composition", "devices", "material_type", "construction"}
UUID4 = re.compile(r"[0-9a-f]{8}-[0-9a-f]{4}-4[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}")


def test_u3m_has_just_the_keys_of_its_schema_the_weight_in_grams_and_the_rest_under_custom():
    record = json.loads(text_of("u3m", a_fit()))
    material = record["material"]
    assert record.keys() == KEYS_OF_U3M
    assert material.keys() == KEYS_OF_MATERIAL
    assert material["physics"].keys() == KEYS_OF_PHYSICS
    assert material["physics"]["weight"] == pytest.approx(200.0)
    assert material["physics"]["devices"] == {"fab": "null"}
    assert material["physics"]["thickness"] is None
    assert record["schema"] == "1.1"
    assert UUID4.fullmatch(material["id"])
    assert datetime.fromisoformat(material["created"]).tzinfo is not None
    shear = record["custom"]["hangtime"]["fabric"]["shear"]
    assert (shear["value"], shear["interval_90"]) == (30.0, pytest.approx([24.0, 37.5]))
    assert material["id"] == json.loads(text_of("u3m", a_fit()))["material"]["id"]
    assert material["id"] != json.loads(text_of("u3m", a_fit(density=0.3)))["material"]["id"]


def settings_of(text):
    """The settings of a Blender script, without running it."""
    tree = ast.parse(text)
    found = next(n for n in tree.body if isinstance(n, ast.Assign) and n.targets[0].id == "SETTINGS")
    return ast.literal_eval(found.value)


def test_blenders_script_holds_the_fits_own_settings_or_those_that_come_near():
    """Kinect-skirt at Mass 1, Air 4 and Velocity 1: as they are. SI: 100 N/m is Struct 10, 1.4e-5 N m Bend 14."""
    own = {"mass": 1.0, "struct": 30.0, "bend": 20.0, "spring": 3.0, "air": 4.0, "velocity": 1.0}
    found = settings_of(text_of("blender", a_fit("kinect-skirt", values=own)))
    assert found["tension_stiffness"] == pytest.approx(30.0)
    assert found["bending_stiffness"] == pytest.approx(20.0)
    assert found["air_damping"] == pytest.approx(4.0)
    near = settings_of(text_of("blender", a_fit(values={"velocity_damping": 0.05})))
    assert near["tension_stiffness"] == pytest.approx(10.0)
    assert near["bending_stiffness"] == pytest.approx(14.0)
    assert near["tension_damping"] == pytest.approx(5.0)
    assert near["air_damping"] == pytest.approx(5.0)
    assert "APPROXIMATE" in text_of("blender", a_fit())


def test_a_mocap_swatch_that_fitted_the_weight_makes_no_script():
    with pytest.raises(FitError, match="fit with si, or with kinect-skirt"):
        text_of("blender", a_fit("mocap-swatch"))


def test_a_library_that_is_missing_is_named_with_the_extra_that_brings_it(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pxr", None)
    monkeypatch.setattr(command, "requires", lambda name: ["usd-core>=25.11 ; extra == 'export'"])
    save_fit_result(tmp_path / "fit.json", a_fit())
    done = hangtime_here("export", "fit.json", "--to", "usd-physics", folder=tmp_path)
    assert done.returncode == 2
    assert "pxr is not installed; in Hangtime's checkout: pip install -e '.[export]'" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["fit.json"]


def test_words_of_a_fit_run_no_line_in_blender_and_end_no_comment():
    evil = msgspec.structs.replace(a_fit(), created="x\nimport os\n\x1b[31m", take_ids=["a--->", "b----c"])
    script = ast.parse(text_of("blender", evil))
    assert [name.name for node in script.body if isinstance(node, ast.Import) for name in node.names] == ["bpy"]
    assert "\x1b" not in text_of("table", evil)
    text = text_of("mujoco", evil)
    ElementTree.fromstring(text)
    assert "--" not in text.split("<!--")[1].split("-->")[0]


def test_blenders_script_names_a_garment_beyond_the_first_plane_of_unicode():
    text = text_of("blender", a_fit(), take=garments_take("dress \N{DRESS}"), spacing=0.1)
    assert ast.literal_eval(re.search("NAME = (.*)", text)[1]) == "dress \N{DRESS}"


def garments_take(name):
    garment = msgspec.structs.replace(sheet(), name=name)
    time = np.arange(0, 1, 1 / 30)
    return take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time))


@pytest.mark.parametrize("spacing", [0.0, -0.02, float("nan"), float("inf"), 1e-6, 1.0])
def test_a_grid_that_no_swatch_has_is_refused(spacing, tmp_path):
    with pytest.raises(FitError, match="spacing"):
        export(Order(result=a_fit(), spacing=spacing), "newton", tmp_path / "x.json")


def test_a_point_cache_is_not_lost_under_its_obj(tmp_path):
    with pytest.raises(FitError, match=r"\.obj is the end of the file beside it; give a name that ends in \.pc2"):
        export(Order(result=a_fit(), take=garments_take("sheet")), "pc2", tmp_path / "x.obj")


@pytest.mark.parametrize(
    ("kind", "name", "end"),
    [
        ("usd-physics", "x.usdc", "usda"),
        ("usd", "x.usda", "usdc"),
        ("gltf", "x.gltf", "glb"),
        ("csv", "x.usd", "csv"),
        ("gltf", "x.csv", "glb"),
    ],
)
def test_an_end_by_which_programs_take_the_file_for_another_kind_is_refused(kind, name, end, tmp_path):
    with pytest.raises(FitError, match=rf"--to {kind} writes no \.\w+, .*; give a name that ends in \.{end}"):
        export(Order(result=a_fit(), take=garments_take("sheet")), kind, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_a_usd_file_that_the_system_cuts_is_refused_with_the_systems_cause(suffix):
    """usd-core says it in thousands of letters about its own source files."""
    pytest.importorskip("pxr", reason="usd-core is not installed")
    stage = new_stage(a_fit())
    whole = usd_bytes(stage, suffix)
    with no_file_beyond(len(whole) // 2), pytest.raises(OutputError) as told:
        usd_bytes(stage, suffix)
    assert str(told.value) == (
        f"{tempfile.gettempdir()}: the file that is made there first cannot be written (File too large); raise the "
        "limit on the size of files (`ulimit -f`), or choose another disk (TMPDIR names the folder)"
    )


@pytest.mark.parametrize("kind", ["usd-physics", "usd"])
def test_a_usd_file_of_either_kind_may_end_in_usd(kind, tmp_path):
    from pxr import Usd

    export(Order(result=a_fit(), take=garments_take("sheet")), kind, tmp_path / "x.usd")
    stage = Usd.Stage.Open(str(tmp_path / "x.usd"))
    assert stage.GetDefaultPrim().IsValid()


def test_a_file_beside_is_refused_before_the_work_and_only_where_it_is_written(tmp_path):
    (tmp_path / "x.motion.csv").write_text("mine")
    with pytest.raises(OutputError, match="already there"):
        export(Order(result=a_fit(), take=garments_take("sheet")), "csv", tmp_path / "x.csv")
    assert export(Order(result=a_fit()), "csv", tmp_path / "x.csv") == [tmp_path / "x.csv"]


def test_an_export_does_not_replace_the_fit_it_reads(tmp_path):
    save_fit_result(tmp_path / "fit.json", a_fit())
    done = hangtime_here(
        "export", tmp_path, "--to", "csv", "--out", tmp_path / "fit.json", "--overwrite", folder=tmp_path
    )
    assert "is what FIT reads" in done.stderr
    assert read_fit(tmp_path)[0] == a_fit()


def test_parameters_in_another_order_give_the_same_fabric():
    turned = msgspec.structs.replace(a_fit(), parameters=a_fit().parameters[::-1])
    assert fabric_of(turned) == fabric_of(a_fit())
    with pytest.raises(FitError, match="lacks stretch_stiffness"):
        fabric_of(msgspec.structs.replace(a_fit(), parameters=a_fit().parameters[1:]))
    with pytest.raises(FitError, match="lacks air_drag"):
        fabric_of(msgspec.structs.replace(a_fit(), effects={"air_drag": 1.0}))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "hangtime-fit/2"}, "this version of Hangtime reads hangtime-fit/1"),
        ({"layers": 0}, "layers is 0"),
        ({"material": {"bending_stiffness": 0.0}}, "no cloth has bending_stiffness = 0"),
    ],
)
def test_a_fit_that_does_not_belong_together_is_refused_where_it_is_read(change, words):
    raw = msgspec.json.encode(msgspec.to_builtins(a_fit()) | change)
    with pytest.raises(HangtimeError, match=words):
        fit_result_from(raw, "fit.json")


def test_an_interval_without_two_ends_is_refused():
    fit = msgspec.to_builtins(a_fit())
    fit["parameters"][0]["interval_low"] = None
    with pytest.raises(HangtimeError, match="the interval of stretch_stiffness"):
        fit_result_from(msgspec.json.encode(fit), "fit.json")


def test_a_fit_of_another_engine_is_offered_what_it_can_be_exported_as():
    with pytest.raises(FitError, match=r"exported as csv, parquet$"):
        fabric_of(a_fit(engine="blender"))


def test_parquet_holds_what_csv_does_with_numbers_as_numbers(tmp_path):
    pq = pytest.importorskip("pyarrow.parquet", reason="PyArrow is not installed")
    order = Order(result=a_fit(unknown=("shear_stiffness",)), take=garments_take("sheet"), spacing=0.15)
    numbers, motion = export(order, "parquet", tmp_path / "fit.parquet")
    table = pq.read_table(numbers)
    rows = {row["name"]: row for row in table.to_pylist() if row["kind"] == "parameter"}
    assert rows["stretch_stiffness"]["value"] == pytest.approx(100.0)
    assert (rows["shear_stiffness"]["value"], rows["shear_stiffness"]["one_of_many"]) == (None, 30.0)
    assert json.loads(table.schema.metadata[b"hangtime"])["takes"] == ["swing-01"]
    moved = pq.read_table(motion).to_pylist()
    assert motion.name == "fit.motion.parquet"
    assert {row["point"] for row in moved} >= {"held_left", "centre"}
    assert isinstance(moved[0]["x_m"], float)


def test_usd_holds_the_sheet_hung_and_flat_with_its_held_nodes_and_two_sides():
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from pxr import Usd, UsdGeom

    order = Order(result=a_fit(), take=garments_take("sheet"), spacing=0.15, thickness=5e-4)
    stage = Usd.Stage.CreateInMemory(".usda")
    stage.GetRootLayer().ImportFromString(EXPORT_KINDS["usd-physics"].make(order)[".physics.usda"].decode())
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Garment/cloth"))
    hung_at = np.array(mesh.GetPointsAttr().Get())
    assert hung_at == pytest.approx(order.sheet.start, abs=1e-6)
    assert np.array(mesh.GetExtentAttr().Get()) == pytest.approx(np.stack([hung_at.min(0), hung_at.max(0)]))
    assert np.array(mesh.GetFaceVertexIndicesAttr().Get()).tolist() == order.sheet.triangles.ravel().tolist()
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {3}
    assert mesh.GetDoubleSidedAttr().Get() is True
    read = {a.GetName(): a.Get() for a in mesh.GetPrim().GetAttributes()}
    flat = np.array(read["physics:restShapePoints"])
    assert flat[:, [0, 2]] == pytest.approx(order.sheet.rest, abs=1e-6)
    assert np.array(read["physics:restTriVertexIndices"]).tolist() == order.sheet.triangles.tolist()
    assert list(read["physics:thicknesses"]) == pytest.approx([5e-4])
    assert read["physics:thicknesses:elementType"] == "constant"
    assert list(read["hangtime:heldPoints"]) == order.sheet.held.tolist()
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    material = stage.GetPrimAtPath("/Garment/cloth").GetRelationship("material:binding:physics").GetTargets()[0]
    shown = {a.GetName(): a for a in stage.GetPrimAtPath(material).GetAttributes()}
    assert shown["physics:poissonsRatio"].Get() == 0.0
    assert shown["hangtime:shear"].GetDocumentation() == "shear force per width and radian [N/m]"
    assert (shown["hangtime:shear:unit"].Get(), shown["hangtime:shear:status"].Get()) == ("N/m", "measured")
    assert shown["hangtime:shear:isIdentified"].Get() is True
    assert "The thickness, 0.5 mm, is assumed" in stage.GetRootLayer().documentation
