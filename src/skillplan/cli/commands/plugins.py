"""``skillplan plugins``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from skillplan.cli.options.completion import plugin_names
from skillplan.cli.options.shared import Style


def _complete_kind(incomplete: str) -> list[str]:
    from skillplan.pipeline import registry

    return [kind for kind in registry.KINDS if kind.startswith(incomplete)]


def _complete_name(ctx: typer.Context, incomplete: str) -> list[str]:
    from skillplan.errors import PluginError

    try:
        return plugin_names(ctx.params.get("kind") or "")(incomplete)
    except PluginError:
        return []


def command(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="KIND",
            autocompletion=_complete_kind,
            help="Kind of plugin, such as solver or collision.",
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", autocompletion=_complete_name, help="Name of a plugin."),
    ] = None,
    style: Style = "table",
) -> int:
    """List installed plugins, of one KIND if given; with NAME, the plugin's options."""
    from skillplan.cli.output import emit
    from skillplan.pipeline import registry
    from skillplan.pipeline.registry import plugin_document
    from skillplan.views.tables.installation import tabulate_plugins

    kinds = [kind] if kind else list(registry.KINDS)
    infos = [info for kind_name in kinds for info in registry.describe(kind_name)]
    if not kind:
        infos += registry.describe_unreadable()
    options, presets = None, dict[str, Mapping[str, Any]]()
    if kind and name:
        plugin = registry.load(kind, name)
        infos = [info for info in infos if info.name == name]
        options, presets = getattr(plugin, "Options", None), getattr(plugin, "presets", {})
    emit(style, plugin_document(infos, options), tabulate_plugins(infos, options, presets))
    return 0
