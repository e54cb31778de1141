"""Checks that options fit the input of a command: a task file, a result or a folder of runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from inspect import signature
from typing import Any, get_type_hints

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
