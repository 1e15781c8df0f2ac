"""A batch's summary page: names of takes, an interrupted run, and its command without options."""

from __future__ import annotations

import re

import pytest

from fit.batch.garments import Seen, diagnoses_of, wardrobe_of
from fit.batch.morning import as_html, as_text, morning_of
from fit.batch.runner import Survey
from fit.batch.store import open_store
from fit.batch.summary import Row, short_name
from tests.fit.here import hangtime_here
from tests.fit.report.report_scene import fit_result


@pytest.mark.parametrize(
    ("name", "short"),
    [
        (f"home/2026-11-26/000002-{'0a' * 32}.mcap", "home/2026-11-26/000002"),
        ("swing.mcap", "swing.mcap"),
        (f"a-{'0a' * 31}.mcap", f"a-{'0a' * 31}.mcap"),
    ],
)
def test_a_synced_take_is_shown_without_its_digest(name, short):
    assert short_name(name) == short


def test_a_batch_fits_as_a_single_fit_does_and_waits_for_ten_minutes_or_not_at_all(tmp_path):
    batch, fit = (" ".join(hangtime_here(one, "--help", folder=tmp_path).stdout.split()) for one in ("batch", "fit"))
    ours, theirs = (re.search(r"--method .*?\[default: (\w[\w-]*)\]", shown)[1] for shown in (batch, fit))
    assert ours == theirs
    assert re.search(r"--patience MINUTES [^\[]*\[default: 10\.0; 0<=x<=10080\.0\]", batch)


def test_the_page_of_an_interrupted_run_is_not_green_and_says_what_is_left(tmp_path):
    """Two takes, one of them not fitted, and a garment that waits; a run that left nothing has a green page."""
    rows = [Row(take=f"{k}.mcap", key=k, state=state, sentence="", result=None) for k, state in
            (("a", "fitted"), ("b", "waiting"))]  # fmt: skip
    kinds = {"a.mcap": "face-on", "b.mcap": "sideways"}
    skirt = wardrobe_of("skirt", [Seen(name=name, digest=name, kind=kind, reach=0.03, seconds=8.0, is_calibrated=True)
                                  for name, kind in kinds.items()])  # fmt: skip
    results = open_store(str(tmp_path))
    page = morning_of(rows, [skirt], diagnoses_of([skirt], open_store("takes"), results, 0), results)
    said = "The run ended early; 1 take is not fitted and 1 garment is not diagnosed; the same command continues."
    assert page.needs == ()
    for shown, nothing in (
        (as_html(page), "<p>Nothing so far.</p>"),
        (as_text(page), "Nothing needs a person so far."),
    ):
        assert said in shown
        assert nothing in shown
        assert "is-good" not in shown.split("</style>")[-1]
    whole = morning_of(rows[:1], [], Survey(), results)
    assert 'class="verdict is-good"' in as_html(whole)
    assert "interrupted" not in as_html(whole) + as_text(whole)


def test_a_take_that_is_left_out_of_a_diagnosis_has_no_verdict(tmp_path):
    lengths = {"a.mcap": 8.0, "b.mcap": 8.0, "short.mcap": 1.0}
    rows = [Row(take=name, key=name, state="known", sentence="", result=fit_result()) for name in lengths]
    skirt = wardrobe_of("skirt", [
        Seen(name=name, digest=name, kind="sideways" if name == "b.mcap" else "face-on", reach=0.03, seconds=seconds,
             is_calibrated=True) for name, seconds in lengths.items()
    ])  # fmt: skip
    results = open_store(str(tmp_path))
    page = morning_of(rows, [skirt], diagnoses_of([skirt], open_store("takes"), results, 0), results)
    assert [line.verdict for line in page.takes] == ["waiting", "waiting", "left out"]
