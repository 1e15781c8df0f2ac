"""Read marker trajectories from text: TRC, CSV of Vicon Nexus, OptiTrack Motive and Hangtime, TSV of Qualisys.

Commas, semicolons or tabs delimit the cells. A comma may be the decimal separator where it is not the delimiter.
`marker_lines` finds the header, whose first word shows which program wrote the file.

Sources: OpenSim, "Marker (.trc) Files"; Vicon Nexus, "ASCII (.csv) export"; OptiTrack, "Data Export: CSV".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import takewhile
from pathlib import Path

from formats.errors import TakeError
from formats.importers.decimal_separators import are_too_far
from formats.importers.marker_lines import CAN_BE_READ, LINES_OF_VICON_HEAD, TRAJECTORIES, Rows, read_lines
from formats.importers.marker_numbers import Table, read_frames
from formats.importers.marker_tracks import ALL, EXPORT_MEASURED, MarkerTracks, Wanted
from formats.importers.number_cells import CELL_SHOWN, is_number
from formats.importers.own_text import read_own
from formats.importers.qualisys_text import read_qualisys
from formats.importers.stated_values import (
    cell_at,
    frame_rate,
    names_of,
    rate_beside_times,
    warning_of_count,
    whole_number,
)
from formats.importers.thousands import find_thousands
from formats.importers.units import GivenUnit, metres_of
from formats.plain_text import counted

Reader = Callable[[Rows, GivenUnit | str | None, Path, Wanted], MarkerTracks]

EXPECTED_TYPES = ("rigid body marker", "bone marker")  # types of Motive's columns


def read_marker_text(path: Path, unit: GivenUnit | str | None, decimal: str = "", wanted: Wanted = ALL) -> MarkerTracks:
    """Read the marker trajectories of a text file.

    - `unit`: unit of its lengths, needed where it states none
    - `decimal`: decimal separator, a comma or a point; '' to detect it
    - `wanted`: markers and frames to check and convert

    Raises:
        TakeError: the file is of none of the known kinds, malformed, or has fewer frames than it states.
    """
    first, rows = read_lines(path, decimal)
    programs: dict[str, Reader] = {
        "pathfiletype": _trc,
        "format version": _motive,
        "no_of_frames": read_qualisys,
        "trajectories": _vicon,
    }
    read = programs.get(first, read_own)
    try:
        return read(rows, unit, path, wanted)
    except TakeError:
        found = None if decimal else find_thousands(rows[1:])
        if found is None:
            raise
        sign, warning = found
        tracks = read(rows.with_decimal(sign), unit, path, wanted)
        if are_too_far(tracks.positions):
            raise
    return replace(tracks, warning="; ".join(filter(None, [warning, tracks.warning])))


def _trc(rows: Rows, unit: GivenUnit | str | None, path: Path, wanted: Wanted) -> MarkerTracks:
    """Read a TRC file of OpenSim.

    A line of names and a line of values come first, then `Frame#`, `Time` and a marker's name every three cells.
    """
    if len(rows) < 5:
        raise TakeError("ends within its header", where=path, advice=f"export it again; {CAN_BE_READ}")
    stated = dict(zip((cell.strip().lower() for cell in rows[1]), rows[2], strict=False))
    names = [cell.strip() for cell in rows[3][2:] if cell.strip()]
    count = whole_number(stated.get("nummarkers", ""), "number of markers", path, len(names))
    if len(names) != count:
        raise TakeError(f"names {len(names)} markers and states {count}", where=path, advice="export it again")
    body = rows[4 if rows[4][0].strip().isdigit() else 5 :]  # some programs leave out the line of X1, Y1, Z1
    metres = metres_of(stated.get("units", ""), unit, path)
    count_of_frames = whole_number(stated.get("numframes", ""), "number of frames", path, len(body))
    warning = warning_of_count(body, count_of_frames, wanted.frames, path)
    table = Table(2 + 3 * count, range(2, 2 + 3 * count, 3), names, metres, lambda first: first[:, 1])
    frames = read_frames(body, table, path, wanted)
    rate = rate_beside_times(stated.get("datarate", ""))
    return frames.tracks(names_of(names, path), rate=rate, warning=warning)


def _vicon(rows: Rows, unit: GivenUnit | str | None, path: Path, wanted: Wanted) -> MarkerTracks:
    """Read a CSV file of Vicon Nexus.

    After `Trajectories` come the frame rate, the names above X, Y and Z, their units, and the numbered frames. Without
    units, the caller must give the unit. The sub-frame column may be missing: spreadsheets and scripts remove it.
    """
    section = rows[1:]
    if len(section) < 4:
        raise TakeError("ends within the header of its trajectories", where=path, advice="export it again")
    rate = frame_rate(section[0][0], path)
    names, kinds = section[1], section[2]
    has_units = not section[3][0].strip().isdigit()  # lines that hold nothing are left out
    units, section = (section[3], section[4:]) if has_units else ([], section[3:])
    at = [k for k in range(1, len(kinds) - 2) if [cell.strip().upper() for cell in kinds[k : k + 3]] == ["X", "Y", "Z"]]
    has_sub_frames = at[:1] != [1]
    labels = [names[k].strip() if k < len(names) else "" for k in at]
    stated = {units[k].strip() for k in at if k < len(units)}
    if len(stated) > 1:
        raise TakeError(f"states several units: {', '.join(sorted(stated))}", where=path, advice="export in one")
    metres = metres_of(next(iter(stated), ""), unit, path)
    count = sum(1 for _ in takewhile(lambda row: row[0].strip().lstrip("-").isdigit(), section))
    body, behind = section[:count], next(iter(section[count : count + 1]), None)
    if behind and _has_numbers(behind, has_sub_frames=has_sub_frames):
        raise TakeError(  # this is a frame, and no title of the next section
            f"line {section.numbers[count]} holds {behind[0].strip()[:CELL_SHOWN]!r}, which is no number",
            where=path, advice="mend that line",
        )  # fmt: skip
    if behind and _goes_on(section[count + 1 : count + 1 + LINES_OF_VICON_HEAD], has_sub_frames=has_sub_frames):
        raise TakeError(
            f"line {section.numbers[count]} begins with {behind[0].strip()[:CELL_SHOWN]!r}, and frames follow it",
            where=path,
            advice="mend its number or take it out; where it begins another section, put its frame rate below it",
        )  # fmt: skip
    if (second := _second_trajectories(section[count:])) is not None:
        raise TakeError(
            f"has trajectories twice, in lines {rows.numbers[0]} and {second}", where=path,
            advice="export one section of trajectories, or put the second into a file of its own",
        )  # fmt: skip
    table = Table(len(kinds), at, labels, metres, lambda first: first[:, 0] / rate)
    frames = read_frames(body, table, path, wanted)
    return frames.tracks(names_of(labels, path), has_times=False)


def _goes_on(rows: Rows, *, has_sub_frames: bool) -> bool:
    """Return whether more frames follow a line that is no frame.

    The title of another section has its frame rate in the next line. A unit may stand beside that rate, where a frame
    has numbers.
    """
    frames = [_has_numbers(row, has_sub_frames=has_sub_frames) for row in rows]
    is_section = bool(rows) and rate_beside_times(cell_at(rows[0], 0)) is not None and not frames[0]
    return not is_section and any(found and row[0].strip().isdigit() for found, row in zip(frames, rows, strict=True))


def _has_numbers(row: list[str], *, has_sub_frames: bool) -> bool:
    """Return whether a line has a frame's numbers: a sub-frame number where that column exists, else positions."""
    return cell_at(row, 1).isdigit() if has_sub_frames else any(map(is_number, row[1:]))


def _second_trajectories(rows: Rows) -> int | None:
    """Return the line number at which a second section of trajectories begins, None without one."""
    begins = (number for number, line in zip(rows.numbers, rows.lines, strict=True) if TRAJECTORIES.match(line))
    return next(begins, None)


def _motive(rows: Rows, unit: GivenUnit | str | None, path: Path, wanted: Wanted) -> MarkerTracks:
    """Read a CSV file of OptiTrack Motive.

    The first line holds names and values. Rows named `Type`, `Name` and so on stand above `Frame`, `Time`.
    """
    stated = {name.strip().lower(): value for name, value in zip(rows[0][::2], rows[0][1::2], strict=False)}
    heads = {row[1].strip().lower(): row for row in rows[1:9] if len(row) > 1 and not row[0].strip()}
    begin = next((k for k, row in enumerate(rows[:12]) if row[0].strip().lower() == "frame"), None)
    if begin is None or "name" not in heads or "type" not in heads:
        raise TakeError("has no rows that name its markers", where=path, advice="export it with its header")
    axes, names, kinds = rows[begin], heads["name"], heads["type"]
    what = next((row for row in rows[1:begin] if "Position" in [cell.strip() for cell in row]), axes)
    placed = [
        k for k in range(2, len(axes) - 2)
        if [cell.strip().upper() for cell in axes[k : k + 3]] == ["X", "Y", "Z"]
        and (what is axes or cell_at(what, k) == "position")
    ]  # fmt: skip
    at = [k for k in placed if cell_at(kinds, k) == "marker"]
    # Motive computes these from the pose of a body or a bone.
    expected = tuple(cell_at(names, k, as_is=True) for k in placed if cell_at(kinds, k) in EXPECTED_TYPES)
    if expected and not at:
        raise TakeError(
            f"has no Marker, and {counted(len(expected), 'marker')} that Motive expects by the pose of a body, "
            f"first {expected[0][:CELL_SHOWN]!r}", where=path, advice=EXPORT_MEASURED,
        )  # fmt: skip
    body = rows[begin + 1 :]
    total = stated.get("total exported frames", "")
    count = whole_number(total, "number of frames", path, len(body)) if total.strip() else len(body)
    warning = warning_of_count(body, count, wanted.frames, path)
    metres = metres_of(stated.get("length units", ""), unit, path)
    labels = [cell_at(names, k, as_is=True) for k in at]
    frames = read_frames(body, Table(len(axes), at, labels, metres, lambda first: first[:, 1]), path, wanted)
    rate = rate_beside_times(stated.get("export frame rate", "") or stated.get("capture frame rate", ""))
    return frames.tracks(names_of(labels, path), rate=rate, warning=warning, expected=expected)
