"""Options that fit one kind of argument only: a task file, or a folder of training runs."""

from __future__ import annotations

from collections.abc import Iterable

import click
from click.core import ParameterSource

from skillplan.errors import OptionError


def refuse_given(ctx: click.Context, names: Iterable[str], why: str) -> None:
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
        if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise OptionError(f"{flags[name]} {why}.")
