"""The blind check as one self-contained HTML page: rates, confusion matrix, misses."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

from fit.blind.scoring import Answer, Score

STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;color:#1d2129;background:#fff}
table{border-collapse:collapse;margin:1rem 0}
th,td{padding:.25rem .6rem;text-align:left;border-bottom:1px solid #dde1e8}
td.number{text-align:right;font-variant-numeric:tabular-nums}
.matrix td,.matrix th{font-size:.8rem;padding:.15rem .35rem}
.matrix th.up{writing-mode:vertical-rl;transform:rotate(180deg);border:0;vertical-align:bottom}
.matrix td{text-align:center;border:1px solid #eef0f4}
.right{background:#cfe8d5}.wrong{background:#f6d5d0}.mild{background:#f7efcf}
.scroll{overflow-x:auto}pre{white-space:pre-wrap;background:#f5f6f8;padding:.8rem}
"""


def write_page(score: Score, answers: Sequence[Answer], baselines: dict[str, float], hashes: dict[str, str]) -> str:
    """Return the page."""
    rates = "".join(
        f"<tr><td>{_text(name)}</td><td class=number>{_text(rate)}</td></tr>" for name, rate in score.rates.items()
    )
    figures = "".join(
        f"<tr><td>{_text(name)}</td><td class=number>{value:.3f}</td></tr>" for name, value in score.figures.items()
    )
    others = "".join(
        f"<tr><td>{_text(name)}</td><td class=number>{100 * value:.0f} %</td></tr>" for name, value in baselines.items()
    )
    origin = "".join(
        f"<tr><td>{_text(name)}</td><td><code>{_text(value)}</code></td></tr>" for name, value in hashes.items()
    )
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>Blind check</title><style>{STYLE}</style>"
        f"<h1>Blind check</h1><p>{len(answers)} cases of a generator that shares no code with the diagnosis. "
        "Shares with their 95 % Wilson intervals.</p>"
        f"<h2>Rates</h2><table>{rates}{figures}</table>"
        f"<h2>Baselines</h2><p>Share of single effects that a simpler rule names.</p><table>{others}</table>"
        f"<h2>Planted against named</h2>{_matrix(score)}"
        f"<h2>Misses</h2><pre>{_text(chr(10).join(score.misses) or 'none')}</pre>"
        f"<h2>Origin</h2><table>{origin}</table></html>\n"
    )


def baselines_of(answers: Sequence[Answer]) -> dict[str, float]:
    """Return the share of single effects that simpler rules name right."""
    singles = [a for a in answers if a.label.kind == "single"]
    if not singles:
        return {}
    count = len(singles)
    library = max(len(a.diagnosis.effects) for a in singles if a.diagnosis is not None)
    always = sum(a.label.names[0] == "air_drag" for a in singles) / count

    def top(key: str, sign: float) -> float:
        hits = 0
        for a in singles:
            found = [f for f in (a.diagnosis.effects if a.diagnosis else []) if getattr(f, key) is not None]
            best = max(found, key=lambda f: sign * getattr(f, key), default=None)
            hits += best is not None and best.id == a.label.names[0]
        return hits / count

    return {
        "chance": 1 / library,
        "always air drag": always,
        "largest explained residual at the base fit, no refit, no held-out motion": top("explained", 1.0),
        "smallest p-value of the score test": top("p_value", -1.0),
    }


def _matrix(score: Score) -> str:
    rows = sorted({planted for planted, _ in score.confusion})
    columns = sorted({said for _, said in score.confusion})
    head = "".join(f"<th class=up>{_text(c)}</th>" for c in columns)
    body = []
    for planted in rows:
        cells = []
        for said in columns:
            count = score.confusion.get((planted, said), 0)
            tone = "" if not count else _tone(planted, said)
            cells.append(f"<td class={tone or 'none'}>{count or ''}</td>")
        body.append(f"<tr><th>{_text(planted)}</th>{''.join(cells)}</tr>")
    return f"<div class=scroll><table class=matrix><tr><th></th>{head}</tr>{''.join(body)}</table></div>"


def _tone(planted: str, said: str) -> str:
    if said in planted.split("+") or (planted == "nothing" and said == "none"):
        return "right"
    return "mild" if said in {"none", "unknown", "inconclusive", "numerics"} else "wrong"


def _text(value: object) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return "–"
    return html.escape(str(value))
