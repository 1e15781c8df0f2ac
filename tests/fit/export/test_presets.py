"""Presets of Newton and MuJoCo: values by hand, and the bending of a mesh with them."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from fit.errors import FitError
from fit.export.sheet import strip
from tests.fit.export.exported import a_fit, text_of


def test_newtons_numbers_by_hand():
    """Style3D: warp, weft and shear as they are, 4/9 and 5/24 of B; VBD: half of the stretch, 4 B / (3 L), h = 2 cm.

    One number for all edges is 2 / (3 - 1.41421) = 1.26120 of B.
    """
    record = json.loads(text_of("newton", a_fit(effects={"air_drag": 1.2})))
    style = record["SolverStyle3D"]
    assert style["tri_aniso_ke"] == pytest.approx([100.0, 100.0, 30.0])
    assert style["edge_aniso_ke"] == pytest.approx([1.4e-5 * 4 / 9, 1.4e-5 * 4 / 9, 1.4e-5 * 5 / 24])
    assert record["SolverVBD"]["tri_ke"] == pytest.approx(50.0)
    assert record["SolverVBD"]["edge_ke"] == pytest.approx(1.2612 * 1.4e-5 / 0.02, rel=1e-4)
    by_edge = record["SolverVBD"]["edge_ke_by_edge"]
    assert by_edge["straight"] == pytest.approx(4 * 1.4e-5 / (3 * 0.02))
    assert by_edge["diagonal"] == pytest.approx(4 * 1.4e-5 / (3 * 0.0282843), rel=1e-5)
    assert record["SolverSemiImplicit"]["tri_drag"] == pytest.approx(1.204 * 1.2 / 6)
    assert record["SolverSemiImplicit"]["edge_ke"] == pytest.approx(1.2612 * 1.75, rel=1e-4)
    by_edge = record["SolverSemiImplicit"]["edge_ke_by_edge"]  # 4 B / (3 L^2 a), a = h and h / sqrt 2
    assert by_edge["straight"] == pytest.approx(4 / 3 * 1.75)
    assert by_edge["diagonal"] == pytest.approx(4 / 3 * 1.75 / 1.414214, rel=1e-5)


def cylinders(stiffness):
    """Bending stiffness of the exported grid [N m] to cylinders along the grid and along its diagonals.

    stiffness: K of an edge of a length, whose energy is K theta^2 / 2. Nodes move to either side in turns until the
    energy of a period, two cells by two, is least.
    """
    spacing = 0.02
    cloth = strip(10 * spacing, 10 * spacing, spacing)
    opposite = {}
    for corners in cloth.triangles.tolist():
        for k in range(3):
            a, b, c = (*corners, *corners)[k : k + 3]
            opposite.setdefault((min(a, b), max(a, b)), []).append(c)
    x, y = (cloth.rest / spacing).T
    x, y = x - np.round(x.mean()), y - np.round(y.mean())
    # heights of the nodes by curvature along x, along y and between, and by the movement to either side
    shapes = spacing**2 * np.stack([x * x / 2, y * y / 2, x * y / 2, (-1.0) ** np.round(x + y)])
    energy = np.zeros((4, 4))
    for (a, b), ends in opposite.items():
        middle = np.array([x[a] + x[b], y[a] + y[b]]) / 2
        if len(ends) < 2 or not (np.all(middle > -1.01) and np.all(middle < 0.99)):
            continue
        along = cloth.rest[b] - cloth.rest[a]
        length = np.linalg.norm(along)
        angle = np.zeros(4)
        for c in ends:
            from_a = cloth.rest[c] - cloth.rest[a]
            share, height = from_a @ along / length**2, abs(along[0] * from_a[1] - along[1] * from_a[0]) / length
            angle += (shapes[:, c] - (1 - share) * shapes[:, a] - share * shapes[:, b]) / height
        energy += stiffness(length / spacing) * np.outer(angle, angle) / (2 * spacing) ** 2
    least = energy[:3, :3] - np.outer(energy[:3, 3], energy[3, :3]) / energy[3, 3]
    diagonal = np.array([0.5, 0.5, 1.0])
    return least[0, 0], diagonal @ least @ diagonal


def test_newtons_and_mujocos_meshes_bend_as_the_fabric():
    """Cylinders of the whole mesh, nodes free to leave them: B along the grid, and B along its diagonals by edge."""
    record, h, bending = json.loads(text_of("newton", a_fit())), 0.02, 1.4e-5
    vbd, explicit, style = (record[f"Solver{name}"] for name in ("VBD", "SemiImplicit", "Style3D"))

    def name(length):
        return "diagonal" if length > 1.2 else "straight"

    by_edge = vbd["edge_ke_by_edge"], explicit["edge_ke_by_edge"]
    # energies of `fit.export.presets`: k L, k L^2 a with a = h or h / sqrt 2, and 3 k L^2 / (A0 + A1)
    assert cylinders(lambda n: by_edge[0][name(n)] * n * h) == pytest.approx((bending, bending))
    assert cylinders(lambda n: by_edge[1][name(n)] * n * n * h**3 / n) == pytest.approx((bending, bending))
    assert cylinders(lambda n: vbd["edge_ke"] * n * h) == pytest.approx((bending, 1.2612 * bending), rel=1e-4)
    assert cylinders(lambda n: explicit["edge_ke"] * n * h**3)[0] == pytest.approx(bending)
    along, _, across = style["edge_aniso_ke"]
    diagonal = across + 2 * along / 64  # cos^12 and sin^12 of 45 degrees
    assert cylinders(lambda n: 3 * (diagonal * 2 if n > 1.2 else along)) == pytest.approx((bending, bending))
    flex = ElementTree.fromstring(text_of("mujoco", a_fit())).find("deformable/flex/elasticity").attrib
    young, thick = float(flex["young"]), float(flex["thickness"])
    assert cylinders(lambda n: young * thick**3 / 12 * n * n)[0] == pytest.approx(bending, rel=1e-6)


def test_mujocos_sheet_by_hand():
    """t = sqrt(12 x 1.68e-5 / 100) = 1.420 mm, E = 100 / t = 70.43 kPa: E t = 100 N/m, E t^3 / 12 = 1.68e-5 N m."""
    root = ElementTree.fromstring(text_of("mujoco", a_fit(), spacing=0.05))
    elastic = root.find("deformable/flex/elasticity").attrib
    young, thick = float(elastic["young"]), float(elastic["thickness"])
    assert young * thick == pytest.approx(100.0, rel=1e-6)
    assert young * thick**3 / 12 == pytest.approx(1.2 * 1.4e-5, rel=1e-6)
    bodies = root.findall("worldbody/body")
    assert len(bodies) == 49
    assert sum(float(b.find("inertial").get("mass")) for b in bodies) == pytest.approx(0.2 * 0.09, rel=1e-6)
    assert sum(b.find("joint") is None for b in bodies) == 7
    numbers = {n.get("name"): n.get("data").split() for n in root.findall("custom/numeric")}
    assert [float(v) for v in numbers["hangtime_velocity_damping"]] == pytest.approx([0.5, 0.4, 0.625])


def test_mujocos_step_follows_the_fastest_wave_across_the_finest_side_and_is_two_milliseconds_at_most():
    """sqrt(4 x 100 / 0.2) / 0.05 and sqrt(16 x 1.4e-5 / 0.2) / 0.05^2 per second, four steps a period: 0.559 ms."""
    root = ElementTree.fromstring(text_of("mujoco", a_fit(), spacing=0.05))
    fastest = np.hypot(np.sqrt(4 * 100 / 0.2) / 0.05, np.sqrt(16 * 1.4e-5 / 0.2) / 0.05**2)
    assert float(root.find("option").get("timestep")) == pytest.approx(1 / (2 * fastest), rel=5e-3)
    stiff = a_fit(values={"bending_stiffness": 1e-2})
    root = ElementTree.fromstring(text_of("mujoco", stiff, spacing=0.05))
    fastest = np.hypot(np.sqrt(4 * 100 / 0.2) / 0.05, np.sqrt(16 * 1e-2 / 0.2) / 0.05**2)
    assert float(root.find("option").get("timestep")) == pytest.approx(1 / (2 * fastest), rel=5e-3)
    soft = a_fit(values={"stretch_stiffness": 1.0})
    root = ElementTree.fromstring(text_of("mujoco", soft, spacing=0.05))
    assert float(root.find("option").get("timestep")) == 2e-3


def test_mujocos_flex_joins_the_bodies_of_its_nodes_and_knows_its_damping_and_what_is_unknown():
    fit = a_fit(unknown=("shear_stiffness",))
    root = ElementTree.fromstring(text_of("mujoco", fit, spacing=0.05))
    sheet = strip(0.3, 0.3, 0.05)
    bodies = {body.get("name"): body for body in root.findall("worldbody/body")}
    places = np.array([bodies[f"n{k}"].get("pos").split() for k in range(len(sheet.rest))], float)
    assert places == pytest.approx(sheet.start, abs=1e-6)
    free = [k for k in range(len(sheet.rest)) if bodies[f"n{k}"].find("joint") is not None]
    assert sorted({*range(len(sheet.rest))} - {*free}) == sorted(sheet.held.tolist())
    assert {joint.get("axis") for joint in bodies[f"n{free[0]}"].findall("joint")} == {"1 0 0", "0 1 0", "0 0 1"}
    flex = root.find("deformable/flex")
    assert flex.get("body").split() == [f"n{k}" for k in range(len(sheet.rest))]
    assert [int(k) for k in flex.get("element").split()] == sheet.triangles.ravel().tolist()
    elastic = flex.find("elasticity").attrib
    assert float(flex.get("radius")) == pytest.approx(float(elastic["thickness"]) / 2, rel=1e-5)
    assert (elastic["poisson"], elastic["elastic2d"]) == ("0", "both")
    damping = {n.get("name"): n.get("data").split() for n in root.findall("custom/numeric")}
    assert float(elastic["damping"]) == pytest.approx(float(damping["hangtime_stretch_damping_time"][0]), rel=1e-5)
    assert root.find("option").get("gravity") == "0 0 -9.80665"
    texts = {one.get("name"): one.get("data") for one in root.findall("custom/text")}
    assert texts["hangtime_not_identified"] == "shear"
    assert json.loads(texts["hangtime_provenance"])["takes"] == ["swing-01"]
    whole = ElementTree.fromstring(text_of("mujoco", a_fit(), spacing=0.05))
    assert {o.get("name"): o.get("data") for o in whole.findall("custom/text")}["hangtime_not_identified"] == "none"


def test_newtons_preset_says_for_each_solver_how_it_is_called_and_what_it_lacks():
    record = json.loads(text_of("newton", a_fit()))
    calls = {name: part["call"] for name, part in record.items() if isinstance(part, dict) and "call" in part}
    assert calls == {
        "SolverStyle3D": "newton.solvers.style3d.add_cloth_mesh", "SolverVBD": "ModelBuilder.add_cloth_mesh",
        "SolverSemiImplicit": "ModelBuilder.add_cloth_mesh",
    }  # fmt: skip
    for name in (*calls, "ModelBuilder.add_usd", "velocity_damping"):
        assert record[name]["note"].endswith(".")
    assert record["grid_spacing_m"] == 0.02
    assert record["provenance"]["takes"] == ["swing-01"]
    assert record["fabric"]["shear"]["value"] == 30.0


def test_diagonals_of_a_strip_alternate_and_its_grid_fits_the_rectangle():
    flat = strip(0.2, 0.1, 0.05)
    assert len(flat.rest) == 5 * 3
    assert flat.held.tolist() == [0, 1, 2, 3, 4]
    sides = np.sort(np.concatenate([flat.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), 1)
    ways = flat.rest[sides[:, 1]] - flat.rest[sides[:, 0]]
    is_slanted = (np.abs(ways) > 1e-9).all(1)
    found = {tuple(side): way[0] > 0 for side, way in zip(sides[is_slanted], ways[is_slanted], strict=True)}
    expected = {}
    for row in range(2):
        for column in range(4):
            a = 5 * row + column
            falls = (row + column) % 2 == 0  # from the left above to the right below
            expected[(a, a + 6) if falls else (a + 1, a + 5)] = falls
    assert found == expected
    assert flat.rest.min(0) == pytest.approx([-0.1, -0.1])
    assert flat.rest.max(0) == pytest.approx([0.1, 0.0])


@pytest.mark.parametrize(("spacing", "is_refused"), [(0.1, False), (0.101, True), (0.0001, True)])
def test_a_strip_has_one_cell_across_at_least(spacing, is_refused):
    if is_refused:
        with pytest.raises(FitError, match="does not fit a swatch of"):
            strip(0.2, 0.1, spacing)
    else:
        assert len(strip(0.2, 0.1, spacing).rest) == 6


def test_a_spacing_in_another_unit_is_asked_for():
    with pytest.raises(FitError, match=r"were millimetres meant\? Give 0.0006 to 0.3 m"):
        strip(0.3, 0.3, 50.0)
