"""Virtual fabric tests, by hand and against the solver's cloth."""

from __future__ import annotations

import dataclasses
import re

import msgspec
import numpy as np
import pytest

from fit.cloth import material as mat
from fit.cloth.mesh import build_mesh
from fit.cloth.model import Resolution
from fit.cloth.simulator import Simulator
from fit.errors import FitError
from fit.identification.calibrate import calibrate
from fit.identification.request import request_of
from fit.methods import LEAN
from fit.recordings.recording import prepare
from fit.virtual_tests.fabric_ranges import TEN, range_of_ten, share_below
from fit.virtual_tests.fitted_rows import FittedRows
from fit.virtual_tests.kes import (
    BENDING_UNIT,
    HYSTERESIS_UNIT,
    SHEAR_UNIT,
    TENSION_UNIT,
    make_sheet,
    shear_test,
    stretch_test,
    tension,
)
from fit.virtual_tests.sheet import sheet_of, unidentified_of
from formats.fit_records import Combination
from tests.fit.export.exported import a_fit
from tests.fit.report.report_scene import fit_result
from tests.fit.scenes import as_rows, hung, material, sheet, simulate_take, swing, take_of

MEDIAN = dict(zip(mat.MATERIAL_NAMES, as_rows([mat.Material()])[0].tolist(), strict=True))


def test_units_by_hand():
    """1 gf is 9.80665 mN: 0.980665 N/m per cm, 9.80665e-5 N m as gf cm^2/cm, 56.19 N/m per radian as gf/(cm degree)."""
    units = [TENSION_UNIT, BENDING_UNIT, SHEAR_UNIT, HYSTERESIS_UNIT]
    assert units == pytest.approx([0.980665, 9.80665e-5, 56.188, 9.80665e-3], rel=1e-5)


def test_the_median_fabric_on_the_tester_by_hand():
    """B = 1.4e-5 / 9.80665e-5 = 0.1428, G = 30 x 0.99859 / 56.188 = 0.5332, W = 20 mg/cm^2, slope 300 / 0.980665."""
    found = make_sheet(MEDIAN, friction_moment=2e-4)
    assert found.warp.bending == pytest.approx(0.14276, rel=1e-4)
    assert found.shear == pytest.approx(0.5332, rel=1e-4)
    assert found.weight == pytest.approx(20.0)
    assert found.weft.first_slope == pytest.approx(305.9, rel=1e-4)
    assert found.warp.bending_hysteresis == pytest.approx(2 * 2e-4 / 9.80665e-3, rel=1e-6)


def test_tension_by_hand():
    """lambda = 1.1: E = 0.105, force 1.1 x 300 x 0.105 = 34.65 N/m, energy 300 x 0.105^2 / 2 = 1.65375 J/m^2."""
    assert tension(0.1, 300.0) == pytest.approx(34.65)
    assert tension(0.1, 300.0, 40.0) == pytest.approx(34.65 * (1 + 40 * 0.105))
    extension, energy = stretch_test(300.0, load=34.65)
    assert extension == pytest.approx(0.1)
    assert energy == pytest.approx(1.65375)


def test_the_stored_energy_is_the_area_under_the_curve():
    extension, energy = stretch_test(500.0, 30.0)
    grid = np.linspace(0, extension, 20001)
    assert energy == pytest.approx(np.trapezoid([tension(e, 500.0, 30.0) for e in grid], grid), rel=1e-6)


def test_linear_cloth_is_nearly_linear_at_small_loads():
    """A thousandth of the stiffness stretches by a thousandth, and LT = 1 but for 3/4 of that."""
    extension, energy = stretch_test(1000.0, load=1.0)
    assert extension == pytest.approx(1e-3, rel=2e-3)
    assert energy / (0.5 * 1.0 * extension) == pytest.approx(1.0, rel=1e-3)


def test_warp_over_weft_is_the_anisotropys_exponential():
    found = make_sheet(MEDIAN | {"bending_ratio": np.log(4.0), "stretch_ratio": np.log(9.0)})
    assert found.warp.bending / found.weft.bending == pytest.approx(4.0)
    assert found.warp.first_slope / found.weft.first_slope == pytest.approx(9.0)


def settled(garment, row, spacing):
    """Points of a sheet that hangs still, after five seconds of strong damping."""
    time = np.arange(0, 5, 1 / 10)
    recording = prepare(take_of(garment, time, np.zeros((len(time), 3)), hung(garment, time)))
    return Simulator(recording, resolution=Resolution(spacing=spacing)).run(row).points[0, -1]


@pytest.mark.parametrize("stiffening", [0.0, 5.0])
def test_the_solvers_sheet_stretches_as_the_virtual_test_says(stiffening):
    """A sheet of 2 kg/m^2 and 0.45 m hangs from its edge: at z above the bottom it carries rho g z.

    Its lowest point sinks by the integral of the virtual test's extension over these loads, up to 8.8 N/m at 60 N/m.
    """
    garment = sheet(width=0.2, height=0.45, mass=0.18)
    row = material(garment, stretch_stiffness=60.0, velocity_damping=8.0)
    row[0, mat.STIFFENING] = stiffening
    loads = 2.0 * 9.80665 * (np.arange(300) + 0.5) / 300 * 0.45
    expected = 0.45 / 300 * sum(stretch_test(60.0, stiffening, load)[0] for load in loads)
    sunk = -settled(garment, row, 0.05)[2:4, 2].mean() - 0.45
    assert expected > 0.015
    # What is left is single precision and the last of the settling.
    assert sunk == pytest.approx(expected, rel=1e-3)


def test_the_solvers_sheet_shears_as_the_virtual_test_says():
    """A wide sheet of 8 N/m shear stiffness, gravity tilted sideways by 0.3 rad: gamma = rho g sin(0.3) z / G.

    Its bottom moves rho g sin(0.3) H^2 / (2 G) = 0.2 x 2.898 x 0.01 / 16 = 0.362 mm sideways; the sheet's own pull down
    stiffens it by rho g z / G, 1.2 % on average over the height.
    """
    garment = sheet(width=0.8, height=0.1, mass=0.016)
    row = material(garment, shear_stiffness=8.0, stretch_stiffness=800.0, velocity_damping=8.0)
    row[0, mat.TILT_X] = 0.3
    place = settled(garment, row, 0.033)
    expected = 0.2 * 9.80665 * np.sin(0.3) * 0.1**2 / 2 / shear_test(8.0)
    # 2 %: the free sides, and that stiffening.
    assert place[2:4, 0].mean() == pytest.approx(expected, rel=0.02)


def test_the_solvers_bends_store_what_the_virtual_test_says():
    """Energies of a mesh rolled to 1.5 and to 0.5 per cm: (2 / area) (W_2 - W_1) / (K_2^2 - K_1^2) = B, here 1 N m."""
    mesh = build_mesh(sheet(width=0.02, height=0.02), 0.0005)

    def energy(curvature):
        angle = curvature * mesh.rest[:, 0]
        rolled = np.stack([np.sin(angle) / curvature, mesh.rest[:, 1], (1 - np.cos(angle)) / curvature], 1)
        return 0.5 * (mesh.bends.stencils.apply(rolled) ** 2).sum()

    slope = 2 * (energy(150.0) - energy(50.0)) / (150.0**2 - 50.0**2) / 4e-4
    # The outermost nodes, 1/12 of an element on either side of thirteen, store nothing.
    assert slope == pytest.approx(1 - 2 / 12 / 13, rel=0.005)


def test_the_ten_fabrics_in_kes_units():
    """Denim: 32.4 mg/cm^2, shear 53.4 / 4 / 56.188 = 0.2376; the lightest of the ten has 11.3 mg/cm^2."""
    assert len(TEN) == 10
    assert range_of_ten("weight") == pytest.approx((11.3, 32.4))
    assert range_of_ten("slope") == pytest.approx((3.3 / 0.980665, 2035.0 / 0.980665), rel=1e-6)
    assert range_of_ten("bending") == pytest.approx((14.3e-6 / 9.80665e-5, 125.4e-6 / 9.80665e-5), rel=1e-6)
    denim = next(fabric for fabric in TEN if "denim" in fabric.name)
    assert (np.sqrt(np.prod(denim.stretch)), np.mean(denim.bending)) == pytest.approx((456.0, 8.06e-5), rel=2e-3)
    assert range_of_ten("shear")[1] == pytest.approx(104.8 / 4 / 56.188, rel=1e-4)


def test_a_median_fabric_is_above_half_of_618():
    assert share_below("weight", 19.7) == "more than 50 % of them"
    assert share_below("bending warp", 0.001) == "less than 95 % of them"
    # Between the median and the 75 % quantile by logarithms: the root of both weights lies half-way, at 62.5 %.
    assert share_below("weight", np.sqrt(19.7 * 29.4)) == "more than 62 % of them"
    assert share_below("weight", np.sqrt(29.4 * 48.8)) == "more than 85 % of them"
    assert share_below("weight", 49.0) == "more than 95 % of them"


@pytest.mark.parametrize(("weight", "share"), [(3.101, 5), (10.4, 25), (19.7, 50), (29.4, 75), (48.7, 95)])
def test_a_quantile_of_the_618_fabrics_is_above_its_share_of_them(weight, share):
    assert share_below("weight", weight) == f"more than {share} % of them"


def test_linearity_is_one_of_a_law_that_pulls_in_proportion_to_the_extension():
    """LT = WT / (F EMT / 2): of a stiff cloth, which stretches by 1 / 1000, nearly a spring's; less where it curves."""
    made = make_sheet(MEDIAN | {"stretch_stiffness": 490.3325 * 1000})
    assert made.warp.linearity == pytest.approx(1.0, abs=2e-3)
    assert made.warp.extension == pytest.approx(0.1, rel=2e-3)
    assert made.warp.tensile_energy * 9.80665e-3 / 1e-2 == pytest.approx(490.3325 * 0.001 / 2, rel=3e-3)


def known(result, *unknown):
    """The same fit, whose takes identify all parameters but some."""
    parameters = [msgspec.structs.replace(p, is_identified=p.name not in unknown) for p in result.parameters]
    return msgspec.structs.replace(result, parameters=parameters)


def test_a_number_that_the_takes_do_not_identify_is_replaced_by_its_interval():
    """Stretch of 80 to 125 N/m is 81.6 to 127 gf/cm, all that follows from it is an interval; bending is known."""
    result = known(a_fit(), "stretch_stiffness")
    lines = {line.split("  ")[0]: line for line in sheet_of(result).splitlines()}
    assert lines["first slope of tension"].count("81.6 to 127") == 2
    assert " 102 " not in lines["first slope of tension"]
    low, high = (100 * stretch_test(k)[0] for k in (125.0, 80.0))
    assert f"{low:.3g} to {high:.3g}" in lines["EMT at 500 gf/cm *"]
    assert " 0.143 " in lines["B, bending 0.5 to 1.5 1/cm"]
    assert "A number with two ends is a 90 % interval: the takes do not identify it." in lines
    assert "two ends" not in sheet_of(known(a_fit()))
    assert set(unidentified_of(result)) == {
        f"{way}.{name}"
        for way in ("warp", "weft")
        for name in ("first_slope", "extension", "tensile_energy", "linearity")
    }


def line_of(result, name):
    """The line of the sheet that begins with a name."""
    return next(x for x in sheet_of(result).splitlines() if x.startswith(name))


def test_an_interval_in_the_sheet_is_of_one_layer():
    """Of two layers that slide: 80 to 125 N/m are 40 to 62.5 N/m of each, 40.8 to 63.7 gf/cm; of 2HB likewise."""
    assert line_of(known(a_fit(layers=2), "stretch_stiffness"), "first slope").count("40.8 to 63.7") == 2
    friction = a_fit(effects={"bending_hysteresis": 0.3}, unknown=("bending_hysteresis",), layers=2)
    assert line_of(friction, "2HB").count("10.2 to 51") == 2


def test_a_number_without_interval_is_called_not_identified_once_a_column():
    result = known(a_fit(), "bending_stiffness")
    assert re.search(r"[^,]  not identified$", line_of(result, "B, bending"))
    bare = [msgspec.structs.replace(p, interval_low=None, interval_high=None) for p in result.parameters]
    assert line_of(msgspec.structs.replace(result, parameters=bare), "B, bending").count("not identified") == 3


def test_a_parameter_at_an_end_of_its_range_decides_as_within_it():
    """A stretch stiffness at its largest is 1000 N/m or whatever the range ends with, and so still not identified."""
    for p in known(a_fit()).parameters[:1]:
        result = known(a_fit(values={p.name: p.maximum}), p.name)
        assert "warp.first_slope" in unidentified_of(result)


def test_the_sheet_names_the_combinations_that_are_not_identified_and_no_others():
    told, unidentified = (
        Combination(
            name=name, unit="m2/s2", initial=1.0, fitted=1.0, interval_low=0.5, interval_high=2.0, is_identified=is_told
        )
        for name, is_told in (("shear stiffness / density", True), ("stretch stiffness / density", False))
    )
    result = msgspec.structs.replace(known(a_fit(), "stretch_stiffness"), combinations=[told, unidentified])
    assert "The takes do not identify stretch stiffness / density." in sheet_of(result).splitlines()


def test_warp_and_weft_stand_in_their_own_columns():
    """exp(0.35) and exp(-0.35) of 100 N/m are 145 and 71.9 gf/cm."""
    line = line_of(known(a_fit(effects={"anisotropy.stretch": 0.7, "anisotropy.bending": 0.0})), "first slope")
    assert re.search(r"gf/cm +145 +71\.9 ", line)


def test_a_fault_of_measurement_changes_no_number_of_the_cloth():
    """A clock that drifts by 2 % would make cloth 4 % softer."""
    drifting = a_fit(effects={"clock_drift": 0.02})
    result = msgspec.structs.replace(drifting, material=a_fit().material)
    values = np.array([p.fitted for p in result.parameters])
    assert FittedRows(result).at(values)[mat.STRETCH] == pytest.approx(100.0)


def test_a_friction_that_the_takes_do_not_identify_is_replaced_by_its_interval():
    """0.05 N within 0 to 0.25 N: 2HB is 2 M / 9.80665e-3, 0 to 51."""
    result = a_fit(effects={"bending_hysteresis": 0.05}, unknown=("bending_hysteresis",))
    friction = next(p for p in result.parameters if p.name == "bending_hysteresis")
    ends = [p if p is not friction else msgspec.structs.replace(p, interval_low=0.0) for p in result.parameters]
    line = next(x for x in sheet_of(msgspec.structs.replace(result, parameters=ends)).splitlines() if "2HB" in x)
    assert line.count("0 to 51") == 2


def test_the_mass_that_a_method_fits_leaves_no_stiffness_known():
    """Mass 1 of 0.8 to 1.25 makes a weight of 16 to 25 mg/cm^2, and mass 2 twice as much."""
    for mass, ends in ((1.0, "16 to 25"), (2.0, "32 to 50")):
        line = line_of(a_fit("kinect-skirt", values={"mass": mass}), "W, weight")
        assert re.search(rf"^W, weight +mg/cm2 +{ends} .*not identified$", line)


def test_the_sheet_of_a_real_fit_says_what_motion_cannot_identify():
    garment = sheet()
    time = np.arange(0, 2, 1 / 30)
    take = simulate_take(garment, time, swing(time), material(garment))
    result = known(calibrate([take], [], request_of(LEAN, [], iterations=3, seed=0, spacing=0.1)))
    text = sheet_of(result)
    fitted = {p.name: p.fitted for p in result.parameters}
    assert result.material["bending_stiffness"] == pytest.approx(fitted["bending_stiffness"])
    assert f"{fitted['bending_stiffness'] / 9.80665e-5:.3g}" in text
    assert re.search(r"^W, weight +mg/cm2 +20 ", text, re.MULTILINE)
    assert "The weight was fitted" not in text
    assert "layers" not in text
    double = dataclasses.replace(take, garment=msgspec.structs.replace(garment, layers=2))
    twice = calibrate([double], [], request_of(LEAN, [], iterations=3, seed=0, spacing=0.1))
    assert twice.material == result.material
    text = sheet_of(known(twice))
    assert f"{fitted['bending_stiffness'] / 2 / 9.80665e-5:.3g}" in text
    assert re.search(r"^W, weight +mg/cm2 +10 ", text, re.MULTILINE)
    assert "The garment is 2 layers, fitted as one" in text


def test_a_result_without_its_material_is_refused():
    with pytest.raises(FitError, match="does not hold its material"):
        sheet_of(fit_result())


def test_a_parameter_at_its_bound_decides_a_number_as_any_other_does():
    """Fitted at its least value, a stretch stiffness moves the slope only towards its largest."""
    lowest = next(p.minimum for p in a_fit().parameters if p.name == "stretch_stiffness")
    result = known(a_fit(values={"stretch_stiffness": lowest}), "stretch_stiffness")
    assert "warp.first_slope" in unidentified_of(result)


def test_the_sheet_says_what_the_law_leaves_out():
    """Tension and shear lose no energy: the whole of it comes back, and no force is left."""
    assert "RT is 100 % and 2HG is 0: the law has no friction in tension and shear." in sheet_of(a_fit())
