"""What is found out late, found out before anything is solved: cycles, blocked feeders, units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from typing import Any

from skillplan.chart.conflict import conflict_lines
from skillplan.chart.precedence_chart import DerivedChart, derive_chart
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.collision.aabb import AabbDetector
from skillplan.domains.load import Problem
from skillplan.errors import Issue
from skillplan.pipeline.never_feasible import never_feasible, unreachable
from skillplan.pipeline.run import make_feasibility
from skillplan.pipeline.setup import CHART, DEFAULT_PHYSICS, SCREEN, Setup
from skillplan.records.preview import DerivedOrder, Preview
from skillplan.task.task import Task

MOST_COMPONENTS = 100
"""A relation of more components is derived only where a back end is named."""


def preview(
    problem: Problem,
    physics: str | None = None,
    collision: tuple[str, ...] = (),
    options: Mapping[str, Mapping[str, Any]] | None = None,
    cache: VerdictCache | None = None,
) -> Preview:
    """Return what is known of a valid file: warnings, derived orders, what its kind shows.

    Parameters
    ----------
    problem
        The loaded file.
    physics
        The engine that is queried; None for ``kinematic``, whatever the file chooses: a preview
        is instant.
    collision
        Detectors that are queried; empty for the default one, whatever the file chooses. Of hollow
        parts and many components no order is derived by itself.
    options
        Plugin name to option values.
    cache
        Where verdicts are kept; None for a fresh one in memory.

    Raises
    ------
    OptionError
        If a named back end refuses a task, or an option is wrong.
    PluginError
        If a named back end is unknown or broken.
    BackEndError
        If a back end fails.
    """
    # An order derived from the chart would say nothing of it.
    geometric = tuple(name for name in collision if name != CHART)
    setup = Setup(physics or DEFAULT_PHYSICS, geometric, options or {}, with_chart=False)
    named = physics is not None or bool(collision)
    described = [task for task in problem.tasks if task.operations and task.scene.bodies]
    orders = tuple(_order(task, setup, cache, named=named) for task in described)
    warnings = [*problem.warnings, *problem.hints]
    chosen = Setup(physics, collision, options or {})
    for task in problem.tasks:
        warnings += problem.told(chosen.warnings(task, problem.domain))
    for task, order in zip(described, orders, strict=True):
        messages: tuple[str, ...] = ()
        skills: tuple[str, ...] = ()
        if not named and order.never and SCREEN in order.back_ends:
            messages, skills = unreachable(problem, task)
        warnings += [*messages, *never_feasible(problem, task, order, skills)]
        warnings += [f"{problem.source}: {line}" for line in order.lines]
        issues = (
            Issue(line.removeprefix("chart: "), ("chart",), at_key=True)
            for line in order.contradictions
        )
        warnings += problem.told(issues)
    return Preview(tuple(warnings), orders, problem.domain.overview(problem.config))


def _order(task: Task, setup: Setup, cache: VerdictCache | None, *, named: bool) -> DerivedOrder:
    if not named:
        left_out = _too_expensive(task)
        if left_out:
            return DerivedOrder(task.name, (), not_derived=left_out)
        if not setup.has_screen(task) and AabbDetector(task).refuses() is not None:
            return DerivedOrder(task.name, (), not_derived="turned parts")
    if not setup.collision:
        setup = replace(setup, collision=(setup.geometric_detector(task),))
    feasibility = make_feasibility(task, setup, cache)
    with closing(feasibility):
        chart = derive_chart(feasibility)
    names = tuple(back_end.name for back_end in feasibility.back_ends)
    return DerivedOrder(
        task.name,
        names,
        len(chart.relations),
        chart.cycle,
        chart.impossible,
        tuple(_obstacles(chart, task, names)),
        contradictions=chart.contradictions,
    )


def _too_expensive(task: Task) -> str:
    """Return what makes an order of a task expensive to derive, in words; empty for nothing.

    A box about a hollow part fills what another goes into, and of true meshes a relation takes
    minutes.
    """
    if any(body.surfaces for body in task.scene.bodies):
        return "hollow parts"
    return "so many components" if len(task.operations) > MOST_COMPONENTS else ""


def _obstacles(chart: DerivedChart, task: Task, names: tuple[str, ...]) -> Iterator[str]:
    """Yield why no order can exist, in words."""
    by = f"by {', '.join(names)}"
    first, *rest = conflict_lines(task, chart.relations) or ("",)
    if first:
        yield f"{by} no order exists: {first}."
        yield from (f"{line}." for line in rest)
