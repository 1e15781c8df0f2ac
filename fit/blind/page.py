"""HTML page of a blind check, self-contained: rates, confusion, calibration, baselines, every case."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from fit.blind.rates import Rate
from fit.blind.scoring import HEADLINE_BIN, Rates, Score, headline, load_score
from fit.errors import FitError
from formats.system_causes import step_to_write
from formats.templating import environment
from formats.whole_files import write_whole

# Targets for our own generator at 2 to 4 times the minimum detectable amplitude; nulls and unknowns have no amplitude.
TARGET_RATES = (
    ("false alarms on nulls", "false_alarms", "at most 5 %"),
    ("right group first", "right_first", "at least 90 %"),
    ("right effect, alone", "right_alone", ""),
    ("right group among the first three", "right_in_three", "at least 97 %"),
    ("`unknown` where no library effect is at work", "said_unknown", "at least 85 %"),
    ("confident and wrong", "confident_and_wrong", "at most 2 %"),
    ("pairs: one of the two named", "pair_one_named", ""),
    ("pairs: both named", "pair_both_named", ""),
    ("closure, median", "closure", ""),
    ("closure against the refitted true effect, mean", "closure_against_oracle", "at least 0.92"),
    ("amplitude, median relative error", "amplitude_error", "at most 0.12"),
    ("amplitude within the 90 % interval", "amplitude_covered", "85 to 95 %"),
    ("place found, local effects", "place_found", "at least 90 %"),
    ("Brier score", "brier", "at most 0.12"),
    ("Brier score over groups", "brier_of_groups", ""),
    ("simulations a take, median", "simulations", ""),
    ("simulations a take, most", "simulations_most", "at most 400"),
    ("seconds a case, median", "seconds", ""),
    ("seconds a case, most", "seconds_most", "at most 180"),
)
Table = tuple[list[Any], list[list[Any]]]  # column heads, and the cells of each row
# figures from here on are written without decimals. Our choice: a decimal would be below a tenth of the shown figure.
LARGE = 10.0


def check_page_name(out: Path, folders: tuple[Path, Path]) -> None:
    """Refuse an output path that names a file of the set or of its answers, in any spelling.

    Raises:
        FitError: the page would lie among them, other than as an .html file beside them.
    """
    # `Path.resolve` fails on a link to itself, without a clear message.
    place, *known = (Path(os.path.realpath(path)) for path in (out, *folders))
    is_among = any(folder in place.parents for folder in known)
    if is_among and not (place.parent in known and place.suffix == ".html"):
        raise FitError(
            "belongs to the set or its answers, which no page may replace", where=out,
            advice="choose another --out, for example blind.html",
        )  # fmt: skip


def write_page(answers: Path, out: Path) -> Path:
    """Write the page of scored answers.

    Raises:
        FitError: the answers are not scored, or the file cannot be written there.
    """
    score = load_score(answers)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(out, render(score).encode())
    except OSError as error:
        raise FitError(f"cannot be written ({error.strerror})", where=out, advice=step_to_write(error)) from error
    return out


def render(score: Score) -> str:
    """Return the HTML of a scored check."""
    template = environment("fit.blind", ".", trims_lines=True).get_template("page.html.j2")
    page = template.render(
        score=score, headline=headline(score), headline_bin=HEADLINE_BIN, rates=_rates(score), ladders=_ladders(score),
        confusion=_counts(score.confusion, "planted"), verdicts=_counts(score.verdicts, "kind of case"),
        marks=_marks(score), baselines=_baselines(score), cases=_cases(score),
    )  # fmt: skip
    return f"{page}\n"


def figure(rates: Rates, name: str) -> str:
    """Return one rate as text, a dash if no case allows it."""
    value = getattr(rates, name)
    if isinstance(value, Rate):
        return str(value) if value.n else "–"
    return "–" if value is None else f"{value:.2f}" if value < LARGE else f"{value:.0f}"


def _rates(score: Score) -> Table:
    """Return the rates, overall and by size; column heads with the number of cases."""
    sizes = {"all": score.overall, **score.by_size}
    heads = ["", "asked", *({"name": name, "cases": rates.cases} for name, rates in sizes.items())]
    return heads, [[title, asked, *(figure(r, name) for r in sizes.values())] for title, name, asked in TARGET_RATES]


def _ladders(score: Score) -> Table:
    """Return the rates by noise, points, frame rate and missing points."""
    shown = [
        row for row in TARGET_RATES if row[1] in {"false_alarms", "right_first", "said_unknown", "amplitude_error"}
    ]
    return ["", "cases", *(title for title, _, _ in shown)], [
        [f"{name}: {step}", rates.cases, *(figure(rates, key) for _, key, _ in shown)]
        for name, steps in score.by_condition.items()
        for step, rates in steps.items()
    ]


def _counts(table: dict[str, dict[str, int]], corner: str) -> dict[str, Any]:
    """Return counts by two names, each with the strength of its colour."""
    columns = sorted({c for row in table.values() for c in row})
    most = max((n for row in table.values() for n in row.values()), default=1)
    rows = [(name, [(f"{0.65 * row.get(c, 0) / most:.2f}", row.get(c, "")) for c in columns])
            for name, row in table.items()]  # fmt: skip
    return {"corner": corner, "columns": columns, "rows": rows}


def _marks(score: Score) -> list[tuple[str, str, str]] | None:
    """Return circles, x, y and radius, of the share of right names over the stated probability, in fifths."""
    given = [(j.probability, not _is_wrong(j.named, j.planted)) for j in score.cases if j.probability is not None]
    if not given:
        return None
    stated, right = np.array([p for p, _ in given]), np.array([r for _, r in given])
    marks = []
    for low in np.arange(0, 1, 0.2):
        inside = (stated >= low) & ((stated < low + 0.2) | (low > 0.7))
        if inside.any():
            x, y = 100 * stated[inside].mean(), 100 - 100 * right[inside].mean()
            marks.append((f"{x:.1f}", f"{y:.1f}", f"{1 + np.sqrt(inside.sum()):.1f}"))
    return marks


def _is_wrong(named: tuple[str, ...], planted: tuple[str, ...]) -> bool:
    return not set(named) & set(planted)


def _baselines(score: Score) -> list[tuple[str, str]]:
    own = [
        ("the diagnosis, right group first", str(score.overall.right_first)),
        ("chance", f"{100 * score.chance:.0f} %"),
    ]
    return own + [(name, str(rate)) for name, rate in score.baselines.items()]


def _cases(score: Score) -> Table:
    return ["case", "kind", "planted", "amplitude", "over detectable", "verdict", "named"], [
        [
            j.id, j.kind, ", ".join(j.planted), "" if j.amplitude is None else f"{j.amplitude:.3g}",
            "" if j.ratio is None else f"{j.ratio:.1f}", j.verdict, ", ".join(j.named),
        ]
        for j in sorted(score.cases, key=lambda j: (j.kind, j.planted))
    ]  # fmt: skip
