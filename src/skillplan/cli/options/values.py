"""Parsers of option values, and the check that the options fit the input of a command."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from inspect import signature
from typing import Any, NamedTuple, get_type_hints

import typer

from skillplan.errors import OptionError

Mode = Callable[..., int]


def is_given(ctx: typer.Context, name: str) -> bool:
    """Return True if a parameter is given on the command line."""
    source = ctx.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def check_options(ctx: typer.Context, mode: Mode, inputs: Mapping[Mode, str]) -> None:
    """Refuse options that the function for this input does not take.

    Parameters
    ----------
    mode
        The function for the input at hand.
    inputs
        All functions of the command, each with the input that it is for, such as "a task file".

    Raises
    ------
    OptionError
        If another option is given; the message names the inputs it is for.
    """
    taken = {function: _option_names(function) for function in inputs}
    for parameter in ctx.command.params:
        name = parameter.name or ""
        if parameter.param_type_name != "option" or name in taken[mode]:
            continue
        if is_given(ctx, name):
            *others, last = [text for function, text in inputs.items() if name in taken[function]]
            owners = f"{', '.join(others)} or {last}" if others else last
            raise OptionError(f"{parameter.opts[0]} is for {owners}, not for {inputs[mode]}.")


def _option_names(function: Mode) -> set[str]:
    """Return the parameters of a function; groups of options count by their fields."""
    hints: dict[str, Any] = get_type_hints(function)
    names: set[str] = set()
    for name in signature(function).parameters:
        group = hints[name]
        names |= {field.name for field in fields(group)} if is_dataclass(group) else {name}
    return names


_LEAST_BYTES = 64 * 1024**2
_UNITS = {
    "": 1,
    "B": 1,
    "KB": 10**3,
    "MB": 10**6,
    "GB": 10**9,
    "TB": 10**12,
    "KIB": 2**10,
    "MIB": 2**20,
    "GIB": 2**30,
    "TIB": 2**40,
}
_SIZE = re.compile(r"(\d+(?:\.\d+)?) ?([A-Za-z]*)", re.ASCII)


def option(form: str, panel: str, text: str, **details: Any) -> Any:
    """Return an option of the command line.

    Parameters
    ----------
    form
        The flag and its value as the help shows them, such as ``--out FILE``.
    panel
        Heading of the help under which it stands.
    text
        Help text.
    details
        Keywords of `typer.Option`.
    """
    flag, _, metavar = form.partition(" ")
    return typer.Option(flag, metavar=metavar or None, help=text, rich_help_panel=panel, **details)


def count_option(*flags: str, minimum: int, maximum: int, text: str, **details: Any) -> Any:
    """Return an option that takes a whole number N.

    Parameters
    ----------
    flags
        Names such as ``--jobs``.
    minimum, maximum
        The range, both included, which the help shows.
    text
        Help text.
    details
        Keywords of `typer.Option`.
    """
    text = f"{text.rstrip('.')}; {minimum:,} to {maximum:,}."
    parser = whole_number(minimum, maximum)
    return typer.Option(*flags, parser=parser, help=text, **{"metavar": "N", **details})


def whole_number(minimum: int, maximum: int) -> Callable[[str | int], int]:
    """Return a parser of whole numbers in a range, both ends included.

    It raises `typer.BadParameter` for anything else.
    """

    def parse(value: str | int) -> int:
        try:
            number = int(value)
        except ValueError:
            raise typer.BadParameter(f"{value!r} is not a whole number.") from None
        if not minimum <= number <= maximum:
            raise typer.BadParameter(f"{number} is not in the range {minimum}<=x<={maximum}.")
        return number

    return parse


def positive_number(most: float = math.inf) -> Callable[[str | float], float]:
    """Return a parser of finite numbers above 0 and at most `most`.

    It raises `typer.BadParameter` for anything else, NaN included.
    """

    def parse(value: str | float) -> float:
        number = _number(value)
        if most < math.inf and not 0 < number <= most:
            raise typer.BadParameter(f"must be above 0 and at most {most:g}, not {value}.")
        if not (math.isfinite(number) and number > 0):
            raise typer.BadParameter(f"must be a finite number > 0, not {value}.")
        return number

    return parse


def positive_seconds(value: str | float) -> float:
    """Return a finite number of seconds above 0.

    Raises
    ------
    typer.BadParameter
        For anything else.
    """
    number = _number(value, "number of seconds")
    if not (math.isfinite(number) and number > 0):
        raise typer.BadParameter(f"must be a finite number > 0, not {value}.")
    return number


def fraction(value: str | float) -> float:
    """Return a number from 0 to 1.

    Raises
    ------
    typer.BadParameter
        For anything else, NaN included.
    """
    number = _number(value)
    if not 0 <= number <= 1:
        raise typer.BadParameter(f"must be from 0 to 1, not {value}.")
    return number


class Probabilities(NamedTuple):
    """The smallest and the largest of some probabilities."""

    lowest: float
    greatest: float


def probabilities(value: str | Probabilities) -> Probabilities:
    """Return two probabilities in [0, 1), given as LEAST:GREATEST, or as one for both.

    Raises
    ------
    typer.BadParameter
        For anything else.
    """
    if isinstance(value, Probabilities):
        return value
    lowest, colon, greatest = value.partition(":")
    bounds = Probabilities(fraction(lowest), fraction(greatest if colon else lowest))
    if not bounds.lowest <= bounds.greatest < 1:
        raise typer.BadParameter(f"must be LEAST:GREATEST below 1, such as 0.1:0.4, not {value}.")
    return bounds


def memory_size(value: str | int) -> int:
    """Return a size of memory [B], at least 64MiB, given in bytes or with a unit such as GiB or MB.

    Raises
    ------
    typer.BadParameter
        For anything else.
    """
    if isinstance(value, int):
        return value
    match = _SIZE.fullmatch(value)
    factor = None if match is None else _UNITS.get(match[2].upper())
    if match is None or factor is None:
        raise typer.BadParameter(
            f"{value!r} is no size of memory. Write it as 2GiB, 512MiB, 1.5GB or in bytes."
        )
    if len(match[1]) > 24:
        raise typer.BadParameter("is more memory than any machine has.")
    size = int(float(match[1]) * factor)
    if size < _LEAST_BYTES:
        raise typer.BadParameter(f"must be at least 64MiB, not {value}.")
    return size


def one_of(choices: Sequence[str]) -> Callable[[str], str]:
    """Return a parser of some words, which raises `typer.BadParameter` for any other."""

    def parse(value: str) -> str:
        if value not in choices:
            known = ", ".join(map(repr, choices))
            raise typer.BadParameter(f"{value!r} is not one of {known}.")
        return value

    return parse


def _number(value: str | float, what: str = "number") -> float:
    try:
        return float(value)
    except ValueError:
        raise typer.BadParameter(f"{value!r} is not a {what}.") from None


def parse_options(entries: Iterable[str], solver: str | None) -> dict[str, dict[str, Any]]:
    """Return plugin name to options, from ``[PLUGIN.]KEY=VALUE`` entries.

    Raises
    ------
    OptionError
        If an entry has another form, or names no plugin and there are several solvers.
    """
    parsed: dict[str, dict[str, Any]] = {}
    for entry in entries:
        key, equals, value = entry.partition("=")
        plugin, dot, name = key.rpartition(".")
        if not equals or not name:
            raise OptionError(f"Option {entry!r} must have the form [PLUGIN.]KEY=VALUE.")
        if not dot:
            if solver is None:
                raise OptionError(f"Option {entry!r} must name its plugin: PLUGIN.{entry}.")
            plugin = solver
        parsed.setdefault(plugin, {})[name] = value
    return parsed


def split_names(text: str) -> list[str]:
    """Return the distinct names of a list separated by commas, in order."""
    return list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
