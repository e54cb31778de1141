"""``skillplan schema``."""

from __future__ import annotations

from typing import Annotated

import typer

from skillplan.cli.options.completion import plugin_names


def command(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND", autocompletion=plugin_names("domain"), help="A kind of task."
        ),
    ] = "assembly",
) -> int:
    """Print the JSON Schema of task files of KIND, by default assembly, for editors."""
    from skillplan.cli.writing import as_json, write_out
    from skillplan.pipeline import registry

    schema = registry.load("domain", kind).Config.model_json_schema(by_alias=True)
    dialect = "https://json-schema.org/draft/2020-12/schema"
    document = {"$schema": dialect, "$id": f"skillplan.task.{kind}/1", **schema}
    write_out(f"{as_json(document)}\n")
    return 0
