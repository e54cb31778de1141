"""The commands with their options out of the command line's own objects, as Markdown."""

from __future__ import annotations

import inspect
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

PROGRAM = "skillplan"


def group() -> Any:
    """Return the group of all commands."""
    from skillplan.cli.app import app

    if hasattr(app, "list_commands"):
        return app
    import typer

    return typer.main.get_command(app)


def commands(parent: Any = None, prefix: str = PROGRAM) -> Iterator[tuple[str, Any, Any]]:
    """Yield every command as (its words, itself, its context); groups before their commands."""
    parent = parent or group()
    context = parent.context_class(parent, info_name=prefix)
    for name in parent.list_commands(context):
        command = parent.get_command(context, name)
        own = command.context_class(command, info_name=name, parent=context)
        yield f"{prefix} {name}", command, own
        if hasattr(command, "list_commands"):
            yield from commands(command, f"{prefix} {name}")


def page() -> str:
    """Build a section for each command: usage, description, arguments and options."""
    return "\n\n".join(_section(*command) for command in commands())


def option_names() -> set[str]:
    """Return every long option of every command, ``--help`` aside."""
    return {
        word
        for _, command, _ in commands()
        for parameter in command.params
        for word in (*parameter.opts, *parameter.secondary_opts)
        if word.startswith("--") and not getattr(parameter, "hidden", False)
    } - {"--help"}


def _section(words: str, command: Any, context: Any) -> str:
    depth = words.count(" ") + 1
    lines = [f"{'#' * depth} {words}", "", "```text", _usage(words, command, context), "```", ""]
    lines.append(_prose(command.help or ""))
    panels: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for parameter in command.params:
        if getattr(parameter, "hidden", False):
            continue
        names, meaning = _record(parameter, context)
        if names:
            panels[getattr(parameter, "rich_help_panel", None) or ""].append((names, meaning))
    for panel, rows in panels.items():
        lines += ["", f"**{panel}**", ""] if panel else [""]
        lines += ["| option | does |", "|---|---|"]
        lines += [f"| {_cell(names, code=True)} | {_cell(meaning)} |" for names, meaning in rows]
    return "\n".join(lines)


def _usage(words: str, command: Any, context: Any) -> str:
    pieces = command.collect_usage_pieces(context)
    return " ".join([words, *pieces])


def _record(parameter: Any, context: Any) -> tuple[str, str]:
    """Return the spelling of a parameter, and its meaning with default and range."""
    record = parameter.get_help_record(context)
    return record if record else ("", "")


def _cell(text: str, *, code: bool = False) -> str:
    flat = " ".join(text.split()).replace("|", "\\|")
    if code:
        return f"`{flat}`"
    return flat.replace("<", "&lt;").replace("*", "\\*").replace("[default:", "\\[default:")


def _prose(text: str) -> str:
    r"""Return a help text's paragraphs; lines after ``\b`` are kept."""
    paragraphs = []
    for paragraph in inspect.cleandoc(text.partition("\f")[0]).split("\n\n"):
        if paragraph.startswith("\b"):
            paragraphs.append(f"```text\n{paragraph[1:].strip(chr(10))}\n```")
        else:
            paragraphs.append(paragraph.replace("<", "&lt;").replace("*", "\\*"))
    return "\n\n".join(paragraphs)
