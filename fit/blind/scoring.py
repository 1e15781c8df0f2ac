"""Score answers against sealed labels; answers are hashed before the seal is opened, and every opening is recorded.

ANSWERS/answers.sha256     one line per answer, written first
ANSWERS/score.json         every rate, overall and by true amplitude over the minimum detectable one
DIR/looks.jsonl            one line per opening of the seal: when, of which answers, with what headline
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from fit.blind.classifier import leave_one_out
from fit.blind.judging import BINS, Judged, judge
from fit.blind.making import changed_files, open_labels, read_manifest
from fit.blind.plants import PLANTS
from fit.blind.rates import Rate, mean, median, rate_of
from fit.blind.real_scoring import REAL_SCORE_FORMAT, RealScore, real_headline, score_real
from fit.blind.running import DIAGNOSIS, FAILURE
from fit.blind.seal import sha256_of
from fit.errors import FitError
from formats.results import LARGEST_RESULT
from formats.system_causes import step_to_read
from formats.whole_files import read_bounded, write_whole

ANSWERS_HASHES, SCORE, LOOKS_FILE = "answers.sha256", "score.json", "looks.jsonl"
HEADLINE_BIN = "2 to 4"
SCORE_FORMAT = "hangtime-blind-score/1"
ORACLE_LEAST = 0.05  # of the gap: below this closure, a ratio of closures is undefined


class Rates(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rates of a group of cases; a rate without cases is None."""

    cases: int
    false_alarms: Rate
    right_first: Rate
    right_alone: Rate
    right_in_three: Rate
    pair_one_named: Rate
    pair_both_named: Rate
    said_unknown: Rate
    confident_and_wrong: Rate
    amplitude_covered: Rate
    place_found: Rate
    amplitude_error: float | None
    closure: float | None
    closure_against_oracle: float | None
    brier: float | None
    brier_of_groups: float | None
    simulations: float | None
    simulations_most: float | None
    seconds: float | None
    seconds_most: float | None


class Headed(msgspec.Struct):
    """Header of a score file, which states its kind."""

    format: str


class Score(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Score of a set of answers."""

    format: str
    created: str
    sealed: str
    answers: str
    look: int
    overall: Rates
    by_size: dict[str, Rates]
    by_condition: dict[str, dict[str, Rates]]
    in_base_model: int
    verdicts: dict[str, dict[str, int]]
    confusion: dict[str, dict[str, int]]
    baselines: dict[str, Rate]
    chance: float
    cases: tuple[Judged, ...]
    notes: tuple[str, ...]


def hash_answers(folder: Path, answers: Path, *, some: bool = False) -> tuple[str, list[str]]:
    """Write the hash of every answer; return the overall hash and the answered cases.

    some: whether cases without an answer are allowed.

    Raises:
        FitError: cases have neither a diagnosis nor a recorded failure, or none has.
    """
    lines: list[str] = []
    answered: list[str] = []
    missing: list[str] = []
    for case in read_manifest(folder).cases:
        found = [answers / case / name for name in (DIAGNOSIS, FAILURE) if (answers / case / name).exists()]
        (answered if found else missing).append(case)
        lines += [f"{sha256_of(path)}  {case}/{path.name}" for path in found[:1]]
    if missing and not (some and answered):
        raise FitError(
            f"{len(missing)} cases have no answer, first {missing[0]}", where=answers,
            advice="the same `hangtime blind run` continues with them; the seal stays closed until then, or until "
            "the others shall count alone (--answered)",
        )  # fmt: skip
    raw = ("\n".join(lines) + "\n").encode()
    write_whole(answers / ANSWERS_HASHES, raw)
    return hashlib.sha256(raw).hexdigest(), answered


def score_set(folder: Path, answers: Path, *, some: bool = False) -> Score | RealScore:
    """Hash the answers, open the seal, judge every case, record the look and write the score.

    Real takes with planted faults are scored by `fit.blind.real_scoring`.

    With `some`, only cases with an answer count; the opening of the seal is recorded all the same.

    Raises:
        FitError: answers are missing, public files changed, or the seal is broken.
    """
    manifest = read_manifest(folder)
    changed = changed_files(folder, manifest)
    if changed or not manifest.complete:
        raise FitError("the public files are not those that were made", where=folder, advice="make the set again")
    hashed, answered = hash_answers(folder, answers, some=some)
    labels = open_labels(folder)
    looks = folder / LOOKS_FILE
    try:
        before = read_bounded(looks, LARGEST_RESULT).decode() if looks.exists() else ""
    except (OSError, UnicodeDecodeError) as error:
        raise FitError("the openings of the seal cannot be read", where=looks, advice="put this file back") from error
    look = 1 + len(before.splitlines())
    score: Score | RealScore
    if labels.real:
        score = score_real(labels.real, answers)
    else:
        score = summarise(tuple(judge(truth, answers) for truth in labels.truths if truth.id in answered))
        if len(answered) < len(labels.truths):
            left = (
                f"{len(labels.truths) - len(answered)} of {len(labels.truths)} cases have no answer and count nowhere."
            )
            score = msgspec.structs.replace(score, notes=(*score.notes, left))
    score = msgspec.structs.replace(
        score, created=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), sealed=manifest.sealed, answers=hashed,
        look=look,
    )  # fmt: skip
    line = {
        "at": score.created, "labels": manifest.sealed, "answers": hashed, "cases": len(answered),
        "headline": real_headline(score) if isinstance(score, RealScore) else headline(score),
    }  # fmt: skip
    write_whole(
        looks, (before + json.dumps(line) + "\n").encode()
    )  # first, because the seal is open even if the score fails
    write_whole(answers / SCORE, msgspec.json.format(msgspec.json.encode(score), indent=1) + b"\n")
    return score


def load_score(answers: Path) -> Score:
    """Read the score of answers.

    Raises:
        FitError: the answers are not scored, or are of real takes.
    """
    try:
        raw = read_bounded(answers / SCORE, LARGEST_RESULT)
        if msgspec.json.decode(raw, type=Headed).format == REAL_SCORE_FORMAT:
            raise FitError(
                "is of real takes, which are scored by pairs of answers", where=answers / SCORE,
                advice="`hangtime blind score` prints all of it",
            )  # fmt: skip
        return msgspec.json.decode(raw, type=Score)
    except FileNotFoundError as error:
        raise FitError(
            "the answers are not scored", where=answers, advice="score them first: `hangtime blind score`"
        ) from error
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        raise FitError(what, where=answers / SCORE, advice=step_to_read(error)) from error
    except msgspec.MsgspecError as error:
        raise FitError(f"is not a score: {error}", where=answers / SCORE, advice="score the answers again") from error


def summarise(judged: tuple[Judged, ...]) -> Score:
    """Return the rates of judged cases."""
    counted = [j for j in judged if j.is_tested]
    singles = [j for j in counted if j.kind == "single"]
    notes = []
    if not any(j.probability is not None for j in judged):
        notes.append("The diagnosis gives no probabilities: no Brier score; the verdict `effect` counts as confident.")
    in_base = len(judged) - len(counted)
    if in_base:
        notes.append(f"{in_base} cases have an effect that is part of the base model, and count in no rate.")
    planted = [j for j in counted if j.kind in {"single", "pair"}]
    by_size = {name: rates_of([j for j in planted if j.bin == name]) for name in BINS}
    guessed = leave_one_out([j.features for j in singles], [_label(j) for j in singles])
    baselines = {
        "always air_drag": rate_of(j.planted == ("air_drag",) for j in singles),
        "classifier of what the gap looks like, taught by the other cases": rate_of(
            name in {*j.planted, *j.alike} for j, name in zip(singles, guessed, strict=True)
        ),
        "largest correlation, nothing projected out": rate_of(bool(j.right_by_correlation) for j in singles),
        "largest share explained linearly, no refit": rate_of(bool(j.right_by_screening) for j in singles),
        "largest share of the training error removed by a refit": rate_of(bool(j.right_by_training) for j in singles),
        "largest share of the gap closed, no rules": rate_of(bool(j.right_by_closure) for j in singles),
    }
    return Score(
        format=SCORE_FORMAT, created="", sealed="", answers="", look=0,
        overall=rates_of(counted), by_size=by_size, by_condition=_ladders(counted), in_base_model=in_base,
        verdicts=_table([(j.kind, j.verdict) for j in judged]),
        confusion=_table([(_label(j), _first_named(j)) for j in judged if j.kind != "pair"]),
        baselines=baselines, chance=1 / len(PLANTS), cases=judged,
        notes=tuple(notes),
    )  # fmt: skip


def _ladders(judged: list[Judged]) -> dict[str, dict[str, Rates]]:
    """Return rates for every step of the sensor's quality: noise, points, frame rate, missing points."""
    steps = sorted({(name, step) for j in judged for name, step in j.conditions.items()})
    found: dict[str, dict[str, Rates]] = {}
    for name, step in steps:
        found.setdefault(name, {})[step] = rates_of([j for j in judged if j.conditions.get(name) == step])
    return found


def rates_of(judged: list[Judged]) -> Rates:
    """Return every rate of some cases."""
    singles, pairs = [j for j in judged if j.kind == "single"], [j for j in judged if j.kind == "pair"]

    def asked(name: str, among: list[Judged]) -> Rate:
        return rate_of(value for j in among if (value := getattr(j, name)) is not None)

    known = [(j.closure or 0.0, j.closure_of_oracle or 0.0) for j in singles]
    simulations = [j.simulations for j in judged if j.simulations is not None]
    seconds = [j.seconds for j in judged if j.seconds is not None]
    against = [max(min(mine / best, 1.0), 0.0) for mine, best in known if best > ORACLE_LEAST]
    return Rates(
        cases=len(judged), false_alarms=asked("false_alarm", judged), right_first=asked("right_first", singles),
        right_alone=asked("right_alone", singles), right_in_three=asked("right_in_three", singles),
        pair_one_named=asked("right_first", pairs), pair_both_named=asked("both_named", pairs),
        said_unknown=asked("said_unknown", judged), confident_and_wrong=asked("confident_and_wrong", judged),
        amplitude_covered=asked("amplitude_covered", singles), place_found=asked("place_found", judged),
        amplitude_error=median([j.amplitude_error for j in singles if j.amplitude_error is not None]),
        closure=median([j.closure for j in singles if j.closure is not None]),
        closure_against_oracle=mean(against), brier=mean([j.brier for j in judged if j.brier is not None]),
        brier_of_groups=mean([j.brier_of_groups for j in judged if j.brier_of_groups is not None]),
        simulations=median(simulations), simulations_most=max(simulations, default=None),
        seconds=median(seconds), seconds_most=max(seconds, default=None),
    )  # fmt: skip


def headline(score: Score) -> str:
    """Return the most important rates in one line."""
    best = score.by_size[HEADLINE_BIN].right_first
    return (
        f"false alarms {score.overall.false_alarms}; right group first at {HEADLINE_BIN} times the minimum "
        f"detectable {best}, overall {score.overall.right_first}; `unknown` {score.overall.said_unknown}"
    )


def _label(judged: Judged) -> str:
    return judged.planted[0] if judged.planted else "(nothing)"


def _first_named(judged: Judged) -> str:
    return judged.named[0] if judged.named else f"({judged.verdict})"


def _table(pairs: list[tuple[str, str]]) -> dict[str, dict[str, int]]:
    counts = Counter(pairs)
    rows = sorted({row for row, _ in pairs})
    return {row: {column: n for (r, column), n in sorted(counts.items()) if r == row} for row in rows}
