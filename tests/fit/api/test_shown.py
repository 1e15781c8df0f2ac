"""What the terminal shows of a result."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from fit.api.shown import diagnosis_tables, fit_tables
from fit.api.tables import as_text
from fit.recordings.intact import describe_missing
from tests.fit.report.report_scene import diagnosis, fit_result
from tests.formats.test_archive import a_take


def test_a_fit_and_a_diagnosis_name_the_seconds_that_their_takes_lack():
    """A second is missing in the middle: 2.25 to 3.25 s after the first frame."""
    (note,) = describe_missing([replace(a_take(150), is_complete=False, missing=((2.5, 3.5),))])
    for tables, result in ((fit_tables, fit_result()), (diagnosis_tables, diagnosis())):
        damaged = msgspec.structs.replace(result, notes=["Another note.", note])
        shown = as_text(tables(damaged))
        assert "missing: 2.25 to 3.25 s" in shown
        assert "Another note." not in shown
