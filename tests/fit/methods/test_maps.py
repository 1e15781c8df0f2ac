"""The maps from a method's parameters to the solver's material, each term by hand."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from fit.cloth import material as mat
from fit.effects import LIBRARY
from fit.errors import FitError
from fit.methods import (
    KINECT_SKIRT,
    KINECT_SKIRT_WEIGHED,
    LEAN,
    METHODS,
    MOCAP_SWATCH,
    MOCAP_SWATCH_WEIGHED,
    SI,
    SI_SEWN,
    base_model_of,
    find_method,
)
from fit.methods.fabrics import FABRICS, find_fabric
from formats.fit_records import FitParameter
from formats.result_checks import check_result
from tests.fit.report.report_scene import fit_result
from tests.fit.scenes import sheet


def row(method, vector, density=0.2):
    return dict(zip(mat.MATERIAL_NAMES, method.to_materials(np.array([vector]), density)[0], strict=True))


def columns(found, *names):
    return [found[mat.MATERIAL_NAMES[name]] for name in names]


def test_every_number_of_blenders_cloth_goes_to_its_own_term():
    """Mass 2, Struct 40, Bend 30, Spring 5, Air 4, Velocity 0.92 at 0.2 kg/m^2."""
    found = row(KINECT_SKIRT, [2.0, 40.0, 30.0, 5.0, 4.0, 0.92])
    assert columns(found, mat.DENSITY, mat.STRETCH, mat.SHEAR, mat.BENDING) == pytest.approx([0.4, 400.0, 40.0, 3e-5])
    assert columns(found, mat.MEMBRANE_TIME, mat.BENDING_TIME) == pytest.approx([5e-6, 2e-3])
    assert columns(found, mat.VELOCITY) == pytest.approx([0.02 * 4 / 0.4 - 25 * np.log(0.92)])
    assert sum(value != 0 for value in found.values()) == 7


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_fit_may_end_at_any_value_of_its_method(method):
    """The check of a result compares the material with a parameter of the same name."""
    share = np.linspace(0.3, 0.8, len(method.parameters))
    parameters = [
        FitParameter(name=p.name, unit=p.unit, initial=p.initial, minimum=p.minimum, maximum=p.maximum,
                     fitted=p.minimum + one * (p.maximum - p.minimum))
        for p, one in zip(method.parameters, share, strict=True)
    ]  # fmt: skip
    material = row(method, [p.fitted for p in parameters])
    found = msgspec.structs.replace(fit_result(), method=method.name, parameters=parameters, effects={})
    check_result(msgspec.structs.replace(found, material=material), "fit.json")


def test_a_weighed_garment_has_mass_1():
    assert row(KINECT_SKIRT_WEIGHED, [40.0, 30.0, 5.0, 4.0, 0.92]) == row(KINECT_SKIRT, [1, 40.0, 30.0, 5.0, 4.0, 0.92])
    two = np.array([[40.0, 30.0, 5.0, 4.0, 0.92], [20.0, 10.0, 2.0, 1.0, 0.99]])
    whole = KINECT_SKIRT.to_materials(np.concatenate([np.ones((2, 1)), two], axis=1), 0.2)
    assert KINECT_SKIRT_WEIGHED.to_materials(two, 0.2) == pytest.approx(whole)
    assert [p.name for p in KINECT_SKIRT_WEIGHED.parameters] == ["struct", "bend", "spring", "air", "velocity"]


def test_a_swatch_twice_as_thick_weighs_and_pulls_twice_and_bends_eight_times_as_hard():
    """Whatever it weighs on the scales; membrane and bending damping times are fixed."""
    found = row(MOCAP_SWATCH, [300.0, 1e-5, 1.5, 0.2, 2.0], 99.0)
    terms = (mat.DENSITY, mat.STRETCH, mat.SHEAR, mat.BENDING, mat.MEMBRANE_TIME, mat.BENDING_TIME, mat.VELOCITY)
    assert columns(found, *terms) == pytest.approx([0.4, 600.0, 60.0, 8e-5, 2e-5, 1e-4, 1.5])
    assert sum(value != 0 for value in found.values()) == 7


def test_a_weighed_swatch_has_the_density_of_the_scales_and_the_nominal_thickness():
    vectors = np.array([[300.0, 1e-5, 1.5], [200.0, 2e-5, 2.5]])
    whole = np.concatenate([vectors, [[0.25, 1.0], [0.25, 1.0]]], axis=1)
    assert MOCAP_SWATCH_WEIGHED.to_materials(vectors, 0.25) == pytest.approx(MOCAP_SWATCH.to_materials(whole, 99.0))


def test_physical_units_are_what_they_say():
    found = row(SI, [300.0, 40.0, 2e-5, 3e-3, 1.5], 0.25)
    expected = [0.25, 300.0, 40.0, 2e-5, 2e-5, 3e-3, 1.5]
    terms = (mat.DENSITY, mat.STRETCH, mat.SHEAR, mat.BENDING, mat.MEMBRANE_TIME, mat.BENDING_TIME, mat.VELOCITY)
    assert columns(found, *terms) == pytest.approx(expected)
    assert sum(value != 0 for value in found.values()) == 7
    assert SI_SEWN.to_materials is SI.to_materials


def test_lean_has_a_thousandth_of_the_stretch_stiffness_as_shear_and_a_fixed_bending_time():
    found = row(LEAN, [300.0, 2e-5, 1.5], 0.25)
    terms = (mat.DENSITY, mat.STRETCH, mat.SHEAR, mat.BENDING, mat.MEMBRANE_TIME, mat.BENDING_TIME, mat.VELOCITY)
    assert columns(found, *terms) == pytest.approx([0.25, 300.0, 0.3, 2e-5, 2e-5, 1e-4, 1.5])
    assert sum(value != 0 for value in found.values()) == 7


def test_two_layers_a_distance_apart_bend_about_the_middle_between_them():
    """k d^2 / 2 of 300 N/m and 1.4 mm, and of 6 mm: the start and the bound of `si-sewn`."""
    bending = next(p for p in SI_SEWN.parameters if p.name == "bending_stiffness")
    assert bending.initial == pytest.approx(300 * 1.4e-3**2 / 2, rel=0.03)
    assert bending.maximum == pytest.approx(300 * 6e-3**2 / 2, rel=0.1)
    others = [p for p in SI_SEWN.parameters if p is not bending]
    assert others == [p for p in SI.parameters if p.name != "bending_stiffness"]


def test_a_method_gives_its_parameters_side_by_side():
    """Of `lean`: tension, bending, damping, all on a log scale."""
    assert LEAN.initial.tolist() == [300.0, 1.4e-5, 1.0]
    assert LEAN.minimum.tolist() == [30.0, 1e-6, 0.02]
    assert LEAN.maximum.tolist() == [1000.0, 2e-4, 8.0]
    assert LEAN.interval.tolist() == [100.0, 1e-5, 0.5]
    assert LEAN.is_log.tolist() == [True, True, True]
    assert KINECT_SKIRT.is_log.tolist() == [False] * 6


def test_a_start_of_other_values_is_moved_into_the_bounds_and_keeps_what_it_does_not_name():
    moved = LEAN.starting_from({"stretch_stiffness": 5000.0, "bending_stiffness": 1e-9, "nothing": 1.0}, "a table")
    assert moved.initial.tolist() == [1000.0, 1e-6, 1.0]
    assert moved.minimum.tolist() == LEAN.minimum.tolist()
    with pytest.raises(FitError) as refused:
        LEAN.starting_from({"nothing": 1.0}, "a table")
    assert str(refused.value) == (
        "the method lean cannot start from a table; use --method mocap-swatch, or a start of its own parameters"
    )


def test_the_thickness_of_a_fabric_is_its_weight_over_a_third_of_its_fibres():
    """Denim: 0.324 kg/m^2 over 0.35 x 1540 kg/m^3 is 0.6 mm."""
    denim = find_fabric("denim")
    assert denim.thickness == pytest.approx(0.324 / (0.35 * 1540))
    assert denim.start == {
        "density": 0.324, "stretching_stiffness": 456.0, "stretch_stiffness": 456.0, "bending_stiffness": 7.8e-5,
        "damping_coefficient": 1.0, "velocity_damping": 1.0,
    }  # fmt: skip
    with pytest.raises(FitError) as refused:
        find_fabric("tweed")
    assert str(refused.value) == f"there is no fabric named 'tweed'; known fabrics: {', '.join(FABRICS)}"


def test_methods_are_found_by_name_and_a_shirt_is_diagnosed_with_sewn_layers():
    blender = ["kinect-skirt", "kinect-skirt-weighed", "mocap-swatch", "mocap-swatch-weighed"]
    assert [find_method(name).name for name in METHODS] == [*blender, "si", "si-outline", "si-sewn", "lean"]
    assert find_method("mocap-swatch") is MOCAP_SWATCH
    with pytest.raises(FitError) as refused:
        find_method("guess")
    assert str(refused.value) == f"there is no method named 'guess'; known methods: {', '.join(METHODS)}"
    assert base_model_of(sheet()) is SI
    assert base_model_of(msgspec.structs.replace(sheet(), kind="t-shirt")) is SI_SEWN


# name: initial value, bounds and standard step, as the papers print them or as the modules give their sources.
KINECT_TABLE = {
    "mass": (1.0, 0.15, 10.0, 0.5), "struct": (30.0, 5.0, 80.0, 15.0), "bend": (20.0, 0.1, 150.0, 10.0),
    "spring": (3.0, 0.0, 25.0, 4.0), "air": (5.0, 1.0, 10.0, 5.0), "velocity": (0.95, 0.9, 1.0, 0.01),
}  # fmt: skip
SWATCH_TABLE = {
    "stretching_stiffness": (300.0, 30.0, 1000.0, 100.0), "bending_stiffness": (1.4e-5, 1e-6, 2e-4, 1e-5),
    "damping_coefficient": (1.0, 0.02, 8.0, 0.5), "density": (0.197, 0.03, 0.5, 0.05),
    "thickness": (1.0, 0.5, 2.0, 0.2),
}  # fmt: skip
SI_TABLE = {
    "stretch_stiffness": (300.0, 30.0, 1000.0, 100.0), "shear_stiffness": (30.0, 10.0, 220.0, 10.0),
    "bending_stiffness": (1.4e-5, 1e-6, 2e-4, 1e-5), "bending_damping_time": (2e-3, 1e-4, 2e-2, 1e-3),
    "velocity_damping": (1.0, 0.02, 8.0, 0.5),
}  # fmt: skip


def without(table, *names):
    return {name: row for name, row in table.items() if name not in names}


@pytest.mark.parametrize(
    ("method", "table", "degenerate", "gamma", "is_log"),
    [
        (KINECT_SKIRT, KINECT_TABLE, {"mass", "struct", "bend", "air", "velocity"}, 1e5, False),
        (KINECT_SKIRT_WEIGHED, without(KINECT_TABLE, "mass"), {"air", "velocity"}, 1e5, False),
        (MOCAP_SWATCH, SWATCH_TABLE, {*SWATCH_TABLE} - {"damping_coefficient"}, 1e4, False),
        (MOCAP_SWATCH_WEIGHED, without(SWATCH_TABLE, "density", "thickness"), set(), 1e4, False),
        (SI, SI_TABLE, set(), 1e5, True),
        (SI_SEWN, {**SI_TABLE, "bending_stiffness": (3e-4, 1e-6, 5e-3, 1e-5)}, set(), 1e5, True),
        (LEAN, without(SI_TABLE, "shear_stiffness", "bending_damping_time"), set(), 1e5, True),
    ],
    ids=lambda given: getattr(given, "name", ""),
)
def test_a_methods_parameters_have_the_values_bounds_and_steps_of_its_table(method, table, degenerate, gamma, is_log):
    found = {p.name: (p.initial, p.minimum, p.maximum, p.interval) for p in method.parameters}
    assert found == table
    assert list(found) == list(table)
    assert set(method.degenerate) == degenerate
    assert (method.gamma, method.knows_layers) == (gamma, method is SI_SEWN)
    assert {p.is_log for p in method.parameters} == {is_log}
    assert bool(method.not_identified) == bool(degenerate)
    of_swatch = "mocap" in method.name
    assert (method.is_in_metres, method.spacing) == (not of_swatch, 0.0208 if of_swatch else 0.05)
    assert method.objective.name == ("E/N" if of_swatch else "D")


def test_four_fabrics_are_those_of_their_tables():
    """kg/m^2, N/m, N m and kg/m^3 of fibre."""
    found = {
        f.name: (f.density, f.stretching_stiffness, f.bending_stiffness, f.fibre_density) for f in FABRICS.values()
    }
    assert found == {
        "silk": (0.1, 86.0, 1.9e-5, 1340.0), "denim": (0.324, 456.0, 7.8e-5, 1540.0),
        "cotton": (0.197, 1000.0, 1.4e-5, 1540.0), "polyester-rayon": (0.284, 37.0, 3.6e-5, 1425.0),
    }  # fmt: skip


def test_table_2_of_the_paper():
    """Initial, minimum, maximum and interval of the six parameters."""
    table = {p.name: (p.initial, p.minimum, p.maximum, p.interval) for p in KINECT_SKIRT.parameters}
    assert table == {
        "mass": (1.0, 0.15, 10.0, 0.5),
        "struct": (30.0, 5.0, 80.0, 15.0),
        "bend": (20.0, 0.1, 150.0, 10.0),
        "spring": (3.0, 0.0, 25.0, 4.0),
        "air": (5.0, 1.0, 10.0, 5.0),
        "velocity": (0.95, 0.9, 1.0, 0.01),
    }


def test_the_kinect_map_by_hand():
    """Mass 1, Struct 30, Bend 20, Spring 3, Air 5, Velocity 0.95 at 0.2 kg/m^2: 300 N/m, 2e-5 N m, 0.5 + 1.28 /s."""
    row = find_method("kinect-skirt").to_materials(KINECT_SKIRT.initial[None], 0.2)[0]
    assert row[:7] == pytest.approx([0.2, 300.0, 30.0, 2e-5, 3e-6, 1.2e-3, 0.5 + 1.28233], rel=1e-4)
    assert not row[7:].any()  # what effects switch on


def test_the_lean_model_leaves_shear_to_the_library():
    row = LEAN.to_materials(LEAN.initial[None], 0.2)[0]
    assert row[2] == pytest.approx(0.3)  # N/m: a thousandth of the stretch stiffness
    names = {p.name for p in LEAN.parameters}
    assert not {e.in_base for e in LIBRARY if e.in_base} & names
