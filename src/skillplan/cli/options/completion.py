"""Shell completion of a command line; an error completes nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.task.task import Task

Complete = Callable[[str], list[str]]
# Folders of task files: the current one, and the one of this repository.
_FOLDERS = (".", "configs")
_PATTERNS = ("*.yaml", "*.yml", "*.sop")


def task_files(incomplete: str) -> list[str]:
    """Return the task files here and in ``configs`` that complete a word."""
    paths = (
        str(path)
        for folder in _FOLDERS
        for pattern in _PATTERNS
        for path in sorted(Path(folder).glob(pattern))
    )
    return [name for name in paths if name.startswith(incomplete)]


def plugin_names(kind: str) -> Complete:
    """Return a function that completes the name of an installed plugin of a kind."""

    def complete(incomplete: str) -> list[str]:
        from skillplan.pipeline import registry

        return [name for name in registry.names(kind) if name.startswith(incomplete)]

    return complete


def example_names(incomplete: str) -> list[str]:
    """Return the names of examples that complete a word."""
    from skillplan.pipeline import list_examples

    return [name for name in list_examples() if name.startswith(incomplete)]


def engine_names(incomplete: str) -> list[str]:
    """Return the installed engines that complete a word, and ``auto``."""
    from skillplan.plugins.installed import AUTO, find_simulator

    auto = [AUTO] if find_simulator() and AUTO.startswith(incomplete) else []
    return [*auto, *plugin_names("physics")(incomplete)]


def plugin_lists(kind: str) -> Complete:
    """Return a function that completes the last of several names separated by commas."""

    def complete(incomplete: str) -> list[str]:
        head, comma, last = incomplete.rpartition(",")
        taken = head.split(",")
        names = (name for name in plugin_names(kind)(last) if name not in taken)
        return [f"{head}{comma}{name}" for name in names]

    return complete


def words(known: Mapping[str, str]) -> Callable[[str], list[tuple[str, str]]]:
    """Return a function that completes known words, each with its description."""

    def complete(incomplete: str) -> list[tuple[str, str]]:
        return [(name, line) for name, line in known.items() if name.startswith(incomplete)]

    return complete


def skills(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Return the skills of the task on the line that complete a word, with their numbers."""
    task = _task(ctx)
    if task is None:
        return []
    return [
        (skill.name, str(number))
        for number, skill in enumerate(task.skills)
        if skill.name.startswith(incomplete)
    ]


def plugin_options(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Return the options of the plugins on the line, for ``-O``.

    Options of the solver are listed without its name, unless the name was typed.
    """
    solver = ctx.params.get("solver")
    completions = []
    for kind, name in _plugins(ctx):
        for key, line in _fields(kind, name):
            forms = [f"{name}.{key}="] + ([f"{key}="] if name == solver else [])
            completions += [(form, line) for form in forms if form.startswith(incomplete)]
    bare = [(form, line) for form, line in completions if "." not in form]
    return bare or completions


def _plugins(ctx: typer.Context) -> Iterator[tuple[str, str]]:
    """Yield kind and name of the plugins on the line, or else of the task."""
    from skillplan.plugins.installed import AUTO, find_simulator

    given = ctx.params
    for kind, keys in {"solver": ("solver", "solvers"), "collision": ("collision",)}.items():
        for key in keys:
            yield from ((kind, name) for name in (given.get(key) or "").split(",") if name)
    physics = given.get("physics")
    if physics == AUTO:
        physics = find_simulator()
    if physics:
        yield "physics", physics
    task = _task(ctx)
    if task is not None:
        if task.physics is not None and not physics:
            yield "physics", task.physics.name
        if not given.get("collision"):
            yield from (("collision", choice.name) for choice in task.collision)


def _fields(kind: str, name: str) -> list[tuple[str, str]]:
    """Return the options of an installed plugin, with their descriptions."""
    from skillplan.errors import SkillplanError
    from skillplan.pipeline import registry

    try:
        options = getattr(registry.load(kind, name), "Options", None)
    except SkillplanError:
        return []
    if options is None:
        return []
    return [(key, field.description or "") for key, field in options.model_fields.items()]


def _task(ctx: typer.Context) -> Task | None:
    from skillplan.errors import SkillplanError
    from skillplan.pipeline.setup import load_problem

    try:
        return load_problem(ctx.params["task"]).part(ctx.params.get("part"))
    except (SkillplanError, KeyError, TypeError):
        return None
