"""Rows, figures and advice of a batch's table and morning page, each from made-up results."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import pytest

from fit.batch.garments import Seen, Wardrobe, wardrobe_of
from fit.batch.jobs import Outcome, diagnosis_name, report_name, result_name
from fit.batch.kept import keep
from fit.batch.morning import as_html as as_html_of_morning
from fit.batch.morning import as_text, morning_of, write_morning
from fit.batch.runner import Survey
from fit.batch.store import open_store
from fit.batch.summary import Row, as_csv, as_html, rows_of, sentence_of, write_summary
from fit.identification.request import Plan
from formats.diagnosis_records import NextExperiment
from formats.results import result_bytes
from tests.fit.report.report_scene import diagnosis, fit_result

PLAN = Plan(method="kinect-skirt", iterations=8, spacing=0.1)


def row_of(take, state="fitted", *, after=None, parameters=None, sentence="", simulations=None):
    result = fit_result() if state in ("fitted", "known") else None
    if result and after is not None:
        figure = msgspec.structs.replace(result.error.train_after, mean_m=after)
        result = msgspec.structs.replace(result, error=msgspec.structs.replace(result.error, train_after=figure))
    if result and parameters is not None:
        result = msgspec.structs.replace(result, parameters=parameters)
    if result and simulations is not None:
        result = msgspec.structs.replace(result, simulations=simulations)
    return Row(take=take, key=f"key-{take}", state=state, sentence=sentence, result=result)


def test_a_table_has_a_column_for_every_parameter_and_gaps_where_a_take_has_none_of_it():
    one, two, *_ = fit_result().parameters
    one = msgspec.structs.replace(one, is_identified=True, fitted=2.0, interval_low=1.5, interval_high=2.5)
    two = msgspec.structs.replace(two, is_identified=False, fitted=9.0, interval_low=7.0, interval_high=8.0)
    rows = [row_of("a", parameters=[one], after=0.0123), row_of("b", "failed", sentence="is cut off"),
            row_of("c", parameters=[two])]  # fmt: skip
    first, failed, last = csv.DictReader(io.StringIO(as_csv(rows)))
    names = [f"{name}{end}" for name in (one.name, two.name) for end in ("", "_low", "_high", "_is_identified")]
    assert [first[name] for name in names] == ["2.0", "1.5", "2.5", "True", "", "", "", ""]
    assert [last[name] for name in names] == ["", "", "", "", "", "7.0", "8.0", "False"]
    assert {failed[name] for name in (*names, "take_id", "error_before_mm", "seconds")} == {""}
    assert (failed["take"], failed["state"], failed["remark"], failed["key"]) == ("b", "failed", "is cut off", "key-b")
    result = rows[0].result
    assert first["take_id"] == " ".join(result.take_ids)
    assert (first["error_before_mm"], first["error_after_mm"]) == (
        f"{1e3 * result.error.train_before.mean_m:.3f}", "12.300"
    )  # fmt: skip
    assert (first["simulations"], first["seconds"]) == (str(result.simulations), f"{result.seconds:.1f}")


def test_on_a_phone_each_value_stands_behind_the_name_of_its_column():
    """There the page hides the row of heads (`page.css`), and shows `data-head` before each cell."""
    mass = msgspec.structs.replace(fit_result().parameters[0], name="mass", unit="kg")
    drag = msgspec.structs.replace(mass, name="air_drag", unit="1")
    page = as_html([row_of("a", parameters=[mass, drag]), row_of("b", "waiting")], PLAN)
    fitted, waiting = re.findall('<tr><th scope="row">.*?</tr>', page, re.DOTALL)[::-1]
    heads = [re.findall('<td[^>]*?(?: data-head="(.*?)")?>', row) for row in (fitted, waiting)]
    assert heads[0] == [
        "state", "error before", "error after", "mass (kg)", "air drag", "simulations", "time", "remark",
    ]  # fmt: skip
    assert heads[1] == ["state", "remark"]


def test_on_a_phone_each_value_of_the_morning_page_stands_behind_the_name_of_its_column(tmp_path):
    rows = [row_of("a.mcap", after=0.01), row_of("f.mcap", "failed", sentence="is cut off")]
    morning, _ = morning_with(tmp_path, rows=rows)
    page = as_html_of_morning(morning)
    fitted, failed = re.findall('<tr><th scope="row">.*?</tr>', page, re.DOTALL)
    assert re.findall('data-head="(.*?)"', fitted) == [
        "garment", "motion", "state", "error before", "error after", "verdict", "remark",
    ]  # fmt: skip
    assert re.findall('data-head="(.*?)"', failed) == ["state", "remark"]


def test_a_page_lists_what_needs_attention_first_and_then_the_largest_error():
    rows = [row_of("small", after=0.001), row_of("large", after=0.02), row_of("w", "waiting"), row_of("r", "refused"),
            row_of("known", "known", after=0.01), row_of("f", "failed")]  # fmt: skip
    page = as_html(rows, PLAN)
    places = [page.index(f">{name}<") for name in ("f", "r", "w", "large", "known", "small")]
    assert places == sorted(places)
    assert "mesh 100 mm, seed 0" in page
    assert "20.0" in page
    assert 'href="fits/key-large.json"' in page
    assert sentence_of(rows[:1]) == "1 take: 1 fitted."
    assert sentence_of(rows) == "6 takes: 2 fitted, 1 fitted before, 1 failed, 1 not fitted, 1 waiting."


@pytest.mark.parametrize(
    ("search", "counts", "says"),
    [
        ("annealing", [5], "350 iterations, mesh"),
        ("cma-es", [5], "350 candidates, mesh"),
        ("tempering", [5], "350 candidates, mesh"),
        ("short-windows", [12, 7, 30], "search short-windows, 7 to 30 simulations a take, mesh"),
        ("short-windows", [7, 7], "search short-windows, 7 simulations a take, mesh"),
        ("short-windows", [], "search short-windows, mesh"),
    ],
)
def test_a_page_says_what_its_search_cost(search, counts, says):
    rows = [row_of(str(k), simulations=count) for k, count in enumerate(counts)]
    assert says in as_html(rows, Plan(search=search))


def test_a_result_that_cannot_be_read_back_is_no_fit(tmp_path):
    results = open_store(str(tmp_path))
    keep(results, result_name("k"), result_bytes(fit_result(), tmp_path / "k"))
    found = Survey(keys={"a": "k", "b": "gone", "c": "new"},
                   outcomes={key: Outcome(key=key, state="known", sentence="") for key in ("k", "gone")})  # fmt: skip
    rows = rows_of(found, results)
    assert [row.state for row in rows] == ["known", "refused", "waiting"]
    assert rows[0].result == fit_result()
    assert "its result cannot be read: " in rows[1].sentence
    write_summary(rows, results, PLAN)
    assert results.read("summary.csv").decode() == as_csv(rows)
    assert b"3 takes: 1 fitted before, 1 not fitted, 1 waiting." in results.read("summary.html")


# --- the morning page -----------------------------------------------------------------------------


def seen(name, kind="face-on"):
    return Seen(name=name, digest=name, kind=kind, reach=0.03, seconds=8.0, is_calibrated=True)


def morning_with(folder, *, rows=(), state="diagnosed", sentence="", **changes):
    """The page of one skirt, diagnosed or not, and the store of results."""
    results, skirt = open_store(str(folder)), wardrobe_of("skirt", [seen("a.mcap"), seen("b.mcap", "sideways")])
    found = Survey(keys={"skirt": "k"}, outcomes={"k": Outcome(key="k", state=state, sentence=sentence)})
    if state == "diagnosed":
        kept = msgspec.structs.replace(diagnosis(), **changes)
        keep(results, diagnosis_name("k"), result_bytes(kept, folder / "k"))
    return morning_of(rows, [skirt], found, results), results


@pytest.mark.parametrize(
    ("verdict", "advice"),
    [
        ("ambiguous", "record the motion that the report proposes"),
        ("unknown", "no effect of the library explains the gap"),
        ("numerics", "diagnose it alone on a finer mesh"),
        ("inconclusive", "look at the checks that failed"),
        ("none", None),
    ],
)
def test_each_verdict_that_settles_nothing_has_its_own_advice_unless_a_motion_is_proposed(tmp_path, verdict, advice):
    page, _ = morning_with(tmp_path, verdict=verdict, named=[], next_experiment=None, alternatives={})
    assert [(who, advice in what) for who, what in page.needs] == ([("skirt", True)] if advice else [])
    proposed = diagnosis().next_experiment
    assert isinstance(proposed, NextExperiment)
    page, _ = morning_with(tmp_path, verdict=verdict, named=[], next_experiment=proposed, alternatives={})
    assert page.needs == ((("skirt", proposed.sentence),) if advice else ())


def test_the_text_names_each_finding_its_takes_its_report_and_each_take(tmp_path):
    rows = [row_of("a.mcap", after=0.0041), row_of("x.mcap", "failed", sentence="is cut off")]
    page, results = morning_with(tmp_path, rows=rows)
    text = as_text(page)
    before = f"{1e3 * rows[0].result.error.train_before.mean_m:.1f}"
    assert f"skirt: {diagnosis().verdict}\n  {diagnosis().sentence}\n" in text
    assert "  Fitted to a.mcap; judged on b.mcap.\n" in text
    assert f"  {diagnosis().next_experiment.sentence}\n  Report: {report_name('k')}\n" in text
    error = f"mean distance {before} to 4.1 mm"
    assert text.endswith(f"\n\na.mcap  fitted  skirt  face-on  {error}\nx.mcap  failed  is cut off\n")
    assert "A person is needed for:\n- x.mcap: is cut off\n" in text
    known, unknown = page.takes
    assert (known.verdict, known.link) == (diagnosis().verdict, result_name("key-a.mcap"))
    assert (unknown.garment, unknown.motion, unknown.verdict, unknown.link) == ("", "", "", "")
    write_morning(page, results)
    assert results.read("morning.txt").decode() == text
    assert results.read("morning.html").startswith(b"<!doctype html>")


@pytest.mark.parametrize("state", ["failed", "refused"])
def test_a_garment_whose_diagnosis_ended_in_vain_needs_a_person_and_gives_its_takes_that_state(tmp_path, state):
    page, _ = morning_with(tmp_path, rows=[row_of("a.mcap")], state=state, sentence="no memory")
    assert page.needs == (("skirt", "no memory"),)
    assert page.takes[0].verdict == {"failed": "failed", "refused": "not fitted"}[state]
    assert page.headline == "1 take: 1 fitted. 1 garment: 0 diagnosed."
    assert page.stopped == ""


def test_a_diagnosis_that_cannot_be_read_back_is_no_verdict(tmp_path):
    page, results = morning_with(tmp_path)
    results.path(diagnosis_name("k")).write_bytes(b"{")
    found = Survey(keys={"skirt": "k"}, outcomes={"k": Outcome(key="k", state="diagnosed")})
    (finding,) = morning_of([], [page.findings[0].wardrobe], found, results).findings
    assert (finding.state, finding.verdict) == ("refused", "")
    assert finding.sentence.startswith("The diagnosis cannot be read: ")


def test_two_takes_and_two_garments_that_wait_are_counted_together(tmp_path):
    waiting = [Wardrobe(name=name, takes=()) for name in ("skirt", "shirt")]
    found = SimpleNamespace(keys={"skirt": "k", "shirt": "l"}, outcomes={})
    page = morning_of([row_of("a", "waiting"), row_of("b", "waiting")], waiting, found, open_store(str(tmp_path)))
    assert page.stopped == (
        "The run ended early; 2 takes are not fitted and 2 garments are not diagnosed; the same command continues."
    )
    assert page.headline == "2 takes: 2 waiting. 2 garments: 0 diagnosed."
    only = morning_of([replace(row_of("a"), state="waiting")], [], found, open_store(str(tmp_path)))
    assert only.stopped == "The run ended early; 1 take is not fitted; the same command continues."
