"""The command line itself. Commands are imported when they are called, so that help is instant."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from skillplan import __version__
from skillplan.cli.command_group import MARKUP, SETTINGS, CommandGroup, of_module, untyped
from skillplan.cli.commands.warm_up import compilation_announced
from skillplan.cli.error_report import report_bug, report_error, report_usage
from skillplan.cli.writing import restored_stdout, tell, write_out
from skillplan.errors import SearchStopped, SkillplanError, exit_code
from skillplan.workers.supervised import is_interrupted, passed_limit

# Panel of the group's help to its commands, each with its line.
PANELS = {
    "Plan": {
        "search-optimal": "Find the best sequence of skills and prove it.",
        "evaluate": "Replay a sequence: feasible, complete, at what cost, what fails where.",
        "compare": "Run several solvers side by side.",
        "verify": "Check the claims of a result independently of what made it.",
        "simulate": "Execute a whole plan in one simulated world; film it.",
        "plot": "Draw a figure of a solved task as PNG or SVG.",
        "export": "Hand a task or a plan on to other tools: PDDL, behaviour trees, PLCs, ROS.",
        "report": "Write one HTML page on plans, with a playback in 3-D.",
    },
    "Understand": {
        "explain": "Say why a skill is feasible or not in a state.",
        "chart": "Derive the precedence relation from collision checks.",
    },
    "Learn": {
        "train": "Train a learner: several runs, kept in a folder, held to the proved optimum.",
        "sweep": "Study how a solver's options act: several values, seeds and starts.",
    },
    "Task files": {
        "init": "Write a commented task file to begin one's own from.",
        "check": "Validate a task file: its faults at once.",
        "import-cad": "Find parts, screws and what blocks what in CAD; of plugin skillplan-cad.",
        "generate": "Write a task file at random: parts, precedence, tools.",
        "schema": "Print the JSON Schema of a kind of task file.",
    },
    "This installation": {
        "plugins": "List installed back ends, solvers and kinds of task.",
        "cache": "Show, verify, fill and clear the verdicts kept on disk.",
        "warm-up": "Compile ahead what would be compiled at its first use.",
    },
}

# Command to the line that the group's help shows; the module is named after the command,
# but for those of `MODULES`.
COMMANDS = {name: line for commands in PANELS.values() for name, line in commands.items()}

# Shells set it to have a word completed.
COMPLETION = "_SKILLPLAN_COMPLETE"

MODULES = {"schema": "json_schema"}

EPILOG = (
    "Exit codes: 0 solved, optimal or not; 1 no plan, or the sequence is infeasible or "
    "incomplete; 2 wrong input, option or plugin; 3 a back end failed; 130 interrupted."
)


class LazyGroup(CommandGroup):
    """Looks commands up by name in `COMMANDS` and imports only the one that is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the commands in the order of a user's day."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command, or return None where there is none of the name."""
        return _command(cmd_name) if cmd_name in COMMANDS else None

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help; the commands are shown by their lines, and none is imported."""
        shown = [
            TyperCommand(name, help=line, rich_help_panel=panel)
            for panel, commands in PANELS.items()
            for name, line in commands.items()
        ]
        listing = CommandGroup(
            name=self.name,
            commands=shown,
            params=self.params,
            help=self.help,
            epilog=self.epilog,
            rich_markup_mode=self.rich_markup_mode,
        )
        listing.format_help(ctx, formatter)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Return the commands and options that begin so; no command is imported."""
        from typer._click.shell_completion import CompletionItem

        found = [
            CompletionItem(name, help=line)
            for name, line in COMMANDS.items()
            if name.startswith(incomplete)
        ]
        return [*found, *super(TyperGroup, self).shell_complete(ctx, incomplete)]

    def invoke(self, ctx: Any) -> Any:
        """Call the command; Ctrl-C ends it as an abort, which `main` reports."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise typer.Abort from None


@cache
def _command(name: str) -> Any:
    """Return a command, built once a process: its parameters and what reads them take time."""
    module = MODULES.get(name, name.replace("-", "_"))
    return of_module(name, importlib.import_module(f"skillplan.cli.commands.{module}"))


def _print_version(wanted: bool) -> None:
    if wanted:
        write_out(f"skillplan, version {__version__}\n")
        raise typer.Exit


def _group(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Decide in which order a robot uses its skills, with a proof or an honest gap."""


def _app() -> Any:
    made = typer.Typer(
        cls=LazyGroup,
        epilog=EPILOG,
        context_settings=SETTINGS,
        no_args_is_help=True,
        rich_markup_mode=MARKUP,
    )
    made.callback()(_group)
    group = get_command(made)
    for parameter in group.params:
        untyped(parameter)
    return group


def _sets_up_completion(words: Sequence[str]) -> bool:
    """Whether the shell's completion is printed or installed, before any command is looked up."""
    first = words[0].partition("=")[0] if words else ""
    return first in ("--install-completion", "--show-completion")


app = _app()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit, as `run`."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: Sequence[str]) -> int:
    """Run the command line and return the exit code.

    No exception whatever reaches the user as a traceback, and none of a plugin's ends the program.
    """
    # Pydantic would read the metadata of all that is installed to find plugins of its own.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    return _run(list(arguments))


@contextmanager
def _surroundings(words: Sequence[str]) -> Iterator[None]:
    """Announce compilations, unless words are completed for a shell, which Typer prints."""
    if os.environ.get(COMPLETION) or words[:1] in (["--show-completion"], ["--install-completion"]):
        with restored_stdout():
            yield
    elif words[:1] == ["warm-up"]:
        yield
    else:
        with compilation_announced():
            yield


def _run(words: list[str]) -> int:
    try:
        with _surroundings(words):
            code = app.main(args=words, prog_name="skillplan", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except BaseException as error:
        return _report(error, words)


def _report(error: BaseException, words: list[str]) -> int:
    """Report what ended the command and return the exit code."""
    stopped = isinstance(error, (typer.Abort, KeyboardInterrupt, SearchStopped))
    # Libraries raise errors of their own from the exception of a signal.
    if stopped or is_interrupted():
        if message := passed_limit():
            return report_error(SkillplanError(message), words)
        tell("skillplan: interrupted")
        return exit_code(interrupted=True)
    if isinstance(error, typer.TyperException):
        return report_usage(error, words)
    if isinstance(error, SkillplanError):
        return report_error(error, words)
    # Typer ends so once it has completed a word for a shell, or printed or installed the
    # script for it; a plugin ends nothing.
    if isinstance(error, SystemExit) and (os.environ.get(COMPLETION) or _sets_up_completion(words)):
        return error.code if isinstance(error.code, int) else 0
    if os.environ.get("SKILLPLAN_DEBUG") and not isinstance(error, SystemExit):
        raise error
    report_bug(error, words)
    return exit_code(error)
