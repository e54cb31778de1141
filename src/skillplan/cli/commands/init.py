"""``skillplan init``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.options.completion import example_names, plugin_names
from skillplan.cli.options.shared import OUTPUT
from skillplan.cli.options.values import option


def command(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            autocompletion=plugin_names("domain"),
            help="Kind of task, such as assembly or sop.",
        ),
    ] = "assembly",
    example: Annotated[
        str | None,
        typer.Option(
            "--example",
            metavar="NAME",
            autocompletion=example_names,
            help="Start from a whole cell, such as gearbox, pcb or pump, with its meshes.",
        ),
    ] = None,
    out: Annotated[str | None, option("--out FILE", OUTPUT, "New file. Default: stdout.")] = None,
) -> int:
    """Write a commented, valid task file of KIND as a starting point."""
    import shlex

    from skillplan.cli.output import write_new_file, write_new_files_beside
    from skillplan.cli.writing import write_out
    from skillplan.errors import OptionError
    from skillplan.pipeline import read_example, registry

    files: dict[str, bytes] = {}
    if example is None:
        domain = registry.load("domain", kind)()
        text, suffix, title = domain.starter(), domain.starter_suffix, f"a task of kind {kind}"
    else:
        text, files = read_example(example)
        suffix, title = ".yaml", f"the example {example}"
    if out is None:
        if files:
            first, *others = files
            words = f" and {len(others)} more files" if others else ""
            raise OptionError(f"--example {example} needs {first}{words}. Give --out FILE.")
        write_out(text)
        return 0
    suffixes = (".yaml", ".yml") if suffix == ".yaml" else (suffix,)
    write_new_files_beside(out, files, suffixes, "task files")
    write_new_file(out, text, suffixes, "task files")
    named = shlex.quote(out)
    with_them = f", with {len(files)} other file{'s' * (len(files) > 1)}" if files else ""
    write_out(
        f"{out}: {title}{with_them}. Next:\n"
        f"  skillplan check {named}\n"
        f"  skillplan search-optimal {named}\n"
    )
    return 0
