"""`hangtime blind`: make sealed cases, run the diagnosis on them, score the answers, report."""

from __future__ import annotations

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from fit.blind.scoring import Answer, Score

app = typer.Typer(no_args_is_help=True, help="Check the diagnosis on cases whose cause is sealed.")

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the cases.", show_default=False)]
Answers = Annotated[Path, typer.Argument(metavar="ANSWERS", help="Folder of the answers.", show_default=False)]


@app.command()
def make(
    folder: Folder,
    cases: Annotated[int, typer.Option("--cases", min=0, help="Cases with one effect.")] = 23,
    nulls: Annotated[int, typer.Option("--nulls", min=0, help="Cases without any effect.")] = 10,
    pairs: Annotated[int, typer.Option("--pairs", min=0, help="Cases with two effects.")] = 0,
    strangers: Annotated[int, typer.Option("--strangers", min=0, help="Cases with an effect of no library.")] = 3,
    seed: Annotated[int, typer.Option("--seed", help="Seed of everything but the key.")] = 0,
) -> None:
    """Simulate cases with a generator that shares no code with the diagnosis, and seal what is planted in them.

    Interrupted, the same command goes on where it was.
    """
    import numpy as np

    from fit.blind.collection import draw_labels
    from fit.blind.collection import make as make_collection
    from fit.cli import ProgressLine

    line = ProgressLine("cases")
    labels = draw_labels(cases, nulls, pairs, strangers, np.random.default_rng([seed, 0]))
    make_collection(
        folder, labels, seed, lambda done, total, case: line.show(done / max(total, 1), f"{done}/{total} {case}")
    )
    line.end()
    manifest = json.loads((folder / "manifest.json").read_text())
    typer.echo(
        f"{len(manifest['cases'])} cases in {folder / 'cases'}; labels sealed, SHA-256 {manifest['labels_sha256']}"
    )


@app.command()
def run(
    folder: Folder,
    answers: Answers,
    spacing: Annotated[
        float | None, typer.Option("--spacing", metavar="METRES", help="Mesh spacing of the diagnosis.")
    ] = None,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Diagnoses at a time.")] = 1,
) -> None:
    """Diagnose every case that has no answer yet; the same command goes on after an interruption."""
    from fit.blind.collection import run as run_collection
    from fit.cli import ProgressLine

    line = ProgressLine("diagnoses")
    options = [] if spacing is None else ["--spacing", str(spacing)]
    run_collection(
        folder,
        answers,
        lambda done, total, case: line.show(done / max(total, 1), f"{done}/{total} {case}"),
        options,
        workers,
    )
    line.end()
    typer.echo(f"Answers in {answers}")


@app.command()
def score(folder: Folder, answers: Answers) -> None:
    """Hash the answers, open the seal, print every rate with its interval. Each opening is noted in DIR/looks.jsonl."""
    found, _, hashes = _open(folder, answers)
    for name, rate in found.rates.items():
        typer.echo(f"{name:<62} {rate}")
    for name, value in found.figures.items():
        typer.echo(f"{name:<62} {value:.3f}")
    typer.echo("\n".join(["Missed:", *found.misses]) if found.misses else "Nothing missed.")
    record = {
        "rates": {n.strip(): [r.hits, r.total] for n, r in found.rates.items()}, "figures": found.figures,
        "misses": found.misses, **hashes,
    }  # fmt: skip
    (answers / "score.json").write_text(json.dumps(record, indent=1) + "\n")


@app.command()
def report(
    folder: Folder,
    answers: Answers,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The page.")] = Path("blind.html"),
) -> None:
    """Write rates, baselines, confusion matrix and misses as one HTML page."""
    from fit.blind.page import baselines_of, write_page

    found, listed, hashes = _open(folder, answers)
    out.write_text(write_page(found, listed, baselines_of(listed), hashes))
    typer.echo(f"Report: {out}")


def _open(folder: Path, answers: Path) -> tuple[Score, list[Answer], dict[str, str]]:
    """Hash the answers, then open the seal and score."""
    from fit.blind.collection import case_ids, open_labels
    from fit.blind.scoring import Answer
    from fit.blind.scoring import score as score_answers
    from fit.errors import FitError
    from formats.results import load_diagnosis

    cases = case_ids(folder)
    missing = [c for c in cases if not any((answers / c / n).exists() for n in ("diagnosis.json", "failed.txt"))]
    if missing:
        raise FitError(
            f"{len(missing)} of {len(cases)} cases have no answer",
            where=answers,
            advice="run `hangtime blind run` first",
        )
    digest = hashlib.sha256()
    said = {}
    for case in cases:
        path = answers / case / "diagnosis.json"
        said[case] = load_diagnosis(path) if path.exists() else None
        digest.update(path.read_bytes() if path.exists() else b"failed")
    labels = open_labels(folder)
    listed = [Answer(case, labels[case], said[case]) for case in cases]
    found = score_answers(listed)
    manifest = json.loads((folder / "manifest.json").read_text())
    hashes = {"answers_sha256": digest.hexdigest(), "labels_sha256": str(manifest["labels_sha256"])}
    look = {"time": datetime.now(UTC).isoformat(timespec="seconds"), **hashes}
    with (folder / "looks.jsonl").open("a") as file:
        file.write(json.dumps(look) + "\n")
    return found, listed, hashes
