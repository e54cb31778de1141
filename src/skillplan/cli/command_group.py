"""Commands and groups of them, built by Typer from functions when they are called.

A parameter whose type is a dataclass is a group of options: the command line shows its fields.
``typer.rich_utils`` is loaded without rich's Markdown and traceback, which import markdown-it and
pygments and take more than half of the time of ``skillplan --help``. Our help is rich markup, and
`skillplan.cli.error_report` reports our errors, so that neither is ever called.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import partial, wraps
from inspect import Parameter, cleandoc, signature
from types import ModuleType
from typing import Any, Literal, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from skillplan.cli.options.shared import OUTPUT
from skillplan.cli.writing import guard_stdout
from skillplan.errors import nearest
from skillplan.workers.supervised import limit_imports

# Brackets that rich would take for markup, as in [x, y], are written \\[x, y].
MARKUP: Literal["rich"] = "rich"
SETTINGS = {"help_option_names": ["-h", "--help"]}
_RICH = "typer.rich_utils"
# Classes that Typer imports by module, and never calls for us.
_UNUSED = {"rich.markdown": "Markdown", "rich.traceback": "Traceback"}
Function = Callable[..., int]
Lists = Callable[[], Mapping[str, Mapping[str, str]]]


class Command(TyperCommand):
    """A command with terse help: no redundant types, no braces, ``--help`` last.

    Parameters
    ----------
    name
        Name on the command line.
    lists
        Returns the panels below the options by title: words, each with its description.
    details
        Keywords of `TyperCommand`.
    """

    def __init__(self, name: str | None, *, lists: Lists = dict, **details: Any):
        super().__init__(name, **details)
        self._lists = lists
        for parameter in self.params:
            hide_type(parameter)
            skip_absent(parameter)

    def get_help_option(self, ctx: Any) -> Any:
        """Return the help option, in the panel of output."""
        option = super().get_help_option(ctx)
        if option is not None:
            option.rich_help_panel = OUTPUT
            hide_type(option)
            option.callback = _print_help
        return option

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the words of the usage line, with required arguments in no braces."""
        pieces = super().collect_usage_pieces(ctx)
        # In {RUN...}... the word itself has the dots.
        return [
            piece.removesuffix("...")[1:-1] if piece.startswith("{") else piece for piece in pieces
        ]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help, and the lists below it."""
        load_rich_utils()
        with guard_stdout():
            super().format_help(ctx, formatter)
            for title, lines in self._lists().items():
                _print_panel(title, lines)


class CommandGroup(TyperGroup):
    """A group that suggests the nearest command for an unknown one."""

    def get_help_option(self, ctx: Any) -> Any:
        """Return the help option."""
        option = super().get_help_option(ctx)
        if option is not None:
            hide_type(option)
            option.callback = _print_help
        return option

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help."""
        load_rich_utils()
        with guard_stdout():
            super().format_help(ctx, formatter)

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return name, command and the words after it, or suggest the nearest command."""
        known = self.list_commands(ctx)
        if args and args[0] not in known and not args[0].startswith("-"):
            near = nearest(args[0], known)
            hint = f"Did you mean {near!r}?" if near else f"Known: {', '.join(known)}."
            ctx.fail(f"No such command {args[0]!r}. {hint}")
        return super().resolve_command(ctx, args)


def make_command(
    name: str, function: Function, epilog: str | None = None, lists: Lists | None = None
) -> Any:
    """Return a command with the parameters and the docstring of a function.

    Parameters
    ----------
    name
        Name on the command line.
    function
        Takes values or groups of options, and returns the exit code.
    epilog
        Text below the help.
    lists
        Returns the lists below the options, by title.
    """
    builder = typer.Typer(add_completion=False, rich_markup_mode=MARKUP)
    cls: Any = partial(Command, lists=lists) if lists else Command
    text = _join_lines(function.__doc__)
    builder.command(name, cls=cls, help=text, epilog=epilog)(expand_groups(function))
    return get_command(builder)


def make_group(name: str, text: str, functions: Mapping[str, Function]) -> Any:
    """Return a group of commands.

    Parameters
    ----------
    name
        Name on the command line.
    text
        Help of the group.
    functions
        The function of each command by name.
    """
    builder = typer.Typer(
        name=name,
        cls=CommandGroup,
        add_completion=False,
        no_args_is_help=True,
        rich_markup_mode=MARKUP,
    )
    builder.callback(help=_join_lines(text))(_do_nothing)
    for command, function in functions.items():
        help_text = _join_lines(function.__doc__)
        builder.command(command, cls=Command, help=help_text)(expand_groups(function))
    return get_command(builder)


def make_from_module(name: str, module: ModuleType) -> Any:
    """Return the ``command`` of a module, or the group of its ``COMMANDS``.

    ``EPILOG`` and ``list_choices`` of the module, if any, become text and lists below the options.
    """
    if hasattr(module, "COMMANDS"):
        return make_group(name, module.HELP, module.COMMANDS)
    epilog, lists = (getattr(module, name, None) for name in ("EPILOG", "list_choices"))
    return make_command(name, module.command, epilog, lists)


def hide_type(parameter: Any) -> None:
    """Leave out of the help that a flag is a bool, and an argument a str."""
    if parameter.param_type_name == "argument":
        parameter.display_type_rich = lambda ctx: None
    elif parameter.is_flag:
        parameter.metavar = ""
        # Without a default Typer would load pydantic to find the value missing.
        parameter.default = bool(parameter.default)


def skip_absent(parameter: Any) -> None:
    """Leave an absent option None, as Typer would load pydantic to build its parser."""
    process = parameter.process_value

    def process_value(ctx: Any, value: Any) -> Any:
        single = parameter.nargs == 1 and not parameter.multiple
        if value is None and single and not parameter.required and parameter.callback is None:
            return None
        return process(ctx, value)

    parameter.process_value = process_value


def _print_help(ctx: Any, parameter: Any, is_given: bool) -> None:
    if is_given and not ctx.resilient_parsing:
        with guard_stdout():
            typer.echo(ctx.get_help(), color=ctx.color)
        ctx.exit()


def _print_panel(title: str, lines: Mapping[str, str]) -> None:
    from rich.console import Console
    from rich.panel import Panel
    from rich.table import Table

    table = Table.grid(padding=(0, 2), expand=True)
    table.add_column(style="bold cyan", no_wrap=True)
    table.add_column(ratio=1)
    for word, line in lines.items():
        table.add_row(word, line)
    style = load_rich_utils().STYLE_OPTIONS_PANEL_BORDER
    panel = Panel(table, title=title, title_align="left", border_style=style)
    Console().print(panel)


def _join_lines(text: str | None) -> str:
    """Return a text with one line for each paragraph, which the terminal wraps."""
    return "\n\n".join(" ".join(part.split()) for part in cleandoc(text or "").split("\n\n"))


def _do_nothing() -> None:
    """Do nothing: a group needs a callback."""


def expand_groups(function: Function) -> Function:
    """Return a function whose parameters are the fields of the option groups of another.

    It sets the time limit of imports, because a plugin may hang when it is imported.
    """
    hints = get_type_hints(function, include_extras=True)
    parameters: list[Parameter] = []
    groups: dict[str, Any] = {}
    for name, parameter in signature(function).parameters.items():
        kind = hints[name]
        if is_dataclass(kind):
            groups[name] = kind
            annotations = get_type_hints(kind, include_extras=True)
            parameters += [
                Parameter(
                    field.name,
                    Parameter.KEYWORD_ONLY,
                    default=_default_of(field),
                    annotation=annotations[field.name],
                )
                for field in fields(kind)
            ]
        else:
            parameters.append(parameter.replace(kind=Parameter.KEYWORD_ONLY, annotation=kind))

    @wraps(function)
    def command(**values: Any) -> int:
        limit_s = values.get("time_limit_s")
        limit_imports(None if limit_s is None else 1.2 * limit_s + 2)
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        return function(**values)

    command.__signature__ = signature(function).replace(  # type: ignore[attr-defined]
        parameters=parameters, return_annotation=int
    )
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return command


def _default_of(field: Field[Any]) -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return Parameter.empty if field.default is MISSING else field.default


class _Placeholder(ModuleType):
    """Takes the place of a module while another imports a class of it that is never called."""

    def __getattr__(self, name: str) -> Any:
        if name == _UNUSED[self.__name__]:
            return type(name, (), {})
        if name.startswith("__"):
            raise AttributeError(name)
        sys.modules.pop(self.__name__, None)
        return getattr(importlib.import_module(self.__name__), name)


def load_rich_utils() -> ModuleType:
    """Return Typer's module; later imports of the modules left out get the real ones."""
    if _RICH in sys.modules:
        return sys.modules[_RICH]
    placeholders = {name: _Placeholder(name) for name in _UNUSED if name not in sys.modules}
    sys.modules.update(placeholders)
    try:
        return importlib.import_module(_RICH)
    finally:
        for name, module in placeholders.items():
            if sys.modules.get(name) is module:
                del sys.modules[name]
