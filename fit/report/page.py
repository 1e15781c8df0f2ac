"""Write the report: one HTML file with its style, its player and its data inside, and nothing from outside."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from string import Template

from fit.errors import FitError
from fit.report import answer, sections
from fit.report.motion import ReportMotion, pack_motions
from fit.report.text import escaped
from formats.results import Diagnosis, FitResult
from formats.whole_files import write_whole

MOTION_BUDGET = 1_700_000  # bytes of it for motion

CONTENTS = (
    ("gap", "The gap"), ("motion", "Motion"), ("errors", "Error over time"), ("parameters", "Parameters"),
    ("method", "Before and after"),
    ("effects", "Effects"), ("where", "Where"), ("force", "Missing force"), ("gates", "Checks"),
    ("next", "Record next"), ("cost", "Cost"), ("reading", "How to read this"),
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
        "method": sections.method(fit),
        "effects": sections.effects(diagnosis),
        "where": sections.where(diagnosis),
        "force": sections.missing_force(diagnosis.missing_force if diagnosis is not None else None),
        "next": sections.next_experiment(diagnosis),
        "gates": sections.gates(diagnosis),
        "cost": sections.cost(fit, diagnosis),
        "reading": sections.reading(),
    }
    links = "".join(f'<li><a href="#{anchor}">{title}</a></li>' for anchor, title in CONTENTS if parts[anchor])
    contents = f'<nav class="contents" aria-label="Contents"><ul>{links}</ul></nav>'
    takes = _takes(fit, diagnosis, motions)
    created = next((record.created for record in (diagnosis, fit) if record is not None), "")
    data = json.dumps(packed, allow_nan=False, separators=(",", ":"))
    return Template(_packaged("page.html")).substitute(
        title=escaped(f"Hangtime report: {takes}"),
        about=escaped(" · ".join(part for part in (takes, created) if part)),
        style=_packaged("page.css"),
        body=answer.verdict(fit, diagnosis) + contents + "".join(parts.values()),
        foot="Made by Hangtime. This file holds everything it shows and asks nothing of the network.",
        # Inside a script element only "</" and "<!--" would end or bend the data.
        motions=data.replace("<", "\\u003c"),
        script=_packaged("page.js"),
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
