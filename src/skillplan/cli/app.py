"""The command line: its commands, and the way from its words to an exit code.

Commands are imported when they are called, so that help is instant.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from functools import cache
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from skillplan import __version__
from skillplan.cli.command_group import MARKUP, SETTINGS, CommandGroup, hide_type, make_from_module
from skillplan.cli.commands.warm_up import announce_compilation
from skillplan.cli.error_report import report_bug, report_error, report_usage
from skillplan.cli.writing import restore_stdout, tell, write_out
from skillplan.errors import SearchStopped, SkillplanError, exit_code
from skillplan.workers.supervised import describe_passed_limit, is_interrupted

# Panels of the help, with the commands and their descriptions.
PANELS = {
    "Plan": {
        "search-optimal": "Find the best sequence of skills and prove it.",
        "evaluate": "Replay a sequence: feasibility, cost, and the first failure.",
        "compare": "Run several solvers side by side.",
        "benchmark": "Run agents on tasks with proved optima; check submissions.",
        "verify": "Check the claims of a result independently of its solver.",
        "simulate": "Execute a whole plan in one simulated world, and film it.",
        "plot": "Draw a figure of a solved task as PNG or SVG.",
        "export": "Export a task or a plan to other tools: PDDL, behaviour trees, PLCs, ROS.",
        "report": "Write an HTML page about plans, with a playback in 3-D.",
    },
    "Understand": {
        "explain": "Explain why a skill is feasible or not in a state.",
        "advise": "Try changes of the cell and list the best.",
        "chart": "Derive the precedence relation from collision checks.",
    },
    "Learn": {
        "train": "Train a learner with several seeds; compare it with the proved optimum.",
        "sweep": "Study the options of a solver: several values, seeds and starts.",
    },
    "Task files": {
        "init": "Write a commented task file as a starting point.",
        "check": "Validate a task file and list all its faults.",
        "import-cad": "Find parts, screws and their blocking relation in CAD (skillplan-cad).",
        "nest": "Cut a nest for a part from CAD, check it by rays, write STL (skillplan-cad).",
        "generate": "Generate a random task file: parts, precedence, tools.",
        "schema": "Print the JSON Schema of a kind of task file.",
    },
    "This installation": {
        "plugins": "List installed back ends, solvers and kinds of task.",
        "cache": "Show, verify, fill and clear the verdicts kept on disk.",
        "warm-up": "Compile the kernels of solvers ahead of their first use.",
    },
}

# The module of a command is named after it, with the exceptions in `MODULES`.
COMMANDS = {name: line for commands in PANELS.values() for name, line in commands.items()}

# Variable by which a shell requests the completion of a word.
COMPLETION = "_SKILLPLAN_COMPLETE"

MODULES = {"schema": "json_schema"}

EPILOG = (
    "Exit codes: 0 solved, optimal or not; 1 no plan, or the sequence is infeasible or "
    "incomplete; 2 wrong input, option or plugin; 3 a back end failed; 130 interrupted."
)


class LazyGroup(CommandGroup):
    """Looks commands up in `COMMANDS` and imports only the command that is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the commands in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a command, or return None if there is none of the name."""
        return _command(cmd_name) if cmd_name in COMMANDS else None

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help; no command is imported."""
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
        """Return the commands and options that complete a word; no command is imported."""
        from typer._click.shell_completion import CompletionItem

        commands = [
            CompletionItem(name, help=line)
            for name, line in COMMANDS.items()
            if name.startswith(incomplete)
        ]
        return [*commands, *super(TyperGroup, self).shell_complete(ctx, incomplete)]


@cache
def _command(name: str) -> Any:
    """Import and build a command, once for each process."""
    module = MODULES.get(name, name.replace("-", "_"))
    return make_from_module(name, importlib.import_module(f"skillplan.cli.commands.{module}"))


def _print_version(is_given: bool) -> None:
    if is_given:
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


def _make_app() -> Any:
    builder = typer.Typer(
        cls=LazyGroup,
        epilog=EPILOG,
        context_settings=SETTINGS,
        no_args_is_help=True,
        rich_markup_mode=MARKUP,
    )
    builder.callback()(_group)
    group = get_command(builder)
    for parameter in group.params:
        hide_type(parameter)
    return group


app = _make_app()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit, as `run`."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: Sequence[str]) -> int:
    """Run the command line and return the exit code.

    No exception reaches the user as a traceback, and no exception of a plugin ends the program.
    """
    # Pydantic would read the metadata of all installed distributions to find its own plugins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    words = list(arguments)
    try:
        if _completes(words):
            with restore_stdout():
                code = app.main(args=words, prog_name="skillplan", standalone_mode=False)
        else:
            # Not `app.main`, which turns Ctrl-C into an exit code without a message.
            notice = nullcontext() if words[:1] == ["warm-up"] else announce_compilation()
            with notice, app.make_context("skillplan", words.copy()) as context:
                code = app.invoke(context)
    except typer.Exit as error:
        code = error.exit_code
    except BaseException as error:
        return _report(error, words)
    return code if isinstance(code, int) else 0


def _completes(words: Sequence[str]) -> bool:
    """Return whether Typer completes a word for a shell, or prints or installs the script."""
    first = words[0].partition("=")[0] if words else ""
    return bool(os.environ.get(COMPLETION)) or first in (
        "--install-completion",
        "--show-completion",
    )


def _report(error: BaseException, words: list[str]) -> int:
    """Report the exception that ended the command, and return the exit code."""
    stopped = isinstance(error, (typer.Abort, KeyboardInterrupt, SearchStopped))
    # Libraries raise errors of their own from the exception of a signal.
    if stopped or is_interrupted():
        if message := describe_passed_limit():
            return report_error(SkillplanError(message), words)
        tell("skillplan: interrupted")
        return exit_code(interrupted=True)
    if isinstance(error, typer.TyperException):
        return report_usage(error, words)
    if isinstance(error, SkillplanError):
        return report_error(error, words)
    # Typer exits after a completion; a plugin must not.
    if isinstance(error, SystemExit) and _completes(words):
        return error.code if isinstance(error.code, int) else 0
    if os.environ.get("SKILLPLAN_DEBUG") and not isinstance(error, SystemExit):
        raise error
    report_bug(error, words)
    return exit_code(error)
