"""Argument checks of the calls, and translation of errors from command line options to arguments."""

from __future__ import annotations

import contextlib
import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, TypedDict, TypeVar, cast, get_type_hints

import numpy as np

from fit.errors import FitError, unknown_name
from formats.errors import HangtimeError, of_system

# Options of the command line, without `--`, and the equivalent arguments.
ARGUMENT_OF_OPTION = {
    "anyway": "anyway=True", "effect": "effects", "out": "checkpoint", "overwrite": "overwrite=True",
}  # fmt: skip
# Options whose arguments have the same name, with `_` in place of `-`.
SAME_AS_OPTION = {
    "add", "bounds", "by", "checkpoint", "engine", "fabric", "fit", "gamma", "held-out", "held-out-motion",
    "iterations", "method", "model", "search", "seed", "spacing", "take", "thickness", "to", "without",
}  # fmt: skip
OPTION = re.compile(r"`[^`]*`|--([a-z]+(?:-[a-z]+)*)")  # commands between backticks stay commands


class PlanOptions(TypedDict, total=False):
    """The fields of a `Plan`, as keyword arguments of `hangtime.fit` and `hangtime.simulate`."""

    method: str
    effects: Sequence[str]
    bounds: Sequence[str]
    search: str
    iterations: int | None
    gamma: float | None
    spacing: float | None
    seed: int
    fabric: str | None
    engine: str


# The defaults of `fit.identification.request.Plan`, which is not imported before a call needs it.
PLAN_DEFAULTS: Mapping[str, object] = {
    "method": "si", "effects": (), "bounds": (), "search": "", "iterations": None,
    "gamma": None, "spacing": None, "seed": 0, "fabric": None, "engine": "own",
}  # fmt: skip
OF_A_SEARCH = {"search", "iterations", "gamma", "seed"}
# The options of a simulation: `...` stands for the value of the given fit.
OF_THE_FIT: Mapping[str, object] = {name: ... for name in PLAN_DEFAULTS if name not in OF_A_SEARCH}
_Call = TypeVar("_Call", bound=Callable[..., object])


def options_shown(defaults: Mapping[str, object] | None = None) -> Callable[[_Call], _Call]:
    """Return a decorator: `help` then shows each option with its kind and default, instead of `**options`."""

    def shown(call: _Call) -> _Call:
        own = inspect.signature(call, eval_str=True)
        kinds = get_type_hints(PlanOptions)
        options = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kinds[name])
            for name, default in (defaults or {}).items()
        ]
        plain = [one for one in own.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
        vars(call)["__signature__"] = own.replace(parameters=[*plain, *options])
        return call

    return shown


def names_checked(call: _Call) -> _Call:
    """Decorate a call: a keyword that is none of its arguments is refused with all of them, the nearest first.

    Raises:
        FitError: by the decorated call, names the keyword.
    """
    known = list(inspect.signature(call).parameters)

    @functools.wraps(call)
    def named(*arguments: Any, **keywords: Any) -> object:
        for name in keywords:
            if name not in known:
                raise unknown_name("argument", name, known, where=call.__name__, listed="its arguments")
        return call(*arguments, **keywords)

    return cast("_Call", named)


def checked(options: PlanOptions) -> dict[str, Any]:
    """Check the options and return them, with lists of names as tuples.

    Raises:
        FitError: a value of the wrong type.
    """
    given: dict[str, Any] = dict(options)
    for name in given.keys() & {"effects", "bounds"}:
        given[name] = tuple(names_of(given[name], name))
    for name in given.keys() & {"method", "search", "engine"}:
        check_text(given[name], name)
    if given.get("fabric") is not None:
        check_text(given["fabric"], "fabric")
    for name in given.keys() & {"gamma", "spacing"}:
        given[name] = number_of(given[name], name)
    return given


def names_of(names: str | Sequence[str], name: str) -> list[str]:
    """Return names as a list; a single text is one name.

    Raises:
        FitError: the names are no texts.
    """
    if isinstance(names, str):
        return [names]
    is_range, texts = name == "bounds", "NAME=LOW:HIGH, one text a parameter"
    check_kind(names, name, (list, tuple, set, frozenset), texts if is_range else "a text or a list of texts")
    for one in names:
        check_kind(one, name, str, texts if is_range else "a list of texts", is_in_list=True)
    return list(names)


def number_of(value: float | None, name: str) -> float | None:
    """Return a number as a plain Python number; None is the default.

    Raises:
        FitError: the value is no number.
    """
    if value is None:
        return None
    check_kind(value, name, Real, "a number")
    return float(value)


def path_of(path: Path | str, name: str, wanted: str = "the path of a file") -> Path:
    """Return the path of a file or folder.

    Raises:
        FitError: the value is no path, or the path has no name.
    """
    check_kind(path, name, (str, PathLike), wanted)
    if not Path(path).name or "\0" in str(path):
        raise FitError(f"{str(path)!r} is the name of no file", where=name, advice=f"give {wanted}")
    return Path(path)


def check_text(value: object, name: str) -> None:
    """Refuse a value that is no text, as `check_kind` does."""
    check_kind(value, name, str, "a text")


def check_kind(
    value: object, name: str, kinds: type | tuple[type, ...], wanted: str, *, is_in_list: bool = False
) -> None:
    """Refuse an argument of the wrong type; True and False are no numbers.

    is_in_list: whether the value is one of the list that is the argument

    Raises:
        FitError: names the argument, its type and the expected type.
    """
    if isinstance(value, bool) or not isinstance(value, kinds):
        kind = kind_of(value)
        what = f"holds {'a value ' * (value is not None)}{kind}" if is_in_list else f"is {kind}"
        raise FitError(what, where=name, advice=f"give {wanted}")


def kind_of(value: object) -> str:
    """Return the type of a value in words, for a sentence on an argument that cannot be used."""
    return "None" if value is None else f"of the kind {type(value).__name__}"


def check_switches(**values: object) -> None:
    """Refuse arguments that are neither True nor False: "no" and 0.5 would count as True.

    Raises:
        FitError: names the first such argument, and its type.
    """
    for name, value in values.items():
        if not isinstance(value, bool | np.bool_):
            raise FitError(f"is {kind_of(value)}", where=name, advice="give True or False")


@contextlib.contextmanager
def arguments_named() -> Iterator[None]:
    """Context in which errors name Python arguments instead of options, and files that the system refuses.

    Raises:
        HangtimeError: replaces a system error that names a file.
    """
    try:
        yield
    except OSError as error:
        if (spoken := of_system(error)) is None:
            raise
        raise spoken from error
    except HangtimeError as error:
        where = as_argument(error.where) if isinstance(error.where, str) else error.where
        HangtimeError.__init__(error, as_argument(error.what), where=where, advice=as_argument(error.advice))
        raise


def as_argument(text: str) -> str:
    """Return a text with its options replaced by the equivalent arguments."""

    def renamed(found: re.Match[str]) -> str:
        option = found[1]
        if option in SAME_AS_OPTION:
            return option.replace("-", "_")
        return ARGUMENT_OF_OPTION.get(option, found[0]) if option else found[0]

    return OPTION.sub(renamed, text)
