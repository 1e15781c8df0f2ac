"""Write the report: one HTML file with its style, its player and its data inside, and nothing from outside."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from markupsafe import Markup

from fit.errors import FitError
from fit.report import answer, sections
from fit.report.motion import ReportMotion, pack_motions
from fit.report.templating import render
from formats.diagnosis_records import Diagnosis
from formats.fit_records import FitResult
from formats.whole_files import write_whole

MOTION_BUDGET = 1_700_000  # bytes of it for motion

SECTIONS = (  # anchor, name in the contents, title
    ("gap", "The gap", "The gap"), ("motion", "Motion", "Real against simulated motion"),
    ("errors", "Error over time", "Error over time"), ("parameters", "Parameters", "Fitted parameters"),
    ("camera", "Camera", "What the camera made of the cloth"),
    ("method", "Before and after", "Before and after"), ("effects", "Effects", "Effects considered"),
    ("where", "Where", "Where the gap lies"), ("force", "Missing force", "What the missing force looks like"),
    ("next", "Record next", "What to record next"), ("gates", "Checks", "Checks"), ("cost", "Cost", "Cost and origin"),
    ("reading", "How to read this", "How to read this"),
)  # fmt: skip


def write_report(
    path: Path | str,
    *,
    fit: FitResult | None,
    diagnosis: Diagnosis | None,
    motions: Sequence[ReportMotion] = (),
) -> Path:
    """Write the report and return its path; either result may be missing, and so may the motions.

    Raises:
        FitError: the file cannot be written there.
    """
    path = Path(path)
    page = render_report(fit=fit, diagnosis=diagnosis, motions=motions)
    try:
        write_whole(path, page.encode())
    except OSError as error:
        raise FitError(
            f"the report cannot be written ({error.strerror})", where=path, advice="choose another folder"
        ) from error
    return path


def render_report(*, fit: FitResult | None, diagnosis: Diagnosis | None, motions: Sequence[ReportMotion] = ()) -> str:
    """Return the report as HTML text."""
    packed, note = pack_motions(motions, MOTION_BUDGET)
    shown = len(packed)
    parts = {
        "gap": sections.gap(diagnosis),
        "motion": sections.player(motions, shown, note),
        "errors": sections.errors(fit, motions, shown),
        "parameters": sections.parameters(fit, diagnosis),
        "camera": sections.camera(fit, diagnosis),
        "method": sections.method(fit),
        "effects": sections.effects(diagnosis),
        "where": sections.where(diagnosis),
        "force": sections.missing_force(diagnosis.missing_force if diagnosis is not None else None),
        "next": sections.next_experiment(diagnosis),
        "gates": sections.gates(diagnosis),
        "cost": sections.cost(fit, diagnosis),
        "reading": sections.reading(),
    }
    takes = _takes(fit, diagnosis, motions)
    created = next((record.created for record in (diagnosis, fit) if record is not None), "")
    data = json.dumps(packed, allow_nan=False, separators=(",", ":"))
    return render(
        "page.html",
        takes=takes,
        about=" · ".join(part for part in (takes, created) if part),
        style=Markup(_packaged("page.css")),
        answer=answer.verdict(fit, diagnosis),
        parts=[
            {"anchor": anchor, "short": short, "title": title, "body": parts[anchor]}
            for anchor, short, title in SECTIONS
            if parts[anchor]
        ],
        # Inside a script element only "</" and "<!--" would end or bend the data.
        motions=Markup(data.replace("<", "\\u003c")),
        script=Markup(_packaged("page.js")),
    )


def _packaged(name: str) -> str:
    return resources.files("fit.report").joinpath(name).read_text(encoding="utf-8")


def _takes(fit: FitResult | None, diagnosis: Diagnosis | None, motions: Sequence[ReportMotion]) -> str:
    names = next(
        ([*record.take_ids, *record.held_out_ids] for record in (diagnosis, fit) if record is not None),
        [motion.take_id for motion in motions],
    )
    few = ", ".join(names[:4])
    return f"{few} and {len(names) - 4} more" if len(names) > 4 else few
