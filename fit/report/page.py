"""Write the report: one HTML file that contains its style, player and data, without external references."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
from markupsafe import Markup

from fit.errors import FitError
from fit.identification.notes_on_values import notes_beside
from fit.report import answer, sections, terms
from fit.report.motion import ReportMotion
from fit.report.origin import Origin
from fit.report.packing import pack_motions
from fit.report.templating import render
from fit.report.text import instant
from formats.diagnosis_records import Diagnosis
from formats.fit_records import FitResult
from formats.plain_text import first_few
from formats.system_causes import step_to_write
from formats.whole_files import write_whole

PAGE_BUDGET = 1_450_000  # bytes of the whole file: most mail programs send this much without a warning

SECTIONS = (  # anchor, name in the contents, title
    ("gap", "The gap", "The gap"), ("motion", "Motion", "Real against simulated motion"),
    ("errors", "Error over time", "Error over time"), ("parameters", "Parameters", "Fitted parameters"),
    ("camera", "Camera", "The cloth as the camera saw it"),
    ("method", "Mean distance", "Errors as mean distances"), ("effects", "Effects", "Effects considered"),
    ("where", "Where", "Where the gap lies"), ("force", "Missing force", "The missing force"),
    ("next", "Record next", "The next recording"), ("gates", "Checks", "Checks"), ("cost", "Cost", "Cost and notes"),
    ("reading", "How to read this", "How to read this"), ("origin", "Origin", "Where this page comes from"),
)  # fmt: skip


def write_report(
    path: Path | str,
    *,
    fit: FitResult | None,
    diagnosis: Diagnosis | None,
    motions: Sequence[ReportMotion] = (),
    origin: Origin | None = None,
) -> Path:
    """Write the report and return its path; either result may be missing, and so may motions and origin.

    Raises:
        FitError: the file cannot be written there.
    """
    path = Path(path)
    page = render_report(fit=fit, diagnosis=diagnosis, motions=motions, origin=origin)
    try:
        write_whole(path, page.encode())
    except OSError as error:
        raise FitError(
            f"the report cannot be written ({error.strerror})", where=path, advice=step_to_write(error)
        ) from error
    return path


def render_report(
    *,
    fit: FitResult | None,
    diagnosis: Diagnosis | None,
    motions: Sequence[ReportMotion] = (),
    origin: Origin | None = None,
) -> str:
    """Return the report as HTML text; motion fills the rest of the size budget."""
    rest = len(_page(fit, diagnosis, motions, origin, ([], len(motions), "")).encode())
    packed, note = pack_motions(motions, max(PAGE_BUDGET - rest, 0))
    return _page(fit, diagnosis, motions, origin, (packed, len(packed), note))


def _page(
    fit: FitResult | None, diagnosis: Diagnosis | None, motions: Sequence[ReportMotion], origin: Origin | None,
    played: tuple[list[dict[str, Any]], int, str],
) -> str:  # fmt: skip
    packed, shown, note = played
    if fit is not None and diagnosis is not None:
        fit = msgspec.structs.replace(fit, notes=notes_beside(fit, diagnosis))
    outline = next((motion.outline for motion in motions if motion.outline is not None), None)
    parts = {
        "gap": sections.gap(diagnosis),
        "motion": sections.player(motions, shown, note, fit, diagnosis),
        "errors": sections.errors(fit, motions, shown, diagnosis),
        "parameters": sections.parameters(fit, diagnosis),
        "camera": sections.camera(fit, diagnosis),
        "method": sections.method(fit),
        "effects": sections.effects(diagnosis),
        "where": sections.where(diagnosis, outline),
        "force": sections.missing_force(
            diagnosis.missing_force if diagnosis is not None else None,
            outline,
            answer.candidates_of(diagnosis) if diagnosis is not None else (),
        ),
        "next": sections.next_experiment(diagnosis),
        "gates": sections.gates(diagnosis),
        "cost": sections.cost(fit, diagnosis),
        "reading": terms.reading(diagnosis),
        "origin": sections.origin(origin),
    }
    takes = _takes(fit, diagnosis, motions)
    created = next((instant(record.created) for record in (diagnosis, fit) if record is not None), "")
    data = json.dumps(packed, allow_nan=False, separators=(",", ":"))
    return render(
        "page.html",
        takes=takes,
        about=" · ".join(part for part in (takes, created) if part),
        style=Markup(packaged("page.css")),
        answer=answer.verdict(fit, diagnosis, motions),
        parts=[
            {"anchor": anchor, "short": short, "title": title, "body": parts[anchor]}
            for anchor, short, title in SECTIONS
            if parts[anchor]
        ],
        # Inside a script element only "</" and "<!--" would end or bend the data.
        motions=Markup(data.replace("<", "\\u003c")),
        script=Markup(packaged("motion.js") + packaged("page.js")),
    )


def packaged(name: str) -> str:
    """Return a text file of this package."""
    return resources.files("fit.report").joinpath(name).read_text(encoding="utf-8")


def _takes(fit: FitResult | None, diagnosis: Diagnosis | None, motions: Sequence[ReportMotion]) -> str:
    names = next(
        ([*record.take_ids, *record.held_out_ids] for record in (diagnosis, fit) if record is not None),
        [motion.take_id for motion in motions],
    )
    return first_few(names, most=4)
