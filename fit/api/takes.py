"""Read the takes that a call or a command names, and sort them into those to fit to and those to judge on."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from fit.api.arguments import check_kind, kind_of, names_of, path_of
from fit.errors import FitError
from formats.archive import read_take
from formats.blocks import check_columns, columns_of
from formats.descriptions import check_garment, check_rig
from formats.errors import TakeError
from formats.fault_words import STILL_WRITTEN
from formats.plain_text import plain
from formats.plausible import check_plausible_take
from formats.system_causes import step_to_read
from formats.take import Take
from formats.terminal import say

if TYPE_CHECKING:
    from fit.cloth.effect import Effect

OneTake = Take | Path | str
Takes = OneTake | Sequence[OneTake]


def library_of(add: Sequence[str], without: Sequence[str]) -> tuple[Effect, ...]:
    """Return the library of effects for a diagnosis.

    Raises:
        FitError: an unknown effect, or one that is both added and left out.
    """
    from fit.effects import find_effects, library_without

    find_effects(list(add), "--add")
    if both := sorted({*add} & {*without}):
        raise FitError(f"{both[0]} is to be added and left out", where="--without", advice="give one of the two")
    return library_without(list(without))


def sorted_out(
    takes: Takes,
    held_out: Takes = (),
    held_out_motion: Sequence[str] = (),
    *,
    anyway: bool = False,
    spacing: float | None = None,
) -> tuple[list[Take], list[Take]]:
    """Return fitted and held-out takes, reading those given as paths.

    - `anyway`: accept implausible takes
    - `spacing`: of the mesh [m] that they are simulated on, None for a default

    Raises:
        HangtimeError: an archive cannot be read, a take is implausible, no take moves in a kind to be held out, or no
            such mesh can be made of the garment.
    """
    from fit.cloth.mesh import check_mesh
    from fit.recordings.selection import split_by_motion

    kinds = names_of(held_out_motion, "held_out_motion")
    given, given_to_judge = _each(takes, "takes"), _each(held_out, "held_out")
    check_there([*given, *given_to_judge])
    for name, one in [*(("takes", one) for one in given), *(("held_out", one) for one in given_to_judge)]:
        check_kind(one, name, (Take, str, PathLike), "a take or the path of one", is_in_list=True)
    every = [one_take(take, "takes") for take in given]
    judged = [one_take(take, "held_out") for take in given_to_judge]
    if not anyway:
        for take in every + judged:
            check_plausible_take(take, take.take_id, offers_anyway=True)
    training, moving = split_by_motion(every, kinds)
    if training and spacing is not None:
        check_mesh(training[0].garment, spacing)
    return training, moving + judged


def check_there(takes: Iterable[object]) -> None:
    """Refuse the path of a take where no file is, before any take is read.

    takes: other values than paths are passed over

    Raises:
        TakeError: names the first such path.
    """
    for take in takes:
        if isinstance(take, str | PathLike) and Path(take).name:  # `path_of` refuses others
            try:
                os.stat(take)
            except ValueError:  # a null character, which `path_of` refuses
                continue
            except OSError as error:
                what = f"cannot be read ({error.strerror})"
                raise TakeError(what, where=Path(take), advice=step_to_read(error)) from error


def _each(takes: Takes, name: str) -> list[OneTake]:
    """Return the takes of an argument as they were given, none of them read yet."""
    if isinstance(takes, Take | PathLike | str):
        return [takes]
    wanted = "a take, the path of one, or a list of them"
    check_kind(takes, name, Iterable, wanted)
    if isinstance(takes, Mapping | bytes | bytearray):  # their items are no takes
        raise FitError(f"is {kind_of(takes)}", where=name, advice=f"give {wanted}")
    return list(takes)


def one_take(take: OneTake, name: str) -> Take:
    """Return a take, read where its path is given, and checked where it may have been made or changed in memory."""
    if isinstance(take, Take):
        _check_in_memory(take)
        return take
    return read_take(path_of(take, name, "a take or the path of one"))


def _check_in_memory(take: Take) -> None:
    """Refuse a take that no file could hold, by the rules of its writer.

    Raises:
        TakeError: names the frame, such as one whose time does not increase, or the array of another shape.
        DescriptionError: an impossible rig or garment; names the field.
    """
    check_garment(take.garment, take.take_id)
    check_rig(take.rig, take.take_id)
    columns = columns_of(vars(take), take.take_id)
    check_columns(columns, points=len(take.garment.points), take_id=take.take_id, first=0, after=-math.inf)


def say_takes(training: list[Take], testing: list[Take], spacing: float | None = None) -> None:
    """Report the fitted and the judged takes of a command after all checks, and the cost of a fine mesh.

    spacing: of the mesh [m], None for a default
    """
    from fit.cloth.mesh import cost_words

    judging = f"judging on {_listed(testing)}" if testing else "judging on the same, as none is held out"
    say(f"Fitting to {_listed(training)}; {judging}.{cost_words(training[0].garment, spacing)}")
    for take in [*training, *testing]:
        if take.report is not None and take.report.is_being_written:
            say(f"Warning: {plain(take.report.file)}: {STILL_WRITTEN}")


def _listed(takes: list[Take]) -> str:
    return ", ".join(plain(t.take_id) for t in takes)
