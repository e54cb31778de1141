"""Commands and groups of them, built by Typer from functions when they are called."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from inspect import cleandoc
from types import ModuleType
from typing import Any, Literal

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from skillplan.cli import rich_help
from skillplan.cli.options.grouped import grouped
from skillplan.cli.options.shared import OUTPUT
from skillplan.cli.writing import guarded_stdout
from skillplan.errors import nearest
from skillplan.workers.supervised import limit_imports

# Brackets that rich would take for markup, as in [x, y], are written \[x, y].
MARKUP: Literal["rich"] = "rich"
SETTINGS = {"help_option_names": ["-h", "--help"]}
Function = Callable[..., int]
Lists = Callable[[], Mapping[str, Mapping[str, str]]]


class Command(TyperCommand):
    """A command whose help is terse: no types that say nothing, no braces, ``--help`` last.

    Parameters
    ----------
    name
        As it is typed.
    lists
        Returns the panels below the options by title: words, each with its line.
    details
        As `TyperCommand` takes them.
    """

    def __init__(self, name: str | None, *, lists: Lists = dict, **details: Any):
        super().__init__(name, **details)
        self._lists = lists
        for parameter in self.params:
            untyped(parameter)
            absent_unread(parameter)

    def get_help_option(self, ctx: Any) -> Any:
        """Return the option, in the panel of output."""
        option = super().get_help_option(ctx)
        if option is not None:
            option.rich_help_panel = OUTPUT
            untyped(option)
            option.callback = _print_help
        return option

    def invoke(self, ctx: Any) -> Any:
        """Call the command; its time limit also ends a plugin that hangs on import."""
        limit_s = ctx.params.get("time_limit_s")
        limit_imports(None if limit_s is None else 1.2 * limit_s + 2)
        return super().invoke(ctx)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return what the line is made of; what is needed stands without braces."""
        pieces = super().collect_usage_pieces(ctx)
        # That there may be several, as in {RUN...}..., their own word says.
        plain = [one.removesuffix("...") if one.startswith("{") else one for one in pieces]
        return [one[1:-1] if one.startswith("{") else one for one in plain]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help, and the lists below it."""
        rich_help.load()
        with guarded_stdout():
            super().format_help(ctx, formatter)
            for title, lines in self._lists().items():
                _print_panel(title, lines)


class CommandGroup(TyperGroup):
    """A group that names the nearest command where there is no such one."""

    def get_help_option(self, ctx: Any) -> Any:
        """Return the option."""
        option = super().get_help_option(ctx)
        if option is not None:
            untyped(option)
            option.callback = _print_help
        return option

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help."""
        rich_help.load()
        with guarded_stdout():
            super().format_help(ctx, formatter)

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return name, command and the words after it, or name the nearest command."""
        known = self.list_commands(ctx)
        if args and args[0] not in known and not args[0].startswith("-"):
            near = nearest(args[0], known)
            hint = f"Did you mean {near!r}?" if near else f"Known: {', '.join(known)}."
            ctx.fail(f"No such command {args[0]!r}. {hint}")
        return super().resolve_command(ctx, args)


def make_command(
    name: str, function: Function, epilog: str | None = None, lists: Lists | None = None
) -> Any:
    """Return a command by the name, the parameters and the docstring of a function.

    Parameters
    ----------
    name
        As it is typed.
    function
        Takes values or groups of options, as `grouped` has them, and returns the exit code.
    epilog
        Stands below its help.
    lists
        Returns the lists below its options, by title.
    """
    made = typer.Typer(add_completion=False, rich_markup_mode=MARKUP)
    cls: Any = partial(Command, lists=lists) if lists else Command
    made.command(name, cls=cls, help=_flowing(function.__doc__), epilog=epilog)(grouped(function))
    return get_command(made)


def make_group(name: str, text: str, functions: Mapping[str, Function]) -> Any:
    """Return a group of commands.

    Parameters
    ----------
    name
        As it is typed.
    text
        What the group's help says.
    functions
        Name of a command to the function that it calls.
    """
    made = typer.Typer(
        name=name,
        cls=CommandGroup,
        add_completion=False,
        no_args_is_help=True,
        rich_markup_mode=MARKUP,
    )
    made.callback(help=_flowing(text))(_nothing)
    for one, function in functions.items():
        made.command(one, cls=Command, help=_flowing(function.__doc__))(grouped(function))
    return get_command(made)


def of_module(name: str, module: ModuleType) -> Any:
    """Return the command that a module holds as ``command``, or the group by its ``COMMANDS``.

    ``EPILOG`` and the lists of ``list_choices`` of the module, if any, stand below its options.
    """
    if hasattr(module, "COMMANDS"):
        return make_group(name, module.HELP, module.COMMANDS)
    epilog, lists = (getattr(module, one, None) for one in ("EPILOG", "list_choices"))
    return make_command(name, module.command, epilog, lists)


def untyped(parameter: Any) -> None:
    """Leave out of the help that a flag is a bool, and an argument a str."""
    if parameter.param_type_name == "argument":
        parameter.display_type_rich = _no_type
    elif parameter.is_flag:
        parameter.metavar = ""
        # Without a default Typer would load pydantic to see that there is no value.
        parameter.default = bool(parameter.default)


def absent_unread(parameter: Any) -> None:
    """Have an option that is not given stay None: Typer would let pydantic make what reads it."""
    process = parameter.process_value

    def process_value(ctx: Any, value: Any) -> Any:
        single = parameter.nargs == 1 and not parameter.multiple
        if value is None and single and not parameter.required and parameter.callback is None:
            return None
        return process(ctx, value)

    parameter.process_value = process_value


def _print_help(ctx: Any, parameter: Any, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        with guarded_stdout():
            typer.echo(ctx.get_help(), color=ctx.color)
        ctx.exit()


def _no_type(ctx: Any) -> None:
    """Return no type."""


def _print_panel(title: str, lines: Mapping[str, str]) -> None:
    from rich.console import Console
    from rich.panel import Panel
    from rich.table import Table

    table = Table.grid(padding=(0, 2), expand=True)
    table.add_column(style="bold cyan", no_wrap=True)
    table.add_column(ratio=1)
    for word, line in lines.items():
        table.add_row(word, line)
    style = rich_help.load().STYLE_OPTIONS_PANEL_BORDER
    panel = Panel(table, title=title, title_align="left", border_style=style)
    Console().print(panel)


def _flowing(text: str | None) -> str:
    """Return a text whose paragraphs are lines, which the terminal's width breaks."""
    return "\n\n".join(" ".join(one.split()) for one in cleandoc(text or "").split("\n\n"))


def _nothing() -> None:
    """Do nothing: a group alone does nothing."""
