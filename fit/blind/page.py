"""The blind check as one HTML file with nothing from outside: rates, confusion, calibration, baselines, every case."""

from __future__ import annotations

from html import escape
from pathlib import Path

import numpy as np

from fit.blind.rates import Rate
from fit.blind.scoring import HEADLINE_BIN, Rates, Score, headline, load_score
from fit.errors import FitError
from formats.whole_files import write_whole

# Asked of the own generator at 2 to 4 times the minimum detectable amplitude; null and unknown cases have no amplitude.
ROWS = (
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
LARGE = 10.0  # figures from here on are written without decimals
STYLE = """
:root { color-scheme: light dark; --line: #8886; --bar: #1f63b5; }
body { font: 1rem/1.5 system-ui, sans-serif; max-width: 75rem; margin: 1.5rem auto; padding: 0 1rem;
  font-variant-numeric: tabular-nums; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: .9rem; }
th, td { border-bottom: 1px solid var(--line); padding: .25rem .6rem; text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; } thead th { vertical-align: bottom; }
.turned { writing-mode: vertical-rl; transform: rotate(180deg); text-align: left; font-weight: 500; }
small, .soft { color: GrayText; } svg { max-width: 26rem; width: 100%; }
"""


def check_page_name(out: Path, folders: tuple[Path, Path]) -> None:
    """Refuse the name of a file of the set or of its answers in any spelling.

    Raises:
        FitError: the page would lie among them, other than as an .html file beside them.
    """
    place = out.resolve()
    known = [folder.resolve() for folder in folders]
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
        raise FitError(f"cannot be written ({error.strerror})", where=out, advice="choose another --out") from error
    return out


def render(score: Score) -> str:
    """Return the page."""
    parts = [
        f"<h1>Blind check: {len(score.cases)} cases</h1><p>{escape(headline(score))}</p>",
        f"<p class=soft>Scored {score.created}; opening {score.look} of this seal. Labels {score.sealed[:16]}…, "
        f"answers {score.answers[:16]}… (SHA-256).</p>",
        "".join(f"<p>{escape(note)}</p>" for note in score.notes),
        "<h2>Rates</h2><p>Single effects and pairs also by true amplitude over the smallest one that the diagnosis "
        f"says it could detect, pairs by the smaller of both; what is asked holds for {HEADLINE_BIN}. Brackets: 95 % "
        "Wilson intervals.</p>",
        rates_table(score),
        "<h2>By what the sensor gives</h2>", _ladders(score),
        "<h2>Planted against named first</h2>", _counts(score.confusion, "planted"),
        "<h2>Verdicts</h2>", _counts(score.verdicts, "kind of case"),
        "<h2>Calibration</h2>", _calibration(score),
        "<h2>Baselines</h2>", _baselines(score),
        "<h2>Every case</h2>", _cases(score),
    ]  # fmt: skip
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>Blind check</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{STYLE}</style></head><body>{''.join(parts)}</body></html>\n"
    )


def figure(rates: Rates, name: str) -> str:
    """Return one figure of some rates in words, a dash where no case allows it."""
    value = getattr(rates, name)
    if isinstance(value, Rate):
        return str(value) if value.n else "–"
    return "–" if value is None else f"{value:.2f}" if value < LARGE else f"{value:.0f}"


def rates_table(score: Score) -> str:
    """Return the table of rates: overall and by size."""
    head = "".join(f"<th>{escape(name)}<br><small>{r.cases} cases</small></th>" for name, r in score.by_size.items())
    body = "".join(
        f"<tr><td>{escape(title)}</td><td>{asked}</td><td>{figure(score.overall, name)}</td>"
        + "".join(f"<td>{figure(r, name)}</td>" for r in score.by_size.values())
        + "</tr>"
        for title, name, asked in ROWS
    )
    return (
        f"<div class=scroll><table><thead><tr><th></th><th>asked</th><th>all<br><small>{score.overall.cases} cases"
        f"</small></th>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _ladders(score: Score) -> str:
    """The rates that depend most on data, by noise, points, frames and missing points."""
    shown = [row for row in ROWS if row[1] in {"false_alarms", "right_first", "said_unknown", "amplitude_error"}]
    head = "".join(f"<th>{escape(title)}</th>" for title, _, _ in shown)
    body = "".join(
        f"<tr><td>{escape(f'{name}: {step}')}</td><td>{rates.cases}</td>"
        + "".join(f"<td>{figure(rates, key)}</td>" for _, key, _ in shown)
        + "</tr>"
        for name, steps in score.by_condition.items()
        for step, rates in steps.items()
    )
    return (
        f"<div class=scroll><table><thead><tr><th></th><th>cases</th>{head}</tr></thead><tbody>{body}</tbody>"
        "</table></div>"
    )


def _counts(table: dict[str, dict[str, int]], corner: str) -> str:
    columns = sorted({c for row in table.values() for c in row})
    most = max((n for row in table.values() for n in row.values()), default=1)
    head = "".join(f'<th><span class="turned">{escape(c)}</span></th>' for c in columns)
    body = ""
    for name, row in table.items():
        cells = "".join(
            f'<td style="background:rgb(31 99 181/{0.65 * row.get(c, 0) / most:.2f})">{row.get(c, "")}</td>'
            for c in columns
        )
        body += f"<tr><td>{escape(name)}</td>{cells}</tr>"
    return (
        f"<div class=scroll><table><thead><tr><th>{escape(corner)}</th>{head}</tr></thead><tbody>{body}</tbody>"
        "</table></div>"
    )


def _calibration(score: Score) -> str:
    """Share of right names against stated probability, in fifths."""
    given = [(j.probability, not _is_wrong(j.named, j.planted)) for j in score.cases if j.probability is not None]
    if not given:
        return "<p>The diagnosis gives no probabilities yet, so there is nothing to calibrate.</p>"
    stated, right = np.array([p for p, _ in given]), np.array([r for _, r in given])
    marks = ""
    for low in np.arange(0, 1, 0.2):
        inside = (stated >= low) & ((stated < low + 0.2) | (low > 0.7))
        if inside.any():
            x, y = 100 * stated[inside].mean(), 100 - 100 * right[inside].mean()
            marks += f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{1 + np.sqrt(inside.sum()):.1f}" fill="var(--bar)"/>'
    return (
        '<svg viewBox="-8 -4 116 116" role="img" aria-label="share of right names against stated probability">'
        '<rect width="100" height="100" fill="none" stroke="currentColor" stroke-width=".5"/>'
        '<line x1="0" y1="100" x2="100" y2="0" stroke="currentColor" stroke-dasharray="2"/>'
        f'{marks}<text x="50" y="109" font-size="6" text-anchor="middle" fill="currentColor">stated probability</text>'
        "</svg>"
    )


def _is_wrong(named: tuple[str, ...], planted: tuple[str, ...]) -> bool:
    return not set(named) & set(planted)


def _baselines(score: Score) -> str:
    rows = f"<tr><td>the diagnosis, right group first</td><td>{score.overall.right_first}</td></tr>"
    rows += f"<tr><td>chance</td><td>{100 * score.chance:.0f} %</td></tr>"
    rows += "".join(f"<tr><td>{escape(n)}</td><td>{rate}</td></tr>" for n, rate in score.baselines.items())
    return f"<table><tbody>{rows}</tbody></table>"


def _cases(score: Score) -> str:
    rows = ""
    for j in sorted(score.cases, key=lambda j: (j.kind, j.planted)):
        size = "" if j.ratio is None else f"{j.ratio:.1f}"
        amplitude = "" if j.amplitude is None else f"{j.amplitude:.3g}"
        rows += (
            f"<tr><td>{j.id}</td><td>{j.kind}</td><td>{escape(', '.join(j.planted))}</td><td>{amplitude}</td>"
            f"<td>{size}</td><td>{j.verdict}</td><td>{escape(', '.join(j.named))}</td></tr>"
        )
    head = "".join(
        f"<th>{h}</th>" for h in ("case", "kind", "planted", "amplitude", "over detectable", "verdict", "named")
    )
    return f"<div class=scroll><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
