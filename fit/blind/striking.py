"""Repeat the diagnosis of scored cases with a library that lacks the planted effect, and count the answers.

Planted causes outside the library are few and special (`fit.blind.plants`). Here every effect of the library is unknown
in turn. `hangtime diagnose --without EFFECT` gets the cases whose single effect was large enough to be seen. The limit
is the minimum detectable amplitude of the diagnosis with the whole library. `unknown` is right. A twin is an effect
that the whole diagnosis could not tell from the planted one. Naming the twin is as good as these takes allow. The seal
was opened before, when the answers were scored, so no rule may be chosen by these findings.

STRUCK/<id>/diagnosis.json     what the diagnosis without the effect said
STRUCK/struck.json             every rate and case
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import msgspec

from fit.blind.judging import BINS, Judged, answer_of, mistakes, named_by
from fit.blind.making import read_manifest
from fit.blind.rates import Rate, rate_of
from fit.blind.running import LIMIT, Progress, run_set
from fit.blind.scoring import ANSWERS_HASHES, load_score
from fit.errors import FitError
from formats.whole_files import write_whole

STRUCK, STRUCK_FORMAT = "struck.json", "hangtime-blind-struck/1"
# Times the minimum detectable amplitude. Our choice: where the headline's class of the blind check begins. At half, an
# effect may be below what a take shows; at twice only its largest class is left.
LEAST_STRUCK = 2.0
Said = Literal["unknown", "twin", "other", "nothing"]


class StruckCase(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Outcome of one case whose effect was removed from the library.

    - `said`: `unknown`; a twin of the effect or anything else named first; or nothing (`none`, `numerics`,
      `inconclusive`)
    - `confident_and_wrong`: whether any named cause is no twin, and has a probability of 0.8 or more
    """

    id: str
    planted: str
    ratio: float
    bin: str
    has_twin: bool
    said: Said
    verdict: str
    named: tuple[str, ...]
    confident_and_wrong: bool


class Struck(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Score of diagnoses without the planted effect; rates have 95 % Wilson intervals."""

    format: str
    created: str
    sealed: str
    answers: str
    least: float
    unknown: Rate
    unknown_without_twin: Rate
    twin_named: Rate
    other_named: Rate
    nothing: Rate
    confident_and_wrong: Rate
    unknown_by_size: dict[str, Rate]
    cases: tuple[StruckCase, ...]


def strike_set(
    folder: Path, answers: Path, out: Path, *, least: float = LEAST_STRUCK, command: Sequence[str] = (),
    options: Sequence[str] = (), again: bool = False, limit: float = LIMIT, workers: int = 1,
    progress: Progress = lambda done, total, failed: None,
) -> Struck:  # fmt: skip
    """Diagnose every case of one effect without this effect, from `least` times the detectable size on, and count.

    answers: the scored answers with the whole library; out: folder of the new answers; the rest as for `run_set`

    Raises:
        FitError: the answers are not scored, are of another set, have no such case, or `out` holds scored answers; and
            as `run_set`.
    """
    score = load_score(answers)
    if score.sealed != read_manifest(folder).sealed:
        raise FitError("the answers are of another set", where=answers, advice="give the set that was scored")
    if (out / ANSWERS_HASHES).exists():
        raise FitError("holds answers of the whole library", where=out, advice="choose another --out")
    cases = [j for j in score.cases if j.kind == "single" and j.is_tested and (j.ratio or 0.0) >= least]
    if not cases:
        raise FitError(
            f"no case has one effect of {least:g} times the smallest detectable amplitude", where=answers,
            advice="lower --least, or make a set with more --cases",
        )  # fmt: skip
    without = {j.id: j.planted[0] for j in cases}
    run_set(
        folder, out, command=command, options=options, again=again, limit=limit, workers=workers, without=without,
        progress=progress,
    )  # fmt: skip
    struck = _count([_judge(j, out) for j in cases], score.sealed, score.answers, least)
    write_whole(out / STRUCK, msgspec.json.format(msgspec.json.encode(struck), indent=1) + b"\n")
    return struck


def _judge(whole: Judged, out: Path) -> StruckCase:
    """Judge one answer as if the effect's twins had been planted; whole: outcome with the whole library."""
    said = answer_of(out, whole.id)
    verdict = said.verdict if said else "inconclusive"
    twins = tuple(name for name in whole.alike if name not in whole.planted)
    found = mistakes(said, twins)
    nothing: Said = "unknown" if verdict == "unknown" else "nothing"
    return StruckCase(
        id=whole.id, planted=whole.planted[0], ratio=whole.ratio or 0.0, bin=whole.bin, has_twin=bool(twins),
        said=("other" if found[0][0] else "twin") if found else nothing, verdict=verdict, named=named_by(said),
        confident_and_wrong=any(is_wrong and is_certain for is_wrong, is_certain in found),
    )  # fmt: skip


def _count(cases: list[StruckCase], sealed: str, answers: str, least: float) -> Struck:
    def share(said: Said, among: list[StruckCase]) -> Rate:
        return rate_of(c.said == said for c in among)

    return Struck(
        format=STRUCK_FORMAT, created=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), sealed=sealed, answers=answers,
        least=least, unknown=share("unknown", cases),
        unknown_without_twin=share("unknown", [c for c in cases if not c.has_twin]),
        twin_named=share("twin", cases), other_named=share("other", cases), nothing=share("nothing", cases),
        confident_and_wrong=rate_of(c.confident_and_wrong for c in cases),
        unknown_by_size={b: share("unknown", found) for b in BINS if (found := [c for c in cases if c.bin == b])},
        cases=tuple(sorted(cases, key=lambda c: (c.planted, c.ratio))),
    )  # fmt: skip
