"""Which solver is for which stage of a chain, as users write it: ``exact`` or ``base=sarsa``."""

from __future__ import annotations

from collections.abc import Iterable

from skillplan.errors import OptionError, name_hint
from skillplan.pipeline.registry import load
from skillplan.solvers.solver import Solver

REFERENCE = "exact"


def solvers_by_stage(spec: str, stages: Iterable[str]) -> dict[str, str]:
    """Return the solver of every stage.

    Parameters
    ----------
    spec
        A solver's name, or ``STAGE=NAME`` entries after commas or plus signs.
    stages
        The stages that there may be.

    Raises
    ------
    OptionError
        If an entry names a stage that there is not.
    PluginError
        If a solver is unknown or broken.
    """
    stages = list(stages)
    if "=" not in spec:
        only = made_for(spec)
        return {stage: spec if only in (None, stage) else REFERENCE for stage in stages}
    chosen = dict.fromkeys(stages, REFERENCE)
    named: set[str] = set()
    for entry in _entries(spec):
        stage, _, name = entry.partition("=")
        if stage in named:
            raise OptionError(f"Two solvers for the stage {stage!r}. Give one.")
        named.add(stage)
        if stage not in chosen:
            raise OptionError(f"No stage {stage!r} in this task. {name_hint(stage, stages)}")
        made_for(name)
        chosen[stage] = name
    return chosen


def solver_names(spec: str) -> tuple[str, ...]:
    """Return the solvers that a choice of solvers names."""
    if "=" not in spec:
        return (spec,)
    return tuple(dict.fromkeys(entry.partition("=")[2] for entry in _entries(spec)))


def _entries(spec: str) -> list[str]:
    return [entry.strip() for entry in spec.replace("+", ",").split(",") if entry.strip()]


def made_for(name: str) -> str | None:
    """Return the only stage that a solver searches, or None."""
    plugin: type[Solver] = load("solver", name)
    return plugin.stage
