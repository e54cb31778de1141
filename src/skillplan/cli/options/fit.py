"""Options that fit one kind of argument only: a task file, a result, or a folder of runs."""

from __future__ import annotations

from collections.abc import Iterable

import typer

from skillplan.errors import OptionError


def given(ctx: typer.Context, name: str) -> bool:
    """Return whether a parameter stands on the command line."""
    source = ctx.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def refuse_given(ctx: typer.Context, names: Iterable[str], why: str) -> None:
    """See that some options have not been given on the command line.

    Parameters
    ----------
    ctx
        Of the command.
    names
        Names of its parameters.
    why
        What they are for instead, such as ``is for a task file``.

    Raises
    ------
    OptionError
        If one has been.
    """
    flags = {one.name: one.opts[0] for one in ctx.command.params}
    for name in names:
        if given(ctx, name):
            raise OptionError(f"{flags[name]} {why}.")
