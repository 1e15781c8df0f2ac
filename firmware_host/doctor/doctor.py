"""The sensor doctor: its checks, their order, and the skipping of checks after a failure.

Another package adds checks through the entry point group `hangtime.sensor_checks`: each entry names a `Check`.
Contributed checks come after the built-in ones, in the order of their names.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import entry_points

from firmware_host.doctor.checks import Check, Examination, Finding, Verdict, skipped
from firmware_host.doctor.stream_checks import STREAM_CHECKS
from firmware_host.doctor.usb_checks import USB_CHECKS
from formats.errors import HangtimeError

GROUP = "hangtime.sensor_checks"


def all_checks(is_recording: bool) -> list[Check]:
    """Return the checks that apply, in their order."""
    found = [*USB_CHECKS, *STREAM_CHECKS, *contributed()]
    return [check for check in found if check.is_for_recordings or not is_recording]


def contributed() -> list[Check]:
    """Return the checks of other packages; a check with a missing library becomes a finding that names the library."""
    checks = []
    for entry in sorted(entry_points(group=GROUP), key=lambda e: e.name):
        try:
            check = entry.load()
        except ModuleNotFoundError as error:
            finding = skipped(f"{error.name} is not installed")
            check = Check(name=entry.name, look=lambda _, said=finding: said, is_for_recordings=True)  # type: ignore[misc]
        checks.append(check)
    return checks


def examine(checks: Sequence[Check], examination: Examination) -> Iterator[tuple[Check, Finding]]:
    """Run the checks one by one and yield each with its finding.

    A `HangtimeError` inside a check becomes its finding; any other error is a defect and propagates.
    """
    failed: set[str] = set()
    for check in checks:
        missing = [name for name in check.needs if name in failed]
        if missing:
            finding = skipped(f"waits for `{missing[0]}`")
        else:
            try:
                finding = check.look(examination)
            except HangtimeError as error:
                finding = Finding(Verdict.PROBLEM, str(error))
        if finding.verdict is not Verdict.OK:
            failed.add(check.name)
        yield check, finding
