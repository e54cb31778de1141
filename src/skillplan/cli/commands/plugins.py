"""``skillplan plugins``."""

from __future__ import annotations

import click
from click.shell_completion import CompletionItem

from skillplan.cli.options import format_option


def _complete_name(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    from skillplan.errors import PluginError
    from skillplan.pipeline import registry

    try:
        names = registry.names(ctx.params.get("kind") or "")
    except PluginError:
        return []
    return [CompletionItem(name) for name in names if name.startswith(incomplete)]


def _complete_kind(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    from skillplan.pipeline import registry

    return [CompletionItem(kind) for kind in registry.KINDS if kind.startswith(incomplete)]


@click.command("plugins")
@click.argument("kind", required=False, shell_complete=_complete_kind)
@click.argument("name", required=False, shell_complete=_complete_name)
@format_option
def command(kind: str | None, name: str | None, style: str) -> int:
    """List installed plugins, of one KIND if given; with NAME, the plugin's options."""
    from skillplan.cli.output import emit
    from skillplan.pipeline import registry
    from skillplan.records.plugin_info import plugin_document
    from skillplan.views.tables.plugins import plugin_tables

    kinds = [kind] if kind else list(registry.KINDS)
    infos = [info for one in kinds for info in registry.describe(one)]
    options = None
    if kind and name:
        plugin = registry.load(kind, name)
        infos = [info for info in infos if info.name == name]
        options = getattr(plugin, "Options", None)
    emit(style, plugin_document(infos, options), plugin_tables(infos, options))
    return 0
