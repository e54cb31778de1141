"""The command group. Commands are imported when they are called, so that help is instant."""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Any

import click

from skillplan import __version__
from skillplan.cli.command_group import CommandGroup
from skillplan.cli.writing import write_out
from skillplan.errors import (
    EXIT_BACK_END,
    EXIT_INTERRUPTED,
    SkillplanError,
    TaskError,
    traceback_text,
)

# Command to the line that the group's help shows; the module is named after the command,
# but for those of `MODULES`.
COMMANDS = {
    "search-optimal": "Find the best sequence of skills and prove it.",
    "evaluate": "Replay a sequence: feasible, complete, at what cost, what fails where.",
    "compare": "Run several solvers side by side.",
    "verify": "Check the claims of a result independently of what made it.",
    "sweep": "Study how a solver's options act: several values, seeds and starts.",
    "train": "Train a learner: several runs, kept in a folder, held to the proved optimum.",
    "check": "Validate a task file: its faults at once.",
    "generate": "Write a task file at random: parts, precedence, tools.",
    "explain": "Say why a skill is feasible or not in a state.",
    "simulate": "Execute a whole plan in one simulated world; film it.",
    "plot": "Draw a figure of a solved task as PNG or SVG.",
    "chart": "Derive the precedence relation from collision checks.",
    "cache": "Show, verify, fill and clear the verdicts kept on disk.",
    "plugins": "List installed back ends, solvers and kinds of task.",
    "schema": "Print the JSON Schema of a kind of task file.",
}

MODULES = {"schema": "json_schema"}

EPILOG = (
    "Exit codes: 0 solved, optimal or not; 1 no plan, or the sequence is infeasible or "
    "incomplete; 2 wrong input, option or plugin; 3 a back end failed; 130 interrupted."
)


class LazyGroup(CommandGroup):
    """Looks commands up by name in `COMMANDS` and imports only the one that is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of a user's day."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in COMMANDS:
            return None
        name = MODULES.get(cmd_name, cmd_name.replace("-", "_"))
        module = importlib.import_module(f"skillplan.cli.commands.{name}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LazyGroup, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="skillplan")
def app() -> None:
    """Decide in which order a robot uses its skills, with a proof or an honest gap."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit; no exception whatever reaches the user as a traceback."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    sys.exit(_run(words))


def _run(words: list[str]) -> int:
    try:
        code = app.main(args=words, prog_name="skillplan", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except click.ClickException as error:
        error.show()
        _print_error_document(error_document(error), words)
        return error.exit_code
    except click.exceptions.Exit as signal:
        return signal.exit_code
    except (click.Abort, KeyboardInterrupt):
        print("skillplan: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except SkillplanError as error:
        _report(error, words)
        return error.exit_code
    except Exception as error:
        if os.environ.get("SKILLPLAN_DEBUG"):
            raise
        print(
            f"skillplan: internal error: {type(error).__name__}: {error}\n"
            "This is a bug in skillplan. Set SKILLPLAN_DEBUG=1 to see where, and report it.",
            file=sys.stderr,
        )
        _print_error_document(error_document(error), words)
        return EXIT_BACK_END


def _report(error: SkillplanError, words: list[str]) -> None:
    """Say on stderr what is wrong; in JSON also as the one document on stdout."""
    lines = error.lines() if isinstance(error, TaskError) else [str(error)]
    shown = lines[:200]
    for line in shown:
        # A file may hold what a terminal cannot print.
        text = line.encode(sys.stderr.encoding or "utf-8", "backslashreplace")
        print(f"skillplan: error: {text.decode(sys.stderr.encoding or 'utf-8')}", file=sys.stderr)
    if len(lines) > len(shown):
        print(f"skillplan: and {len(lines) - len(shown)} more faults", file=sys.stderr)
    print(traceback_text(error), file=sys.stderr, end="")
    _print_error_document(error_document(error), words)


def _print_error_document(document: dict[str, Any], words: list[str]) -> None:
    if _wants_json(words):
        with suppress(SkillplanError):
            write_out(f"{json.dumps(document, indent=2)}\n")


def error_document(error: Exception) -> dict[str, Any]:
    """Return the JSON document ``skillplan.error/1``."""
    from skillplan.records import schemas

    issues = []
    if isinstance(error, TaskError):
        issues = [
            {
                "file": error.source,
                "line": issue.line or None,
                "column": issue.column or None,
                "path": list(issue.path),
                "message": issue.message,
            }
            for issue in error.issues
        ]
    return {
        "schema": schemas.ERROR,
        "error": type(error).__name__,
        "message": error.format_message()
        if isinstance(error, click.ClickException)
        else str(error),
        "exit_code": getattr(error, "exit_code", EXIT_BACK_END),
        "issues": issues,
    }


def _wants_json(words: list[str]) -> bool:
    return "--format=json" in words or any(pair == ("--format", "json") for pair in pairwise(words))
