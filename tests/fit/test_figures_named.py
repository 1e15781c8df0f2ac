"""Screens name their error figure, mark intervals at a bound, and ask for the unit that was probably meant."""

from __future__ import annotations

import csv
import io
import math

import msgspec
import pytest

from fit.api.shown import diagnosis_tables
from fit.api.tables import as_text
from fit.batch.morning import as_text as as_mail
from fit.batch.morning import morning_of
from fit.batch.runner import Survey
from fit.batch.store import open_store
from fit.batch.summary import STATE_WORDS, Row, as_csv, as_facts, as_html
from fit.cloth.mesh import check_mesh
from fit.errors import FitError
from fit.export.kinds import Order, check_order
from fit.export.new_motion import check_motion
from fit.export.worn import FigureOrder
from fit.identification.request import Plan
from fit.methods import METHODS
from tests.fit.export.exported import a_fit
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.fit.scenes import sheet


def row(state="fitted", result=None):
    return Row(take="a.mcap", key="k", state=state, sentence="", result=result)


def test_a_diagnosis_says_that_its_errors_are_root_mean_squares():
    assert "Errors are root mean square distances of the free points." in as_text(diagnosis_tables(diagnosis()))


def test_the_nights_mail_names_its_error(tmp_path):
    mail = as_mail(morning_of([row(result=fit_result())], [], Survey(), open_store(str(tmp_path))))
    error = fit_result().error
    before, after = (f"{1e3 * one.mean_m:.1f}" for one in (error.train_before, error.train_after))
    assert f"mean distance {before} to {after} mm" in mail


@pytest.mark.parametrize("state", STATE_WORDS)
def test_a_state_has_one_word_in_table_page_and_json(state):
    rows = [row(state)]
    (line,) = csv.DictReader(io.StringIO(as_csv(rows)))
    (fact,) = as_facts(rows)
    assert line["state"] == fact["state"] == STATE_WORDS[state]
    assert f">{STATE_WORDS[state]}<" in as_html(rows, Plan())


def test_an_interval_that_ends_at_a_bound_is_marked_in_table_and_page():
    first, second, *others = fit_result().parameters
    ends = {"interval_low": first.minimum, "interval_high": first.maximum}
    at_bound = msgspec.structs.replace(first, is_at_bound=True, is_identified=False, **ends)
    inside = msgspec.structs.replace(second, is_at_bound=False)
    rows = [row(result=msgspec.structs.replace(fit_result(), parameters=[at_bound, inside, *others]))]
    (line,) = csv.DictReader(io.StringIO(as_csv(rows)))
    assert (line[f"{first.name}_is_at_bound"], line[f"{second.name}_is_at_bound"]) == ("True", "False")
    assert as_html(rows, Plan()).count(", at its bound</small>") == 1


@pytest.mark.parametrize("method", METHODS)
def test_the_nights_table_has_no_rounding_noise_of_a_bound(method):
    """A search on a log scale ends at exp(log(bound)), which is 999.9999999999998 for 1000."""
    space = Plan(method=method).request().space
    first = fit_result().parameters[0]
    for low, high, is_log in zip(space.minimum.tolist(), space.maximum.tolist(), space.is_log, strict=True):
        ends = [math.exp(math.log(low)), math.exp(math.log(high))] if is_log else [low, high]
        end = msgspec.structs.replace(
            first, fitted=0.1 + 0.2, interval_low=ends[0], interval_high=ends[1], is_identified=True
        )
        rows = [row(result=msgspec.structs.replace(fit_result(), parameters=[end]))]
        (line,) = csv.DictReader(io.StringIO(as_csv(rows)))
        assert [line[f"{first.name}{which}"] for which in ("", "_low", "_high")] == ["0.3", repr(low), repr(high)]


@pytest.mark.parametrize(
    ("check", "sentence"),
    [
        (lambda: FigureOrder(height=170.0).check(6.0),
         r"^--height: nobody is 170 m tall; were centimetres meant\? Give \S+ to \S+ m$"),
        (lambda: FigureOrder(height=1700.0).check(6.0), r"tall; were millimetres meant\?"),
        (lambda: FigureOrder(height=5.6).check(6.0), r"nobody is 5.6 m tall; were feet meant\?"),
        (lambda: FigureOrder(height=2.6).check(6.0), r"nobody is 2.6 m tall; give"),
        (lambda: FigureOrder(speed=4.5).check(6.0), r"^--speed: nobody walks at 4.5 m/s; were kilometres an hour mea"),
        (lambda: FigureOrder().check(6000.0), r"^--seconds: 6000 s is no length .*; were milliseconds meant\? Give "),
        (lambda: check_motion("twist", 6000.0), r"^--seconds: 6000 s is no length .*; were milliseconds meant\? Give "),
        (lambda: check_order(Order(result=a_fit(), thickness=0.5), "usd-physics"),
         r"^--thickness: no fabric is 500 mm thick; were millimetres meant\? Give 1e-05 to 0.02 m, as in 0.0005$"),
        (lambda: check_order(Order(result=a_fit(), thickness=50.0), "usd-physics"),
         r"^--thickness: no fabric is 50000 mm thick; were micrometres meant\? Give 1e-05 to 0.02 m, as in 0.0005$"),
        (lambda: check_mesh(sheet(), 0.0001), r"; the spacing is in metres: 0\.1 for 100 millimetres or 0\.01 for 1 "),
        (lambda: check_mesh(sheet(), 0.00005), r"; the spacing is in metres: 0\.05 for 50 millimetres$"),
        (lambda: check_mesh(sheet(), 0.0013), r"choose a spacing from 0\.0022 m to half of its smaller side$"),
        (lambda: check_mesh(sheet(), 50.0), r"; the spacing is in metres: 0\.05 for 50 millimetres$"),
        (lambda: check_mesh(sheet(), 0.25), r"to half of its smaller side$"),
    ],
)  # fmt: skip
def test_a_typed_number_out_of_its_range_asks_for_the_unit_that_was_probably_meant(check, sentence):
    with pytest.raises(FitError, match=sentence):
        check()


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("--mass", 50), "hangtime: --mass, --side: mass_kg must be above 0 and below 50 (got 50); were grams meant"),
        (("--mass", -1), "hangtime: --mass: no swatch has a side of 0.5 m and a mass of -1 kg"),
        (("--mass", 0.05, "--side", 50), "hangtime: --side: no swatch has a side of 50 m"),
        (("--mass", 0.05, "--markers", 2), "hangtime: --markers: a swatch has too few markers along each side"),
    ],
)
def test_a_refused_swatch_names_its_option(tmp_path, words, option):
    done = hangtime_here("swatch", "s.toml", *words, folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(option), done.stderr
    assert not (tmp_path / "s.toml").exists()
