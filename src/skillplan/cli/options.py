"""Arguments and options that several commands share, with their completion."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from skillplan.errors import OptionError

FORMATS = ("table", "json", "csv", "md")
_F = TypeVar("_F", bound=Callable[..., Any])


class TaskPath(click.ParamType[str]):
    """A task file; completes to the task files here and in ``configs``."""

    name = "task"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the path as it was given; what is wrong with it, loading says."""
        return str(value)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return matching task files, or leave it to the shell."""
        found = [
            str(path)
            for folder in (Path(), Path("configs"))
            for pattern in ("*.yaml", "*.yml", "*.sop")
            for path in sorted(folder.glob(pattern))
        ]
        matching = [name for name in found if name.startswith(incomplete)]
        if matching:
            return [CompletionItem(name) for name in matching]
        return [CompletionItem(incomplete, type="file")]


class PluginName(click.ParamType[str]):
    """One name of an installed plugin, or several after commas; completes to what is installed."""

    name = "name"

    def __init__(self, kind: str, *, several: bool = False) -> None:
        self.kind = kind
        self.several = several

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the installed names that begin like the last one typed."""
        from skillplan.pipeline import registry

        head, comma, last = incomplete.rpartition(",") if self.several else ("", "", incomplete)
        taken = head.split(",")
        return [
            CompletionItem(f"{head}{comma}{name}")
            for name in registry.names(self.kind)
            if name.startswith(last) and name not in taken
        ]


class SkillName(click.ParamType[str]):
    """A skill of the task given before; completes to the task's skills."""

    name = "skill"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the task's skills that begin like what was typed."""
        from skillplan.errors import SkillplanError
        from skillplan.pipeline.setup import load_problem

        try:
            task = load_problem(ctx.params["task"]).part(ctx.params.get("part"))
        except (SkillplanError, KeyError):
            return []
        return [
            CompletionItem(skill.name, help=str(number))
            for number, skill in enumerate(task.skills)
            if skill.name.startswith(incomplete)
        ]


task_argument = click.argument("task", type=TaskPath())


def back_end_options(function: _F) -> _F:
    """Add ``--physics``, ``--collision`` and ``-O``."""
    for decorate in (
        click.option(
            "-O",
            "options",
            metavar="[PLUGIN.]KEY=VALUE",
            multiple=True,
            help="Option of a plugin, or without its name of the solver; 'skillplan plugins KIND "
            "NAME' lists them. May be repeated.",
        ),
        click.option(
            "--collision",
            type=PluginName("collision", several=True),
            metavar="NAMES",
            help="Collision detectors, separated by commas; default: the task file's choice, "
            "for chart aabb.",
        ),
        click.option(
            "--physics",
            type=PluginName("physics"),
            metavar="NAME",
            help="Physics engine; default: the task file's choice, or else kinematic.",
        ),
    ):
        function = decorate(function)
    return function


def set_option(function: _F) -> _F:
    """Add ``--set``."""
    return click.option(
        "--set",
        "changes",
        metavar="KEY=VALUE",
        multiple=True,
        help="Read the task file as if KEY, such as base.goal_choice or parts.pcb.mass_kg, had "
        "this value. May be repeated.",
    )(function)


def part_option(function: _F) -> _F:
    """Add ``--part``."""
    return click.option(
        "--part",
        metavar="NAME",
        help="The task meant, of a file that describes a chain of several, such as base-1.",
    )(function)


def jobs_option(function: _F) -> _F:
    """Add ``--jobs``."""
    return click.option(
        "--jobs",
        type=click.IntRange(1, 64),
        default=1,
        show_default=True,
        metavar="N",
        help="How many processes may be used: dear back ends check in them at once, and solvers "
        "that can search in them; no verdict depends on it.",
    )(function)


no_cache_option = click.option(
    "--no-cache", is_flag=True, help="Neither read nor write verdicts kept on disk."
)


def format_option(function: _F) -> _F:
    """Add ``--format``."""
    return click.option(
        "--format",
        "style",
        type=click.Choice(FORMATS),
        default="table",
        show_default=True,
        help="How to print: json holds everything in one document.",
    )(function)


class Fraction(click.ParamType[float]):
    """A number in [0, 1]; unlike click's range, which lets NaN through."""

    name = "fraction"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the fraction."""
        try:
            fraction = float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number.", param, ctx)
        if not 0 <= fraction <= 1:
            self.fail(f"must be from 0 to 1, not {value}.", param, ctx)
        return fraction


class PositiveSeconds(click.ParamType[float]):
    """A finite number of seconds above 0."""

    name = "seconds"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the seconds."""
        try:
            seconds = float(value)
        except ValueError:
            self.fail(f"{value!r} is not a number of seconds.", param, ctx)
        if not (math.isfinite(seconds) and seconds > 0):
            self.fail(f"must be a finite number > 0, not {value}.", param, ctx)
        return seconds


def time_limit_option(default: float | None = None) -> Callable[[_F], _F]:
    """Return the decorator that adds ``--time-limit``."""
    return click.option(
        "--time-limit",
        "time_limit_s",
        type=PositiveSeconds(),
        metavar="S",
        default=default,
        show_default=default is not None,
        help="Stop after S seconds with the best plan, its bound and its gap.",
    )


def settings(changes: tuple[str, ...]) -> dict[str, str]:
    """Return key path to value, from the entries of ``--set``.

    Raises
    ------
    OptionError
        If an entry has another form.
    """
    found = {}
    for entry in changes:
        key, equals, value = entry.partition("=")
        if not equals or not all(key.split(".")):
            raise OptionError(f"--set {entry!r} must have the form KEY=VALUE, as base.home=C1.")
        found[key] = value
    return found


seed_option = click.option(
    "--seed",
    type=click.IntRange(0, 2**63 - 1),
    default=0,
    show_default=True,
    help="Governs all randomness.",
)


def parse_options(entries: tuple[str, ...], solver: str | None) -> dict[str, dict[str, Any]]:
    """Return plugin name to options, from ``[PLUGIN.]KEY=VALUE`` entries.

    Raises
    ------
    OptionError
        If an entry has another form, or names no plugin where there is no single solver.
    """
    parsed: dict[str, dict[str, Any]] = {}
    for entry in entries:
        key, equals, value = entry.partition("=")
        plugin, dot, name = key.rpartition(".")
        if not equals or not name:
            raise OptionError(f"Option {entry!r} must have the form [PLUGIN.]KEY=VALUE.")
        if not dot:
            if solver is None:
                raise OptionError(f"Option {entry!r} must name its plugin: PLUGIN.{entry}.")
            plugin = solver
        parsed.setdefault(plugin, {})[name] = value
    return parsed


def asked(physics: str | None, collision: str | None) -> dict[str, list[str]]:
    """Return the names of the back ends that the command line chooses, by kind."""
    given = {"physics": physics, "collision": collision}
    return {kind: split_names(names) for kind, names in given.items() if names is not None}


def split_names(text: str) -> list[str]:
    """Return the distinct names of a list with commas, in order."""
    return list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def make_setup(
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    solvers: tuple[str, ...] = (),
) -> Any:
    """Return the setup that the shared options describe.

    Raises
    ------
    OptionError
        If an option has a wrong form or names a plugin that takes no part.
    """
    from skillplan.errors import name_hint
    from skillplan.pipeline.setup import Setup

    if physics is not None and not physics.strip():
        raise OptionError("--physics names no engine.")
    detectors = tuple(split_names(collision or ""))
    if collision is not None and not detectors:
        raise OptionError("--collision names no detector.")
    parsed = parse_options(options, solvers[0] if len(solvers) == 1 else None)
    setup = Setup(physics, detectors, parsed)

    def check(task: Any) -> Any:
        taking_part = [
            *solvers,
            setup.physics_choice(task).name,
            *(choice.name for choice in setup.collision_choices(task)),
        ]
        for plugin in parsed:
            if plugin not in taking_part:
                hint = name_hint(plugin, taking_part)
                raise OptionError(f"No plugin {plugin!r} takes part in this run. {hint}")
        return setup

    return check
