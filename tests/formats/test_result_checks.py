"""The bounds at which the numbers of a fit or diagnosis are refused, each from both sides."""

from __future__ import annotations

from decimal import Decimal

import msgspec
import pytest

from formats.diagnosis_records import Figure
from formats.errors import ResultError
from formats.fit_records import Combination, TrivialFigure
from formats.result_checks import as_plain, check_result
from tests.fit.report.report_scene import diagnosis, fit_result

MASS = fit_result().parameters[0]  # fitted 1.7, within 0.15 to 10

NO_INTERVAL = {"interval_low": None, "interval_high": None}


def with_mass(**changes):
    """Return a fit whose only parameter is the mass, with changes; its name may be that of a material."""
    return msgspec.structs.replace(fit_result(), effects={}, parameters=[msgspec.structs.replace(MASS, **changes)])


def with_combination(low, high):
    numbers = {"initial": 1.0, "fitted": 2.0, "interval_low": low, "interval_high": high, "is_identified": True}
    return msgspec.structs.replace(
        fit_result(), combinations=[Combination(name="stretch/mass", unit="m2/s2", **numbers)]
    )


def with_effect(**changes):
    first, *others = diagnosis().effects
    return diagnosis(effects=[msgspec.structs.replace(first, **changes), *others])


def with_error(figure="train_after", *, sheet=False, **changes):
    """A fit with other errors, of its own or of the rigid sheet that hangs."""
    fit = fit_result()
    changed = msgspec.structs.replace(fit.error.train_after, **changes)
    if sheet:
        one = TrivialFigure(name="vertical", train=changed, parameters={})
        return msgspec.structs.replace(fit, trivial=[one])
    return msgspec.structs.replace(fit, error=msgspec.structs.replace(fit.error, **{figure: changed}))


def with_material(**values):
    return msgspec.structs.replace(fit_result(), material=values)


@pytest.mark.parametrize(
    "record",
    [
        msgspec.structs.replace(fit_result(), spacing=0.004),
        msgspec.structs.replace(fit_result(), layers=1),
        msgspec.structs.replace(fit_result(), seconds=1e100),
        with_material(areal_density=0.01, shear_stiffness=0.0, velocity_damping=0.3),
        with_mass(initial=0.15, fitted=0.15, interval_low=0.15, interval_high=0.15),
        with_mass(initial=0.15 - 9e-9, fitted=10 + 9e-9, interval_high=10.0),
        with_mass(minimum=-4.0, maximum=-2.0, initial=-4 - 4e-9, fitted=-2 + 4e-9, **NO_INTERVAL),
        with_mass(minimum=2.0, maximum=2.0, initial=2.0, fitted=2.0),
        with_mass(name="shear_stiffness", minimum=0.0, interval_low=0.0),
        with_mass(name="shear_stiffness", minimum=0.5, interval_low=0.5),
        with_mass(name="stretch_stiffness", minimum=1e-9, interval_low=1e-9),
        with_mass(name="hem", minimum=-1.0, interval_low=-0.5),
        with_combination(2.0, 2.0),
        msgspec.structs.replace(with_mass(fitted=2.1), search="tempering"),  # the best draw, beyond its quantiles
        msgspec.structs.replace(with_combination(2.5, 3.0), search="tempering"),
        with_error(mean_m=0.02, per_frame_m=[0.02, 0.03], time_s=[0.0, 1.0]),
        with_error(mean_m=0.03 * (1 + 5e-10), per_frame_m=[0.02, 0.03], time_s=[0.0, 1.0]),
        with_error("held_out_after", mean_m=9.0, per_frame_m=[], time_s=[]),
        with_effect(probability=0.0),
        with_effect(probability=1.0),
        with_effect(probability=-1e-9, p_value=1 + 1e-9),
        with_effect(amplitude_interval=(1.31, 1.31)),
    ],
)  # fmt: skip
def test_numbers_at_their_bounds_are_a_result(record):
    check_result(record, "r.json")


@pytest.mark.parametrize(
    ("record", "says"),
    [
        (with_error(mean_m=0.031, per_frame_m=[0.02, 0.03], time_s=[0.0, 1.0]),
         "error.train_after.mean_m is 0.031, and its frames have 0.02 to 0.03"),
        (with_error("held_out_before", mean_m=0.019, per_frame_m=[0.02, 0.03], time_s=[0.0, 1.0]),
         "error.held_out_before.mean_m is 0.019, and its frames have 0.02 to 0.03"),
        (with_error(sheet=True, mean_m=46.7),
         "trivial[0].train.mean_m is 46.7, and its frames have 0.0267002 to 0.0666957"),
        (with_error(time_s=[0.0]), "error.train_after has the errors of 120 frames and 1 times"),
        (with_mass(initial=0.15 - 11e-9), "initial: mass is 0.15, outside its own bounds of 0.15 to 10"),
        (with_mass(fitted=10 + 11e-9), "fitted: mass is 10, outside its own bounds of 0.15 to 10"),
        (with_mass(interval_low=None, interval_high=2.0), "the interval of mass has not a lower and an upper end"),
        (with_mass(interval_low=1.0, interval_high=None), "the interval of mass has not a lower and an upper end"),
        (with_mass(fitted=2.04 + 3e-9), "fitted: mass is 2.04, outside its own interval of 1.36 to 2.04"),
        (with_mass(fitted=1.3), "fitted: mass is 1.3, outside its own interval of 1.36 to 2.04"),
        (with_combination(2.5, 3.0), "combinations[0].fitted: stretch/mass is 2, outside its own interval of 2.5 to 3"),
        (with_effect(closure=Figure(value=0.9, interval=(0.1, 0.8))), "effects[0].closure.value is 0.9, outside its"
         " own interval of 0.1 to 0.8"),
        (msgspec.structs.replace(fit_result(), seconds=-1.0), "seconds is -1, and must not be below 0"),
        (with_mass(unit="kg", fitted=-0.2, minimum=-1.0, interval_low=-0.1, interval_high=0.1), "fitted: mass is -0.2,"
         " outside its own interval of -0.1 to 0.1"),
        (with_combination(2.1, 2.0), "the interval of stretch/mass has not a lower and an upper end"),
        (with_mass(name="shear_stiffness", minimum=-1e-9), "minimum: no cloth has shear_stiffness = -1e-09"),
        (with_mass(name="viscosity_time", interval_low=-0.5), "interval_low: no cloth has viscosity_time = -0.5"),
        (with_mass(name="stretch_stiffness", minimum=0.0), "minimum: no cloth has stretch_stiffness = 0"),
        (with_effect(amplitude=-1.01e100), "effects[0].amplitude is -1.01e+100, and no result has a number that large"),
        (with_effect(probability=-2e-9), "effects[0].probability is -2e-09, and must be from 0 to 1"),
        (with_effect(p_value=1 + 2e-9), "effects[0].p_value is 1, and must be from 0 to 1"),
        (with_effect(amplitude_interval=(1.5, 1.4)), "effects[0].amplitude_interval has not a lower and an upper end"),
    ],
)  # fmt: skip
def test_numbers_beyond_their_bounds_are_refused_by_their_place(record, says):
    with pytest.raises(ResultError) as refused:
        check_result(record, "r.json")
    place = "parameters[0]." if says.startswith(("minimum", "interval_low", "initial", "fitted")) else ""
    again = "diagnose again" if says.startswith("effects") else "fit again"
    assert str(refused.value) == f"r.json: {place}{says}; {again}"


@pytest.mark.parametrize(("material", "fitted", "is_one"), [
    (2.0, 2.0 + 1.9e-9, True), (2.0, 2.0 + 2.1e-9, False), (0.0, 1e-301, True), (0.0, 1e-299, False),
])  # fmt: skip
def test_the_fitted_material_and_its_parameter_are_one_number_but_for_their_rounding(material, fitted, is_one):
    record = msgspec.structs.replace(with_mass(fitted=fitted, minimum=0.0, **NO_INTERVAL), material={"mass": material})
    if is_one:
        check_result(record, "r.json")
        return
    with pytest.raises(ResultError, match=f"material.mass is {material:g}, and the parameter's value {fitted:g}"):
        check_result(record, "r.json")


def test_a_number_of_a_kind_that_no_result_has_is_named():
    with pytest.raises(NotImplementedError, match="a result holds a Decimal"):
        as_plain(Decimal("1.5"))
