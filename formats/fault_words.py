"""Words for what a take lacks and for what does not hold in its file."""

from __future__ import annotations

from formats.missing import missing_words
from formats.plain_text import counted
from formats.take import Take
from formats.take_report import TakeReport

TOO_LARGE = "too large"  # the word for a take of which blocks need more memory than one file may take
RECOVERS = "`hangtime takes recover` makes a sound file"
EARLIER = "said of an earlier file: "
RECOVERS_EACH = f"{RECOVERS} of each take"


def faults(take: Take, report: TakeReport) -> list[str]:
    """Return a phrase for each thing that a take lacks or that does not hold, but for its damaged blocks."""
    found = []
    if report.spans:
        frames = f" ({report.missing_frames} frames)" if report.missing_frames else ""
        label = "not read" if state_of(report) == TOO_LARGE else "missing"
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
    return found


def of_another(report: TakeReport) -> str:
    """Word the blocks of other takes in the same file."""
    takes = "another take" if report.other_takes == 1 else f"{report.other_takes} other takes"
    return f"{counted(report.other_blocks, 'block')} of {takes} in this file"


def behind(report: TakeReport) -> str:
    """Word what follows the end."""
    return f"{counted(report.trailing_bytes, 'byte')} follow{'s' * (report.trailing_bytes == 1)} its end"


def unread(report: TakeReport) -> str:
    """Word what needs too much memory."""
    which = f"{counted(report.unread_blocks, 'block')} or scan{'s need' if report.unread_blocks > 1 else ' needs'}"
    return f"{which} more memory than one file may take, which is no damage; keep this file, and record shorter takes"


def lost_scans(report: TakeReport) -> str:
    """Word how many scans are missing."""
    return f"{report.missing_scans} scan{'s' if report.missing_scans > 1 else ''} of the surface"


def state_of(report: TakeReport) -> str:
    """Return one word for a take: sound, incomplete, damaged, or too large."""
    if report.unread_blocks and not report.is_damaged:
        return TOO_LARGE
    return "sound" if report.is_sound else "damaged" if report.is_damaged else "incomplete"
