"""Rebuild a report from the files of a results folder, without takes and without a simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fit.errors import FitError
from fit.folders import refuse_unfinished
from fit.identification.read_again import load_diagnosed, load_either, load_fit
from fit.report.answer import run_names
from fit.report.kept import created_of, load_motions
from fit.report.motion import ReportMotion, rms_of
from fit.report.page import write_report
from fit.report.plot import draw_plot
from fit.report.text import millimetres
from formats.diagnosis_records import Diagnosis
from formats.fit_records import FitResult
from formats.plain_text import plain
from formats.rows import aligned
from formats.system_causes import step_to_read
from formats.whole_files import loop_words

WHY_LARGER = (
    "Report and diagnosis count free points alone, those that the hanger does not hold. Squares weigh large errors "
    "more, so these figures are larger than the means."
)


@dataclass(frozen=True)
class Results:
    """Results of a folder; a fit of other takes than the diagnosis' is left out, with the reason in `left_out`."""

    fit: FitResult | None
    diagnosis: Diagnosis | None
    left_out: str = ""


def results_in(folder: Path) -> Results:
    """Return the results of a folder.

    Raises:
        HangtimeError: it holds neither a fit nor a diagnosis, or one that cannot be read.
    """
    try:
        is_there = folder.is_dir()
    except OSError as error:
        raise FitError(f"cannot be read ({error.strerror})", where=folder, advice=step_to_read(error)) from error
    if not is_there:
        what = loop_words(folder, "is no folder of results")
        raise FitError(what, where=folder, advice="give the folder that --out named")
    fit_file, diagnosis_file = folder / "fit.json", folder / "diagnosis.json"
    if not (fit_file.exists() or diagnosis_file.exists()):
        refuse_unfinished(fit_file)
        refuse_unfinished(diagnosis_file)
    fit = load_fit(fit_file) if fit_file.exists() else None
    diagnosis = load_diagnosed(diagnosis_file) if diagnosis_file.exists() else None
    if fit is None and diagnosis is None:
        raise FitError(
            "holds neither fit.json nor diagnosis.json", where=folder,
            advice="`hangtime fit` and `hangtime diagnose` write them",
        )  # fmt: skip
    if fit is not None and diagnosis is not None and not _is_together(fit, diagnosis):
        return Results(None, diagnosis, _foreign(fit_file, fit.take_ids, "diagnosis", diagnosis.take_ids))
    return Results(fit, diagnosis)


def _foreign(file: Path, its: list[str], whose: str, others: list[str]) -> str:
    named = f"{', '.join(its)}; the {whose} is of {', '.join(others)}" if its != others else "under the same names"
    return plain(f"{file} is of other takes than the {whose} ({named}): the report leaves out {file.name}.")


def write_again(folder: Path, out: Path | None = None) -> tuple[Path, Results, list[ReportMotion]]:
    """Write the report of a folder's results again; return its path, and the results and the motion that it shows.

    The motion and the origin come from `report.motion.npz`. Without this file the page has neither. If the motion
    belongs to a fit that was made after the diagnosis, the page shows the fit alone, as before.

    Raises:
        HangtimeError: as `results_in`, or a file cannot be read or written.
    """
    found = results_in(folder)
    motions, origin = load_motions(folder / "report.html", created_of(found.fit, found.diagnosis))
    if not motions and found.diagnosis is not None and (folder / "fit.json").exists():
        fit = load_fit(folder / "fit.json")
        is_foreign = not _is_together(fit, found.diagnosis)
        other = folder / "diagnosis.json", found.diagnosis.take_ids, "fit", fit.take_ids
        later = Results(fit, None, _foreign(*other) if is_foreign else "")
        motions, origin = load_motions(folder / "report.html", created_of(later.fit, None))
        found = later if motions else found
    path = out or folder / "report.html"
    write_report(path, fit=found.fit, diagnosis=found.diagnosis, motions=motions, origin=origin)
    return path, found, motions


def plot_of(
    report: Path, fit: FitResult | None, diagnosis: Diagnosis | None, out: Path, *, overwrite: bool = False
) -> None:
    """Draw the errors over time of a newly written report, from its motion file.

    Raises:
        HangtimeError: no motion of these results is stored, or the picture cannot be written.
    """
    motions, _ = load_motions(report, created_of(fit, diagnosis))
    draw_plot(motions, run_names(fit, diagnosis), out, overwrite=overwrite)


def errors_of_report(report: Path, fit: FitResult) -> list[str]:
    """Return lines of a table of the errors that a fit's newly written report shows, before and after the fit.

    Raises:
        HangtimeError: its motion cannot be read.
    """
    motions, _ = load_motions(report, created_of(fit, None))
    rows = []
    for name, is_held_out in (("training", False), ("held out", True)):
        judged = [motion for motion in motions if motion.is_held_out == is_held_out]
        begun, reached = rms_of(judged, "before"), rms_of(judged, "after")
        if reached is not None:
            rows.append((f"as in the report, {name}", millimetres(begun), millimetres(reached)))
    if not rows:
        return []
    return [*aligned([("root mean square of free points", "before", "after"), *rows], right=(1, 2)), WHY_LARGER]


def _is_together(fit: FitResult, diagnosis: Diagnosis) -> bool:
    """Return whether a fit and a diagnosis are of the same takes, by content digests if both have them."""
    if fit.take_contents and diagnosis.take_contents:
        return fit.take_contents == diagnosis.take_contents
    return fit.take_ids == diagnosis.take_ids


def one_of(path: Path, *, is_diagnosis: bool = False) -> FitResult | Diagnosis:
    """Read a result file, or a folder's fit, or the folder's diagnosis if it holds no fit or if this is asked for.

    Raises:
        HangtimeError: the path holds no result, or cannot be read.
    """
    if path.is_dir():
        found = results_in(path)
        result = found.diagnosis or found.fit if is_diagnosis else found.fit or found.diagnosis
        if result is not None:
            return result
    refuse_unfinished(path)
    return load_either(path)
