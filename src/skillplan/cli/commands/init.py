"""``skillplan init``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.options.completion import plugin_names
from skillplan.cli.options.shared import OUTPUT


def command(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            autocompletion=plugin_names("domain"),
            help="Kind of task, such as assembly or sop.",
        ),
    ] = "assembly",
    out: Annotated[
        str | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="New file. Default: stdout.",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
) -> int:
    """Write a commented, valid task file of KIND as a starting point."""
    import shlex

    from skillplan.cli.output import write_new_file
    from skillplan.cli.writing import write_out
    from skillplan.pipeline import registry

    domain = registry.load("domain", kind)()
    text = domain.starter()
    if out is None:
        write_out(text)
        return 0
    suffix = domain.starter_suffix
    suffixes = (".yaml", ".yml") if suffix == ".yaml" else (suffix,)
    write_new_file(out, text, suffixes, "task files")
    named = shlex.quote(out)
    write_out(
        f"{out}: a task of kind {kind}. Next:\n"
        f"  skillplan check {named}\n"
        f"  skillplan search-optimal {named}\n"
    )
    return 0
