"""Summarise the state of a take in one record, and describe its missing parts and faults in words."""

from __future__ import annotations

from pathlib import Path

from formats.fit_records import TakeState
from formats.left_descriptions import prepared_name
from formats.missing import missing_words, noted_doubts
from formats.plain_text import counted
from formats.take import Take
from formats.take_report import TOO_LARGE, LeftState, TakeReport

RECOVERS = "`hangtime takes recover` makes a sound file"
EARLIER = "reported of the file it was made from: "
STILL_WRITTEN = "a recording or import is still writing it; wait until it ends"
RECOVERS_EACH = f"{RECOVERS} of each take"


def state_of_take(take: Take) -> TakeState:
    """Return the record of a take's state that every command reports.

    A take without a file has the state that the take itself states. A take of which only some frames are used keeps the
    state of its file.
    """
    report = _report_of(take)
    return TakeState(
        take_id=take.take_id, state=take.state_of_file, is_complete=take.is_complete, missing=missing_words(take),
        missing_frames=report.missing_frames, missing_scans=report.missing_scans, unread_blocks=report.unread_blocks,
        damaged_blocks=report.damaged_blocks, other_blocks=report.other_blocks, other_takes=report.other_takes,
        trailing_bytes=report.trailing_bytes, doubts=list(report.doubts), earlier_doubts=report.earlier_doubts,
    )  # fmt: skip


def _report_of(take: Take) -> TakeReport:
    """Return the report on a take's file; without a file, a report from the take itself."""
    is_complete = take.is_complete and not take.missing
    return take.report or TakeReport(
        is_complete=is_complete, missing_frames=0 if is_complete else None,
        earlier_doubts="; ".join(noted_doubts(take.notes)),
    )  # fmt: skip


def doubts_of(take: Take) -> list[str]:
    """Return sentences about everything that is wrong with a take, except missing frames."""
    report, found = _report_of(take), noted_doubts(take.notes)
    if report.damaged_blocks:
        is_one = report.damaged_blocks == 1
        found.append(f"{counted(report.damaged_blocks, 'block')} of its file {'is' if is_one else 'are'} damaged")
    if report.missing_scans:
        found.append(f"the take lacks {lost_scans(report)}")
    if report.unread_blocks:
        found.append(unread(report))
    if report.other_blocks:
        blocks = counted(report.other_blocks, "block")
        found.append(f"{blocks} of other takes in its file are left out; `hangtime takes recover` saves each take")
    if report.trailing_bytes:
        found.append(behind(report))
    return found + unsettled(report)


def faults(take: Take, report: TakeReport) -> list[str]:
    """Return a phrase for each fault or missing part of a take, except damaged blocks."""
    found = []
    if report.spans:
        frames = f" ({counted(report.missing_frames, 'frame')})" if report.missing_frames else ""
        label = "not read" if report.state == TOO_LARGE else "missing"
        found.append(f"{label}: {missing_words(take, report.spans)}{frames}")
    if report.missing_scans:
        found.append(f"missing: {lost_scans(report)}")
    if report.unread_blocks:
        found.append(unread(report))
    if report.other_takes:
        found.append(of_another(report))
    if report.trailing_bytes:
        found.append(behind(report))
    found += report.doubts
    if report.earlier:
        found.append(f"an earlier file had lost {missing_words(take, report.earlier)}")
    if report.earlier_doubts:
        found.append(f"{EARLIER}{report.earlier_doubts}")
    return found + unsettled(report)


def unsettled(report: TakeReport) -> list[str]:
    """Describe a take or descriptions under unfinished names: still being written, or left by an interruption."""
    path = Path(report.file)
    if report.is_being_written:
        return [STILL_WRITTEN]
    if path.name.endswith(".mcap.partial") and report.is_sound:
        return [f"the file is whole and never got its name; {RECOVERS} of it"]
    return [_left(state, prepared_name(path, name).name, name) for name, state in report.left.items()]


def _left(state: LeftState, prepared: str, name: str) -> str:
    """Return the next step for a description that an import left under its unfinished name."""
    if state == "unreadable":
        return f"{prepared}, which an import left beside it, cannot be read; get the permission to read it"
    return (
        f"its import ended before it replaced {name} beside the take; rename {prepared} to {name}, or remove {prepared}"
    )


def of_another(report: TakeReport) -> str:
    """Describe the blocks of other takes in the same file."""
    takes = "another take" if report.other_takes == 1 else f"{report.other_takes} other takes"
    return f"{counted(report.other_blocks, 'block')} of {takes} in this file"


def behind(report: TakeReport) -> str:
    """Describe the bytes behind the end of a take."""
    return f"{counted(report.trailing_bytes, 'byte')} follow{'s' * (report.trailing_bytes == 1)} its end"


def unread(report: TakeReport) -> str:
    """Describe the blocks and scans that need too much memory."""
    which = f"{counted(report.unread_blocks, 'block')} or scan{'s need' if report.unread_blocks > 1 else ' needs'}"
    return f"{which} more memory than one file may take, which is no damage; keep this file, and record shorter takes"


def lost_scans(report: TakeReport) -> str:
    """Return the number of missing scans in words."""
    return f"{report.missing_scans} scan{'s' if report.missing_scans > 1 else ''} of the surface"
