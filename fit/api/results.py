"""Result objects of the calls: they print as tables, and convert to dictionaries and CSV without pandas."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from fit.api.arguments import PlanOptions, arguments_named, check_switches, path_of
from fit.api.shown import diagnosis_tables, effect_table, error_row, fit_tables, interval_words
from fit.api.tables import Table, as_html, as_text
from formats.arrays import Booleans, Floats
from formats.diagnosis_records import Diagnosis, has_size, is_refitted
from formats.errors import HangtimeError
from formats.figures import short, without_noise
from formats.fit_records import ErrorFigure, FitParameter, FitResult, verdict_on
from formats.outputs import AS_RESULT, AS_TABLE, check_ending, make_parent, refuse_to_replace, write_text
from formats.results import load_diagnosis, load_fit_result, save_diagnosis, save_fit_result
from formats.rows import csv_text
from formats.take import Take

if TYPE_CHECKING:
    from fit.gap.diagnosis import Findings
    from fit.identification.request import Request
    from fit.recordings.ready import Ready


class _Shown:
    """Show tables in a terminal and in a notebook."""

    def _tables(self) -> list[Table]:
        raise NotImplementedError

    def __str__(self) -> str:
        return as_text(self._tables())

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return as_html(self._tables())


@dataclass(frozen=True, kw_only=True, repr=False)
class FitOutcome(_Shown):
    """A fit: the result as `hangtime fit` writes it, with its takes and its request.

    training, held_out, request and prepared, the takes ready for simulation, are absent where the result was loaded
    from a file
    """

    result: FitResult
    training: tuple[Take, ...] = ()
    held_out: tuple[Take, ...] = ()
    request: Request | None = None
    prepared: Ready | None = None

    @cached_property
    def values(self) -> dict[str, float]:
        """Fitted values by name, in the units of the result; `simulate` takes them."""
        return {p.name: p.fitted for p in self.result.parameters}

    @property
    def options(self) -> PlanOptions:
        """Options of `simulate` that reproduce the fit's simulation."""
        names = sorted({name.split(".")[0] for name in self.result.effects})
        options: PlanOptions = {"method": self.result.method, "effects": names, "engine": self.result.engine}
        return options if self.result.spacing is None else {**options, "spacing": self.result.spacing}

    def to_dict(self) -> dict[str, Any]:
        """Return the whole result as plain Python values, as `fit.json` holds them."""
        return dict(msgspec.to_builtins(self.result))

    def to_csv(self, path: Path | str | None = None, *, overwrite: bool = False) -> str:
        """Return one row per parameter as CSV, and write it if a path is given.

        overwrite: replace another file of this name

        A parameter that is not identified has no fitted value, only its interval. Numbers keep every digit but rounding
        noise: 0.3 stands for 0.30000000000000004, and no number moves by more than sixteen units in its last place.
        """
        heads = ("parameter", "unit", "initial", "fitted", "interval_low", "interval_high", "is_identified")
        rows = [
            (
                p.name, p.unit, p.initial, None if p.is_identified is False else p.fitted, p.interval_low,
                p.interval_high, p.is_identified,
            )
            for p in self.result.parameters
        ]  # fmt: skip
        return _csv(heads, rows, path, overwrite=overwrite)

    def save(self, path: Path | str, *, overwrite: bool = False) -> Path:
        """Write the result in the format of `fit.json`, atomically; `overwrite` replaces another file."""
        with arguments_named():
            file = path_of(path, "path")
            _refuse_another(file, load_fit_result, self.result, overwrite=overwrite)
            save_fit_result(file, self.result)
        return Path(path)

    def _tables(self) -> list[Table]:
        return fit_tables(self.result)


@dataclass(frozen=True, kw_only=True, repr=False)
class DiagnosisOutcome(_Shown):
    """A diagnosis: the result as `hangtime diagnose` writes it, with its takes and fits.

    training, held_out and findings are absent where the diagnosis was loaded from a file
    """

    result: Diagnosis
    training: tuple[Take, ...] = ()
    held_out: tuple[Take, ...] = ()
    findings: Findings | None = None
    added: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """The verdict: none, effect, ambiguous, several, unknown, numerics or inconclusive."""
        return self.result.verdict

    def to_dict(self) -> dict[str, Any]:
        """Return the whole diagnosis as plain Python values, as `diagnosis.json` holds them."""
        return dict(msgspec.to_builtins(self.result))

    def to_csv(self, path: Path | str | None = None, *, overwrite: bool = False) -> str:
        """Return one row per effect of the library as CSV, and write it if a path is given.

        `amplitude` is the effect's size. An effect that was not tested or whose size is at its bound has none. Where
        `is_refitted` is False, the effect was only screened: the size is a linear estimate, which may lie far beyond
        the effect's range.
        """
        heads = (
            "effect", "is_tested", "is_named", "probability", "amplitude", "unit", "closure", "p_value", "is_refitted",
        )  # fmt: skip
        rows = [
            (
                e.id, e.tested, e.id in self.result.named, e.probability,
                e.amplitude if has_size(e) else None, e.unit,
                e.closure.value if e.closure is not None else None, e.p_value, is_refitted(e),
            )
            for e in self.result.ranked
        ]  # fmt: skip
        return _csv(heads, rows, path, overwrite=overwrite)

    def save(self, path: Path | str, *, overwrite: bool = False) -> Path:
        """Write the diagnosis in the format of `diagnosis.json`, atomically; `overwrite` replaces another file."""
        with arguments_named():
            file = path_of(path, "path")
            _refuse_another(file, load_diagnosis, self.result, overwrite=overwrite)
            save_diagnosis(file, self.result)
        return Path(path)

    def _tables(self) -> list[Table]:
        return [*diagnosis_tables(self.result, self.added), effect_table(self.result)]


@dataclass(frozen=True, kw_only=True, repr=False)
class SimulatedTake:
    """One take and its simulation, in the world frame (z against gravity).

    time [s], (frames,); real, simulated [m], (frames, points, 3), real NaN where not seen
    """

    take_id: str
    point_names: tuple[str, ...]
    time: Floats
    real: Floats
    simulated: Floats
    valid: Booleans

    def __repr__(self) -> str:
        """Return the take's name and the size of its arrays."""
        return f"SimulatedTake({self.take_id!r}, {len(self.time)} frames of {len(self.point_names)} points)"


@dataclass(frozen=True, kw_only=True, repr=False)
class Simulation(_Shown):
    """Takes simulated with one set of parameters, and their distance from the recorded points.

    - `fitted`: parameters of the fit that provides the values; unidentified values are not printed
    - `remarks`: sentences on assumed settings, such as the mesh of an old fit
    """

    takes: tuple[SimulatedTake, ...]
    values: dict[str, float]
    fitted: tuple[FitParameter, ...] = ()
    error: ErrorFigure = field(repr=False)
    by_take: tuple[ErrorFigure, ...] = field(repr=False)
    remarks: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return parameters and errors as plain Python values."""
        errors = {t.take_id: msgspec.to_builtins(e) for t, e in zip(self.takes, self.by_take, strict=True)}
        unsure = [p.name for p in self._unsure]
        return {
            "parameters": dict(self.values), "not_identified": unsure, "error": msgspec.to_builtins(self.error),
            "takes": errors,
        }  # fmt: skip

    @property
    def _unsure(self) -> list[FitParameter]:
        """Return the parameters that the fit's takes do not identify."""
        return [p for p in self.fitted if verdict_on(p)]

    def to_csv(self, path: Path | str | None = None, *, overwrite: bool = False) -> str:
        """Return one row per point and frame as CSV, positions in metres, and write it if a path is given."""
        heads = ("take", "time_s", "point", "x", "y", "z", "real_x", "real_y", "real_z")
        rows = (
            (
                take.take_id, float(take.time[n]), name, *take.simulated[n, k].tolist(),
                *(take.real[n, k].tolist() if take.valid[n, k] else (None, None, None)),
            )
            for take in self.takes
            for n in range(len(take.time))
            for k, name in enumerate(take.point_names)
        )  # fmt: skip
        return _csv(heads, rows, path, overwrite=overwrite)

    def _tables(self) -> list[Table]:
        rows = [error_row(t.take_id, e) for t, e in zip(self.takes, self.by_take, strict=True)]
        unsure = {p.name: f"{interval_words(p)}, {verdict_on(p)}".lstrip(", ") for p in self._unsure}
        values = tuple((name, unsure.get(name, short(value, 4))) for name, value in self.values.items())
        return [
            Table(heads=("take", "mean error", "largest"), rows=(*rows, error_row("all", self.error))),
            Table(heads=("parameter", "value"), rows=values, right=(1,), remarks=self.remarks),
        ]


def _refuse_another(file: Path, load: Callable[[Path], object], result: object, *, overwrite: bool) -> None:
    """Refuse to replace a file that holds anything but this result.

    Raises:
        OutputError: it does, or cannot be replaced; or its name has another ending than those of results.
    """
    check_switches(overwrite=overwrite)
    check_ending(file, *AS_RESULT, may_lack=True)
    if not overwrite and file.is_file():
        with suppress(HangtimeError):
            if load(file) == result:
                return
    if not file.is_dir():  # whoever writes says why it cannot
        refuse_to_replace(file, overwrite=overwrite)


def _csv(heads: tuple[str, ...], rows: Any, path: Path | str | None, *, overwrite: bool) -> str:
    """Return rows as CSV, and write them where a path is given; a file that holds just these rows may stay.

    Raises:
        OutputError: another file is there and is not to be overwritten, its name has another ending, or it cannot be
            written.
    """
    text = csv_text(heads, ([without_noise(one) if isinstance(one, float) else one for one in row] for row in rows))
    if path is not None:
        with arguments_named():
            file = path_of(path, "path")
            check_switches(overwrite=overwrite)
            check_ending(file, *AS_TABLE, may_lack=True)
            make_parent(file)
            refuse_to_replace(file, text, overwrite=overwrite)
            write_text(file, text)
    return text
