"""The fabric of a fit: SI quantities, intervals, and status of unidentified quantities."""

from __future__ import annotations

import csv
import functools
import io
import math
import re
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from fit.errors import FitError
from fit.export.about import caution_lines
from fit.export.fabric import fabric_of, status_of
from fit.export.tables import parameters_csv, software_table
from fit.folders import notes_of_diagnosis, own_warnings
from fit.identification.calibrate import TOO_SHORT
from fit.identification.notes_on_values import FREE_PARAMETERS, STOPPED_AT_BOUND
from fit.identification.read_again import read_fit
from fit.identification.trivial import describe_trivial
from fit.virtual_tests.sheet import sheet_of
from formats.fit_records import Combination, TrivialFigure
from formats.results import save_diagnosis, save_fit_result
from tests.fit.export.exported import a_fit, text_of
from tests.fit.report.report_scene import diagnosis


def test_the_quantities_of_an_si_fit_are_its_parameters():
    fabric = fabric_of(a_fit())
    stretch = fabric["stretch_warp"]
    assert (stretch.value, stretch.low, stretch.high) == pytest.approx((100.0, 80.0, 125.0))
    assert (stretch.unit, stretch.status) == ("N/m", "measured")
    assert fabric["bending_weft"].low == pytest.approx(0.8 * 1.4e-5)
    assert (fabric["areal_density"].value, fabric["areal_density"].status) == (0.2, "weighed")
    assert fabric["stretch_damping_time"].status == "assumed"
    assert fabric.not_identified == ()


def test_warp_and_weft_by_hand():
    """a = ln 4: warp 100 x 2, weft 100 / 2; the least warp is 80 e^((ln 4 - 0.2) / 2) = 144.77."""
    fabric = fabric_of(a_fit(effects={"anisotropy.stretch": np.log(4), "anisotropy.bending": 0.0}))
    assert fabric["stretch_warp"].value == pytest.approx(200.0)
    assert fabric["stretch_weft"].value == pytest.approx(50.0)
    assert fabric["stretch_warp"].low == pytest.approx(144.77, rel=1e-4)
    assert fabric["stretch_weft"].low == pytest.approx(80 * np.exp(-(np.log(4) + 0.2) / 2))
    assert fabric["bending_warp"].value == pytest.approx(1.4e-5)


def test_air_drag_is_part_of_the_fabric():
    drag = fabric_of(a_fit(effects={"air_drag": 1.2}))["drag_coefficient"]
    assert (drag.value, drag.low, drag.high) == pytest.approx((1.2, 1.0, 1.4))


def test_two_layers_share_what_forces_they_bear_and_no_times():
    fabric = fabric_of(a_fit(layers=2))
    assert fabric["stretch_warp"].value == pytest.approx(50.0)
    assert (fabric["stretch_warp"].low, fabric["stretch_warp"].high) == pytest.approx((40.0, 62.5))
    assert fabric["bending_damping_time"].value == pytest.approx(2e-3)
    both = fabric.whole["stretch_warp"]
    assert (both.low, both.value, both.high) == pytest.approx((80.0, 100.0, 125.0))


def test_a_quantity_of_a_parameter_that_is_not_identified_is_not_either():
    result = a_fit(unknown=("shear_stiffness",))
    fabric = fabric_of(result)
    assert [q.name for q in fabric.not_identified] == ["shear"]
    (line,) = [line for line in caution_lines(result, fabric) if line.startswith("shear:")]
    meaning = "the takes do not identify it: the whole interval stays possible"
    assert line == f"shear: 90 % interval 24 to 37.5 N/m; {meaning}."
    bare = [msgspec.structs.replace(p, interval_low=None, interval_high=None) for p in result.parameters]
    result = msgspec.structs.replace(result, parameters=bare)
    assert f"shear: no interval; {meaning}." in caution_lines(result, fabric_of(result))


def test_a_weighed_kinect_skirt_has_si_values_and_says_that_its_shear_is_no_measurement():
    """Struct 30 is 300 N/m of stretch and 30 N/m of shear, which the method takes as a tenth of it."""
    fabric = fabric_of(a_fit("kinect-skirt-weighed"))
    assert fabric["stretch_warp"].value == pytest.approx(300.0)
    assert fabric["shear"].status == "tied to stretch"
    assert fabric["velocity_damping"].status == "not identified"


@pytest.mark.parametrize("method", ["kinect-skirt", "mocap-swatch"])
def test_a_fit_that_fitted_the_weight_has_no_fabric_and_says_what_can_be_exported(method):
    with pytest.raises(FitError, match=r"which motion does not tell.*can be exported as csv"):
        fabric_of(a_fit(method))


def test_a_fit_of_blenders_cloth_has_no_fabric():
    with pytest.raises(FitError, match="the fit is of blender's cloth, whose numbers have no SI values"):
        fabric_of(a_fit("kinect-skirt", engine="blender"))


def test_the_csv_keeps_an_unidentified_value_out_of_the_column_of_values():
    result = a_fit(unknown=("shear_stiffness",))
    rows = list(csv.DictReader(io.StringIO(parameters_csv(result, fabric_of(result)))))
    named = {(row["kind"], row["name"]): row for row in rows}
    shear = named["fabric", "shear"]
    assert (shear["value"], float(shear["one_of_many"]), float(shear["interval_low"])) == ("", 30.0, 24.0)
    assert float(named["fabric", "stretch_weft"]["value"]) == 100.0
    assert named["parameter", "bending_stiffness"]["unit"] == "N m"
    assert named["provenance", "takes"]["value"] == "swing-01"


def test_the_csv_of_a_kinect_skirt_has_its_parameters_and_no_fabric():
    rows = list(csv.DictReader(io.StringIO(parameters_csv(a_fit("kinect-skirt"), None))))
    assert {row["kind"] for row in rows} == {"parameter", "provenance"}


def test_the_table_by_hand():
    """Force: 100 x 0.05 x 0.05 N = 25.5 gf; overhang: 2 (1.4e-5 / (9.80665 x 0.2))^(1/3) = 38.5 mm; G 30 / 56.19."""
    text = software_table(a_fit(), fabric_of(a_fit()))
    lines = {line[:30].split("  ")[0].strip(): line for line in text.splitlines() if line}
    force = next(line for line in text.splitlines() if "force at 5 %, warp" in line)
    assert "25.5" in force
    assert "20.4 to 31.9" in force
    overhang = next(line for line in text.splitlines() if "overhang at 41.5 deg, weft" in line)
    assert "38.5" in overhang
    assert "0.534" in next(line for line in text.splitlines() if "KES G" in line)
    assert "200" in lines["Weight"]
    assert "not published" in " ".join(text.split())


def test_the_table_gives_no_number_where_the_takes_determine_none():
    result = a_fit(unknown=("stretch_stiffness",))
    text = software_table(result, fabric_of(result))
    line = next(line for line in text.splitlines() if line.startswith("Stretch warp"))
    assert "NOT IDENTIFIED" in line
    assert line.split()[2] == "-"
    assert "80 to 125" in line


def test_a_combination_that_is_not_identified_keeps_its_value_apart_too():
    ratio = Combination(
        name="bending / density", unit="N m", initial=1.0, fitted=2.0, interval_low=1.0, interval_high=3.0,
        is_identified=False,
    )  # fmt: skip
    result = msgspec.structs.replace(a_fit(), combinations=[ratio])
    rows = list(csv.DictReader(io.StringIO(parameters_csv(result, None))))
    (row,) = [row for row in rows if row["kind"] == "combination"]
    assert (row["value"], row["one_of_many"]) == ("", "2.0")


def test_a_number_that_several_parameters_make_has_the_verdict_of_its_combination():
    """Neither Air nor Velocity is identified, and the damping that they make is: 1.1 to 1.3 /s."""
    told = Combination(
        name="velocity damping", unit="1/s", initial=1.0, fitted=1.2, interval_low=1.1, interval_high=1.3,
        is_identified=True,
    )  # fmt: skip
    result = msgspec.structs.replace(a_fit("kinect-skirt-weighed"), combinations=[told])
    damping = fabric_of(result)["velocity_damping"]
    assert (damping.status, damping.low, damping.high) == ("measured", 1.1, 1.3)


@pytest.mark.parametrize(
    ("verdict", "named", "fitted", "takes", "says"),
    [
        ("effect", ["air_drag"], {}, ["a", "b"], "names air drag, which"),
        ("several", ["air_drag", "hem"], {"hem": 0.01}, ["a", "b"], "names air drag, which"),
        ("ambiguous", ["air_drag", "hem"], {}, ["a", "b"], "names air drag or hem, which"),
        ("ambiguous", ["air_drag", "hem"], {"hem": 1.0}, ["a", "b"], ""),
        ("effect", ["hem"], {"hem": 0.02}, ["a", "b"], ""),
        ("effect", ["air_drag"], {}, ["c"], ""),
        ("none", [], {}, ["a", "b"], ""),
    ],
)
def test_a_fit_is_not_simply_measured_where_a_diagnosis_beside_it_names_an_effect(
    tmp_path, verdict, named, fitted, takes, says
):
    save_fit_result(tmp_path / "fit.json", msgspec.structs.replace(a_fit(effects=fitted), take_contents=["b", "a"]))
    found = diagnosis(verdict=verdict, named=named, take_contents=takes)
    save_diagnosis(tmp_path / "diagnosis.json", found)
    result = read_fit(tmp_path)[0]
    notes = notes_of_diagnosis(result.notes)
    assert [says in note for note in notes] == ([True] if says else [])
    text = software_table(result, fabric_of(result))
    shear = next(line for line in text.splitlines() if line.startswith("Shear"))
    status = "measured by a model that lacks an effect" if says else "measured"
    assert status_in_table(shear) == status
    rows = list(csv.DictReader(io.StringIO(parameters_csv(result, fabric_of(result)))))
    assert {row["status"] for row in rows if "shear" in row["name"]} == {status}
    assert ("Fit again with --effect air_drag" in " ".join(text.split())) == bool(says)
    assert ("Fit again with" in sheet_of(result)) == bool(says)
    told = next(row["value"] for row in rows if row["name"] == "missing_effects")
    assert told == " ".join(notes)


WARNED = "Warning: the fit hardly beats a trivial predictor: 8.0 mm, a rigid sheet 8.2 mm. Its parameters tell little."
BOUND = "At its bound: shear_stiffness. Its range stopped the fit there."


@pytest.mark.parametrize("kind", ["csv", "table", "usd-physics", "newton", "mujoco", "u3m", "blender"])
def test_every_file_repeats_what_a_fit_warns_of_itself(kind):
    """No take and no diagnosis is at fault: the fit alone knows that a rigid sheet follows the takes as well."""
    result = msgspec.structs.replace(a_fit(), notes=["A remark.", WARNED, BOUND])
    for note in (WARNED, BOUND):
        assert note in " ".join(text_of(kind, result).split())
        assert "Warning" not in text_of(kind, a_fit())
        assert note in sheet_of(result)
    assert "A remark." not in text_of(kind, result)


def test_the_notes_that_a_fit_writes_begin_as_the_exports_look_for_them():
    """A trivial predictor that errs by 8 mm, and a fit by 7.9 and by 9 mm."""
    trivial = [TrivialFigure(name="pendulum", train=a_fit().error.train_after)]
    notes = [describe_trivial(mean_m, trivial, is_held_out=False) for mean_m in (0.0079, 0.009)]
    warned = msgspec.structs.replace(a_fit(), notes=[*notes, TOO_SHORT, STOPPED_AT_BOUND, FREE_PARAMETERS])
    assert own_warnings(warned.notes) == [*notes, TOO_SHORT, STOPPED_AT_BOUND]


def test_a_fit_that_warns_of_itself_is_not_simply_measured_and_one_parameter_at_its_bound_leaves_the_others():
    doubt, bound = (msgspec.structs.replace(a_fit(), notes=[note]) for note in (WARNED, BOUND))
    told = [rows_of(software_table(one, fabric_of(one)))["Shear"][-1] for one in (doubt, bound)]
    assert [one.partition(";")[0] for one in told] == ["measured, in doubt", "measured"]


def test_a_quantity_of_several_parameters_is_as_doubtful_as_the_most_doubtful_of_them():
    known, unknown, without = (SimpleNamespace(is_identified=one) for one in (True, False, None))
    status = functools.partial(status_of, result=a_fit())
    assert status([known, known]) == "measured"
    assert status([known, without]) == status([without, known]) == "no interval"
    assert status([known, unknown, without]) == status([without, unknown]) == "not identified"
    assert status([known, unknown]) == "not identified"


def status_in_table(line):
    """The status in a row of the sheet for garment programs."""
    return re.split(r"\s{2,}", line.strip())[-1].partition(";")[0]


def rows_of(text):
    """The rows of the sheet for garment programs: name, and what follows."""
    body = text.split("how sure, and what to do with it\n")[1].split("\n\n")[0]
    return {re.split(r"\s{2,}", line.strip())[0]: re.split(r"\s{2,}", line.strip())[1:] for line in body.splitlines()}


def test_every_row_of_the_table_by_hand():
    """Warp e^0.35 and weft e^-0.35 of 100 N/m, and e^0.1, e^-0.1 of 1.4e-5 N m; 1 gf is 9.80665 mN."""
    result = a_fit(effects={"anisotropy.stretch": 0.7, "anisotropy.bending": 0.2, "air_drag": 1.3})
    rows = rows_of(software_table(result, fabric_of(result)))
    force = 100 * 0.05 * 0.05 / 9.80665e-3
    overhang = 2e3 * (1.4e-5 / (9.80665 * 0.2)) ** (1 / 3)
    expected = {
        "Weight": (200.0, "g/m2"), "Stretch warp": (100 * math.exp(0.35), "N/m"),
        "Stretch weft": (100 * math.exp(-0.35), "N/m"), "force at 5 %, warp": (force * math.exp(0.35), "gf"),
        "force at 5 %, weft": (force * math.exp(-0.35), "gf"), "Shear": (30.0, "N/m"),
        "KES G": (30 / (9.80665e-3 / 0.01 * 180 / math.pi), "gf/(cm deg)"),
        "Bending warp": (14 * math.exp(0.1), "µN m"), "Bending weft": (14 * math.exp(-0.1), "µN m"),
        "overhang at 41.5 deg, warp": (overhang * math.exp(0.1 / 3), "mm"),
        "overhang at 41.5 deg, weft": (overhang * math.exp(-0.1 / 3), "mm"),
        "KES B, warp": (1.4e-5 * math.exp(0.1) / 9.80665e-5, "gf cm2/cm"),
        "KES B, weft": (1.4e-5 * math.exp(-0.1) / 9.80665e-5, "gf cm2/cm"),
        "Bending damping": (2.0, "ms"), "Air and linear damping": (0.5, "1/s"), "Drag coefficient": (1.3, "1"),
    }  # fmt: skip
    assert set(rows) == {*expected, "Thickness"}
    for name, (value, unit) in expected.items():
        assert float(rows[name][0]) == pytest.approx(value, rel=5e-3), name
        assert unit in rows[name], name
    plain = software_table(a_fit(), fabric_of(a_fit()))
    assert "Drag coefficient" not in plain
    assert rows_of(plain)["Bending damping"][1] == "1.6 to 2.5"
    assert plain.splitlines()[0] == "Fabric for CLO, Marvelous Designer and Browzwear"
    assert max(map(len, plain.split("\n\n")[-1].splitlines())) <= 100


def test_a_fit_of_an_unknown_method_has_no_fabric():
    with pytest.raises(FitError, match="there is no method named 'guess'"):
        fabric_of(msgspec.structs.replace(a_fit(), method="guess"))


def test_the_numbers_of_a_garment_of_layers_are_said_to_be_of_one_of_them():
    said = "The garment has {} layers; the numbers are of one of them."
    for layers in (2, 3):
        result = a_fit(layers=layers)
        assert said.format(layers) in caution_lines(result, fabric_of(result))
    assert not any("layers" in line for line in caution_lines(a_fit(), fabric_of(a_fit())))


def test_each_layer_bears_its_share_of_friction_and_moves_its_share_of_air():
    """Of two layers each has half of both; the drag on their faces is not shared."""
    effects = {"bending_hysteresis": 2e-4, "added_mass": 0.1, "air_drag": 1.2}
    fabric = fabric_of(a_fit(effects=effects, layers=2))
    one, whole = (
        [one[name].value for name in ("bending_friction", "added_mass", "drag_coefficient")]
        for one in (fabric, fabric.whole)
    )
    assert one == pytest.approx([1e-4, 0.05, 1.2])
    assert whole == pytest.approx([2e-4, 0.1, 1.2])
