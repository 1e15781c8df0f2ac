"""Summary page of a batch: every take, its fit, its garment's verdict, and open problems, as HTML and as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from fit.batch.garments import Wardrobe
from fit.batch.jobs import diagnosis_name, report_name, result_name
from fit.batch.kept import kept
from fit.batch.pages import render_page
from fit.batch.runner import Survey
from fit.batch.store import Store
from fit.batch.summary import STATE_WORDS, UNDONE, Row, sentence_of, short_name
from fit.errors import BatchError, UnreachableError
from fit.identification.read_again import diagnosed_from
from formats.diagnosis_records import Diagnosis
from formats.errors import ResultError
from formats.plain_text import counted

UNDECIDED = "inconclusive"  # a verdict: the takes cannot decide
# The advice to a person on each verdict, if the diagnosis proposes no next recording.
NEEDS = {
    "ambiguous": "record the motion that the report proposes, which tells the candidates apart",
    "unknown": "look at the report: no effect of the library explains the gap",
    "numerics": "diagnose it alone on a finer mesh: `hangtime diagnose ... --spacing`",
    UNDECIDED: "look at the checks that failed in the report, mend what they name, and record again",
}


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A garment's entry on the page.

    - `state`: diagnosed, lacking, failed, refused, newer or waiting
    - `sentence`: the finding, or the reason why there is none
    - `link`: path of the report in the store of results
    """

    wardrobe: Wardrobe
    state: str
    sentence: str
    verdict: str = ""
    link: str = ""
    proposal: str = ""

    @property
    def garment(self) -> str:
        """The garment's name."""
        return self.wardrobe.name

    @property
    def training(self) -> tuple[str, ...]:
        """Names of the takes to fit to."""
        return tuple(short_name(take.name) for take in self.wardrobe.training)

    @property
    def held_out(self) -> tuple[str, ...]:
        """Names of the takes to judge on."""
        return tuple(short_name(take.name) for take in self.wardrobe.held_out)


@dataclass(frozen=True, kw_only=True)
class TakeLine:
    """A take's entry on the page.

    - `before`, `after`: mean distance of the points [mm], as text
    - `why_left_out`: a sentence with the reason why no diagnosis uses the take; '' if one does
    """

    take: str
    garment: str
    motion: str
    state: str
    before: str = ""
    after: str = ""
    verdict: str = ""
    link: str = ""
    remark: str = ""
    why_left_out: str = ""


@dataclass(frozen=True, kw_only=True)
class Morning:
    """Content of the page.

    - `needs`: takes or garments that need a person, with one sentence of advice each
    - `stopped`: what an interrupted run has left to do; empty where nothing waits
    """

    made: str
    headline: str
    stopped: str
    needs: tuple[tuple[str, str], ...]
    findings: tuple[Finding, ...]
    takes: tuple[TakeLine, ...]

    @property
    def left_out(self) -> tuple[tuple[str, str], ...]:
        """The takes that no diagnosis uses, each with the sentence that says why."""
        return tuple((take.take, take.why_left_out) for take in self.takes if take.why_left_out)


def morning_of(
    rows: Sequence[Row], every: Sequence[Wardrobe], diagnoses: Survey, results: Store, *, made: datetime | None = None
) -> Morning:
    """Return the content of the page.

    Raises:
        UnreachableError: the results cannot be reached now.
    """
    findings = [_finding(one, diagnoses, results) for one in every]
    by_take = {seen.name: (one, seen) for one in every for seen in (*one.takes, *one.copies)}
    verdicts = {
        finding.garment: finding.verdict or STATE_WORDS.get(finding.state, finding.state) for finding in findings
    }
    lines = []
    for row in rows:
        one, seen = by_take.get(row.take, (None, None))
        garment, motion = (one.name, seen.kind) if one and seen else ("", "")
        why = seen.why_left_out if seen else ""
        is_left_out = bool(why and one and not one.missing)
        error = row.result.error if row.result else None
        lines.append(
            TakeLine(
                take=short_name(row.take), garment=garment, motion=motion, state=STATE_WORDS[row.state],
                before=f"{1e3 * error.train_before.mean_m:.1f}" if error else "",
                after=f"{1e3 * error.train_after.mean_m:.1f}" if error else "",
                verdict="left out" if is_left_out else verdicts.get(garment, ""),
                link=result_name(row.key) if row.result else "", remark=" ".join(row.own_remarks),
                why_left_out=f"Left out of the diagnosis: {why}." if why else "",
            )
        )  # fmt: skip
    inconclusive = sum(finding.verdict == UNDECIDED for finding in findings)
    diagnosed = sum(finding.state == "diagnosed" for finding in findings) - inconclusive
    lacking = sum(finding.state == "lacking" for finding in findings)
    parts = [f"{diagnosed} diagnosed"]
    parts += [f"{inconclusive} inconclusive"] if inconclusive else []
    parts += [f"{lacking} without enough takes"] if lacking else []
    headline = f"{sentence_of(rows)} {counted(len(findings), 'garment')}: {', '.join(parts)}."
    when = (made or datetime.now(UTC)).strftime("%Y-%m-%d %H:%M UTC")
    needs = (*_needs_of_takes(rows), *_needs_of_garments(findings))
    return Morning(
        made=when, headline=headline, stopped=_stopped(rows, findings), needs=needs, findings=tuple(findings),
        takes=tuple(lines),
    )  # fmt: skip


def write_morning(morning: Morning, results: Store) -> None:
    """Write `morning.html` and `morning.txt` into the store of results."""
    results.write("morning.html", as_html(morning).encode())
    results.write("morning.txt", as_text(morning).encode())


def as_html(morning: Morning) -> str:
    """Return the page as self-contained HTML."""
    return render_page("morning.html.j2", morning=morning)


def as_text(morning: Morning) -> str:
    """Return the page as plain text, for a mail or a terminal."""
    lines = [f"Hangtime, {morning.made}", morning.headline, *([morning.stopped] if morning.stopped else []), ""]
    lines += ["A person is needed for:", *(f"- {who}: {what}" for who, what in morning.needs)]
    if not morning.needs:
        lines[-1] = f"Nothing needs a person{' so far' if morning.stopped else ''}."
    for finding in morning.findings:
        lines += ["", f"{finding.garment}: {finding.verdict or finding.state}", f"  {finding.sentence}"]
        if finding.training:
            judged = ", ".join(finding.held_out)
            lines.append(f"  Fitted to {', '.join(finding.training)}; judged on {judged}.")
        if finding.proposal:
            lines.append(f"  {finding.proposal}")
        if finding.link:
            lines.append(f"  Report: {finding.link}")
    lines.append("")
    for take in morning.takes:
        error = f"mean distance {take.before} to {take.after} mm" if take.after else take.remark
        parts = (take.take, take.state, take.garment, take.motion, error, take.why_left_out)
        lines.append("  ".join(part for part in parts if part))
    return "\n".join(lines) + "\n"


def _finding(one: Wardrobe, diagnoses: Survey, results: Store) -> Finding:
    if one.missing:
        return Finding(wardrobe=one, state="lacking", sentence=f"Not diagnosed: {one.missing}.")
    key = diagnoses.keys[one.name]
    outcome = diagnoses.outcomes.get(key)
    if outcome is None:
        return Finding(wardrobe=one, state="waiting", sentence="Waiting: the next run continues.")
    if outcome.state != "diagnosed":
        return Finding(wardrobe=one, state=outcome.state, sentence=outcome.sentence)
    try:
        found: Diagnosis = kept(results, diagnosis_name(key), diagnosed_from)
    except UnreachableError:
        raise
    except (ResultError, BatchError) as error:
        return Finding(wardrobe=one, state="refused", sentence=f"The diagnosis cannot be read: {error}")
    proposal = found.next_experiment.sentence if found.next_experiment is not None else ""
    return Finding(
        wardrobe=one, state="diagnosed", sentence=found.sentence, verdict=found.verdict, link=report_name(key),
        proposal=proposal,
    )  # fmt: skip


def _stopped(rows: Sequence[Row], findings: Sequence[Finding]) -> str:
    """Return how many takes and garments a run left that stopped before its end."""
    left = []
    for states, one, done in (
        ([row.state for row in rows], "take", "fitted"),
        ([finding.state for finding in findings], "garment", "diagnosed"),
    ):
        if count := states.count("waiting"):
            left.append(f"{counted(count, one)} {'is' if count == 1 else 'are'} not {done}")
    return f"The run ended early; {' and '.join(left)}; the same command continues." if left else ""


def _needs_of_takes(rows: Sequence[Row]) -> list[tuple[str, str]]:
    ordered = sorted(rows, key=lambda row: row.result is not None)  # takes without a result first
    return [(short_name(row.take), need) for row in ordered for need in row.needs]


def _needs_of_garments(findings: Sequence[Finding]) -> list[tuple[str, str]]:
    needs = []
    for finding in findings:
        if finding.state in ("lacking", *UNDONE):
            needs.append((finding.garment, finding.sentence))
        elif finding.verdict in NEEDS:
            needs.append((finding.garment, finding.proposal or NEEDS[finding.verdict]))
    return needs
