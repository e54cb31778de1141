"""``skillplan schema``."""

from __future__ import annotations

import click
from click.shell_completion import CompletionItem


def _complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from skillplan.pipeline import registry

    return [CompletionItem(n) for n in registry.names("domain") if n.startswith(incomplete)]


@click.command("schema")
@click.argument("kind", default="assembly", shell_complete=_complete)
def command(kind: str) -> int:
    """Print the JSON Schema of task files of KIND, by default assembly, for editors."""
    from skillplan.cli.output import as_json
    from skillplan.cli.writing import write_out
    from skillplan.pipeline import registry

    schema = registry.load("domain", kind).Config.model_json_schema(by_alias=True)
    dialect = "https://json-schema.org/draft/2020-12/schema"
    document = {"$schema": dialect, "$id": f"skillplan.task.{kind}/1", **schema}
    write_out(f"{as_json(document)}\n")
    return 0
