"""Comparison of fits, diagnoses or takes: one table for the terminal, a page and programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from markupsafe import Markup

from fit.errors import FitError
from fit.recordings.intact import doubts_in_words, flaw_notes
from fit.report.again import one_of, results_in
from fit.report.page import packaged
from fit.report.tables import row_of, table
from fit.report.templating import piece, render
from fit.report.text import interval, number, percent, tenths
from formats.archive import read_take
from formats.diagnosis_records import Diagnosis, in_percent
from formats.fault_words import doubts_of
from formats.fit_records import ErrorFigure, FitParameter, FitResult
from formats.summary import summarise
from formats.take import names_apart

NONE = "–"


@dataclass(frozen=True)
class SideBySide:
    """Table of a comparison: rows of a name and one text per column; `records`: the same as plain values."""

    kind: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    records: tuple[dict[str, Any], ...]
    remarks: tuple[str, ...] = ()

    def page(self) -> str:
        """Return the comparison as a self-contained HTML page."""
        rows = [row_of(row[0], row[1:]) for row in self.rows]
        body = table("Side by side", ("", *self.heads), rows, range(1, len(self.heads) + 1))
        if self.remarks:
            body += piece("parts.html", "notes", self.remarks)
        title = f"{len(self.records)} {self.kind} side by side"
        style = Markup(packaged("page.css"))
        return render(
            "compare.html", style=style, title=title, body=piece("parts.html", "section", "compared", title, body)
        )


@dataclass(frozen=True, kw_only=True)
class _Column:
    """One item of a comparison: its texts by row, its plain values and its warnings.

    own: a take's id and the name of its file; fit: the fit itself
    """

    kind: str
    rows: dict[str, str]
    record: dict[str, Any]
    warnings: list[str]
    own: tuple[str, str] | None = None
    fit: FitResult | None = None


def _columns(paths: Sequence[Path]) -> list[_Column]:
    """Read the items at paths, one after the other: take archives, result files, or folders of results.

    A take is dropped before the next is read, because ten minutes at 1000 frames a second fill hundreds of megabytes.

    Raises:
        HangtimeError: one cannot be read. FitError: fewer than two items, or items of different kinds.
    """
    if len(paths) < 2:
        raise FitError("one thing has nothing to be compared with", where=paths[0], advice="name two or more")
    found = [_column(path) for path in paths]
    if {one.kind for one in found} == {"fit", "diagnosis"}:  # a folder that holds both may have been meant either way
        found = [
            one if one.kind == "diagnosis" else _column(path, is_diagnosis=True)
            for path, one in zip(paths, found, strict=True)
        ]
    for path, one in zip(paths, found, strict=True):
        if one.kind != found[0].kind:
            raise FitError(
                f"is a {one.kind}, and {paths[0]} is a {found[0].kind}", where=path,
                advice="compare things of one kind",
            )  # fmt: skip
    return found


def _column(path: Path, *, is_diagnosis: bool = False) -> _Column:
    record: dict[str, Any] = {"file": str(path)}
    if path.suffix in (".mcap", ".partial") and not path.is_dir():
        take = read_take(path)
        known = summarise(take)
        return _Column(
            kind="take", rows=_take_rows(known), record=record | known, warnings=doubts_of(take),
            own=(take.take_id, take.report.file if take.report else ""),
        )  # fmt: skip
    found = one_of(path, is_diagnosis=is_diagnosis)
    record |= msgspec.to_builtins(found)
    warnings = flaw_notes(found.notes)
    if isinstance(found, FitResult):
        return _Column(kind="fit", rows=_fit_rows(found), record=record, warnings=warnings, fit=found)
    return _Column(kind="diagnosis", rows=_diagnosis_rows(found), record=record, warnings=warnings)


def compare(paths: Sequence[Path]) -> SideBySide:
    """Return the comparison of fits, diagnoses or takes.

    Raises:
        HangtimeError: one cannot be read. FitError: fewer than two items, or items of different kinds.
    """
    columns = _columns(paths)
    kind, names = columns[0].kind, _short(paths)
    labels = _in_order([list(column.rows) for column in columns])
    rows = [(label, *(column.rows.get(label, NONE) for column in columns)) for label in labels]
    if kind == "fit":
        rows = [(*row, _agree(row[0], [column.fit for column in columns if column.fit])) for row in rows]
        names = [*names, "intervals overlap"]
    warnings = [column.warnings for column in columns]
    if kind == "take":
        remarks = doubts_in_words(names_apart([column.own for column in columns if column.own]), warnings)
    else:
        remarks = [note for notes in warnings for note in notes]
    left_out = [text for path in paths if path.is_dir() and (text := results_in(path).left_out)]
    kinds = f"{kind}s" if kind != "diagnosis" else "diagnoses"
    records = tuple(column.record for column in columns)
    return SideBySide(kinds, tuple(names), tuple(rows), records, (*dict.fromkeys(remarks), *left_out))


def _in_order(lists: Sequence[Sequence[str]]) -> list[str]:
    """Return every label of some lists once; one that only a later list has stands behind its neighbour there."""
    found: list[str] = []
    for labels in lists:
        for place, label in enumerate(labels):
            if label not in found:
                found.insert(found.index(labels[place - 1]) + 1 if place else 0, label)
    return found


def _short(paths: Sequence[Path]) -> list[str]:
    """Return short distinct names of paths, without their common beginning and end."""
    parts = [list(path.parts) for path in paths]
    while all(len(part) > 1 for part in parts) and len({part[-1] for part in parts}) == 1:
        parts = [part[:-1] for part in parts]
    while all(len(part) > 1 for part in parts) and len({part[0] for part in parts}) == 1:
        parts = [part[1:] for part in parts]
    return [str(Path(*part)) for part in parts]


def _fit_rows(fit: FitResult) -> dict[str, str]:
    rows = {"method": fit.method, "search": fit.search, "takes fitted to": ", ".join(fit.take_ids)}
    rows["takes held out"] = ", ".join(fit.held_out_ids) or "none"
    rows["mesh spacing"] = f"{1e3 * fit.spacing:g} mm" if fit.spacing is not None else NONE
    rows["seed"] = str(fit.seed)
    for parameter in fit.parameters:
        unit = "" if parameter.unit in ("", "1") else f" [{parameter.unit}]"
        rows[f"{_words(parameter.name)}{unit}"] = _value(parameter.fitted, _ends(parameter), parameter.is_identified)
    for c in fit.combinations:
        one = _value(c.fitted, (c.interval_low, c.interval_high), c.is_identified)
        rows.setdefault(f"{c.name} [{c.unit}]", one)  # a damping is also a parameter of `si`
    for name, before, after in (
        ("mean distance of all points, takes fitted to", fit.error.train_before, fit.error.train_after),
        ("mean distance of all points, takes held out", fit.error.held_out_before, fit.error.held_out_after),
    ):
        rows[name] = _change(before, after)
    rows["simulations"] = f"{fit.simulations} in {fit.seconds:.0f} s"
    return rows


def _diagnosis_rows(diagnosis: Diagnosis) -> dict[str, str]:
    gap = diagnosis.gap
    rows = {"verdict": diagnosis.verdict, "names": ", ".join(diagnosis.named).replace("_", " ") or NONE}
    rows["takes fitted to"] = ", ".join(diagnosis.take_ids)
    rows["takes held out"] = ", ".join(diagnosis.held_out_ids) or "none"
    rows["base model, rms"] = tenths(gap.base_mm.value)
    rows["with what is named, rms"] = tenths(gap.with_effect_mm.value) if gap.with_effect_mm else NONE
    rows["sensor's noise, rms"] = tenths(gap.floor_mm.value)
    rows["share of the gap closed"] = percent(gap.closure.value) if gap.closure else NONE
    for effect in sorted(diagnosis.ranked, key=lambda e: -(e.probability or 0.0)):
        if effect.id in diagnosis.named or (effect.probability or 0.0) >= 0.1:
            unit = "" if effect.unit in ("", "1") else f" {effect.unit}"
            chance = f", probability {in_percent(effect.probability)}" if effect.probability is not None else ""
            ends = f" ({interval(effect.amplitude_interval)})" if effect.amplitude_interval else ""
            rows[effect.id.replace("_", " ")] = f"{number(effect.amplitude)}{unit}{ends}{chance}"
    for parameter in diagnosis.base_parameters:
        unit = "" if parameter.unit in ("", "1") else f" [{parameter.unit}]"
        rows[f"{parameter.name}{unit}"] = _value(parameter.fitted, _ends(parameter), parameter.is_identified)
    return rows


def _take_rows(known: dict[str, Any]) -> dict[str, str]:
    """Return the rows of a take from its summary."""
    rate = f", {known['rate_hz']:g} a second" if known["rate_hz"] is not None else ""
    rows = {
        "missing": known["missing"] or ("nothing" if known["is_complete"] else "its end"),
        "garment": f"{known['garment']}, {1e3 * known['mass_kg']:.1f} g",
        "length": f"{known['duration_s']:g} s, {known['frames']} frames{rate}",
        "motion": known["motion"],
        "hanger travels": " x ".join(f"{t:.0f}" for t in known["hanger_travel_mm"]) + " mm",
        "hanger seen": f"{known['hanger_seen_percent']:g} %",
        "rig": known["rig"],
    }
    for point in known["points"]:
        noise = f", noise {point['sd_mm']:g} mm a coordinate" if point["sd_mm"] is not None else ""
        rows[point["name"].replace("_", " ")] = f"seen {point['seen_percent']:g} %{noise}"
    return rows


def _ends(parameter: FitParameter) -> tuple[float, float] | None:
    low, high = parameter.interval_low, parameter.interval_high
    return None if low is None or high is None else (low, high)


def _value(value: float, ends: tuple[float, float] | None, is_identified: bool | None) -> str:
    if is_identified is False:
        return f"not identified ({interval(ends)})" if ends else "not identified"
    return f"{number(value)} ({interval(ends)})" if ends else number(value)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _change(before: ErrorFigure | None, after: ErrorFigure | None) -> str:
    if before is None or after is None:
        return NONE
    return f"{1e3 * before.mean_m:.1f} → {1e3 * after.mean_m:.1f} mm"


def _agree(label: str, fits: Sequence[FitResult]) -> str:
    """Return whether the intervals of a parameter or a combination overlap, in words; nothing for other rows."""
    found = []
    for fit in fits:
        every = [(c.name, c.unit, (c.interval_low, c.interval_high)) for c in fit.combinations]
        every += [(_words(p.name), p.unit, ends) for p in fit.parameters if (ends := _ends(p)) is not None]
        named = {label: ends for name, unit, ends in every for label in (name, f"{name} [{unit}]")}
        found += [named[label]] if label in named else []
    if len(found) < len(fits):
        return ""
    return "yes" if max(low for low, _ in found) <= min(high for _, high in found) else "no"
