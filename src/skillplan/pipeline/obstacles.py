"""Obstacles to a plan: found before any search, or named after a search without a plan."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

from skillplan.chart.conflict import explain_conflict
from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.precedence_chart import DerivedChart, derive_chart
from skillplan.chart.precedence_query import CheckSteps, PrecedenceQuery, run_queries
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import IntroducedBackEnds
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.collision.aabb import AabbDetector
from skillplan.domains.load import Problem
from skillplan.errors import BackEndError, Issue, PluginError
from skillplan.model.obstruction import explain_obstruction
from skillplan.model.skill_model import SkillModel
from skillplan.physics.kinematic import is_surely_reached
from skillplan.physics.linear_motions import describe_too_wide
from skillplan.pipeline.setup import CHART, DEFAULT_PHYSICS, SCREEN, Setup
from skillplan.pipeline.solving import make_feasibility
from skillplan.records.questions import DerivedOrder, Preview
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

# The reach of the arm does not depend on its travel, which is the most expensive check.
_SHORT = {SCREEN: {"check_travel": False}}


def warn_never_feasible(
    problem: Problem, task: Task, order: DerivedOrder, known: Collection[str] = ()
) -> tuple[str, ...]:
    """Return messages about skills that a derived order proves never feasible.

    Parts too wide for jaws are left out, because the checks of the file report them.

    Parameters
    ----------
    problem
        The loaded file.
    task
        One of its tasks.
    order
        Derived order of the task.
    known
        Skills that are reported already.
    """
    by = f"by {', '.join(order.back_ends)}"

    def is_about_reach(skill: str, why: str) -> bool:
        # If the part itself is in the way, no other grasp helps.
        part = task.skill(skill).parameters.get("part")
        return why.startswith((SCREEN, "ways")) and not why.startswith(f"{SCREEN}: {part} runs ")

    return problem.told(
        Issue(
            f"{by} {skill} is never feasible: {why}.",
            problem.domain.locate_skill(problem.config, skill, reach=is_about_reach(skill, why)),
        )
        for skill, why in order.never.items()
        if skill not in known
        and describe_too_wide(task.scene, task.scene.robots[0], task.skill(skill)) is None
    )


def warn_unreachable(problem: Problem, task: Task) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return messages about skills that the arm reaches in no state, and the names of the skills.

    Parameters
    ----------
    problem
        The loaded file.
    task
        One of its tasks, which the geometric detector serves.
    """
    try:
        failures = list(_find_unreachable(task))
    except (PluginError, BackEndError) as error:
        return (f"{problem.source}: what the arm reaches was not checked: {error}",), ()
    by_key: dict[tuple[str | int, ...], list[tuple[str, Verdict]]] = {}
    for skill, verdict in failures:
        path = problem.domain.locate_skill(problem.config, skill, reach=True)
        by_key.setdefault(path, []).append((skill, verdict))
    messages = problem.told(Issue(_join_words(group), path) for path, group in by_key.items())
    return messages, tuple(skill for skill, _ in failures)


def _join_words(group: Sequence[tuple[str, Verdict]]) -> str:
    """Return a message for the skills of one key, with the reason of the first."""
    (first, verdict), *others = group
    names = " and ".join([first, *(skill for skill, _ in others)])
    verb = "are" if others else "is"
    return f"by {SCREEN} {names} {verb} never feasible: {verdict.reason}. {_instead(first)}"


def _instead(skill: str) -> str:
    if skill.startswith("fasten("):
        return "Move the screw, or what it goes through."
    return "Give another grasp (approach, closing_axis, at_m), or move the part."


def _find_unreachable(task: Task) -> Iterator[tuple[str, Verdict]]:
    """Yield the skills that fail with nothing else in place, with their verdicts."""
    setup = Setup(DEFAULT_PHYSICS, (SCREEN,), _SHORT, with_chart=False)
    hypothetical = HypotheticalStates(task)
    queries = [
        PrecedenceQuery(hypothetical, component, skill)
        for component in task.operations
        for skill in hypothetical.chain(component)
        # The checks of the file report parts too wide for jaws.
        if describe_too_wide(task.scene, task.scene.robots[0], skill) is None
    ]
    queries = [query for query in queries if not _is_surely_reached(task, query)]
    if not queries:
        return
    feasibility = make_feasibility(task, setup, None)
    with closing(feasibility):
        verdicts = run_queries(feasibility, [_check_never(query) for query in queries])
    for query, verdict in zip(queries, verdicts, strict=True):
        if verdict is not None and not verdict.is_feasible:
            yield query.skill.name, verdict


def _is_surely_reached(task: Task, query: PrecedenceQuery) -> bool:
    """Return whether the arm surely reaches a skill; its model, which loads slowly, is not used."""
    return is_surely_reached(task, query.skill, query.hypothetical.before(query.skill, ()))


def _check_never(query: PrecedenceQuery) -> CheckSteps[Verdict]:
    """Return the verdict of a skill if no other state could improve it, or else a feasible one."""
    verdict = yield from query.check(frozenset())
    if verdict.is_feasible or query.hypothetical.components(verdict) - {query.component}:
        return Verdict.feasible()
    return verdict


# Larger tasks are not charted just to explain that they have no plan.
_MOST_CHARTED = 64
_MOST_CONTRADICTIONS = 3
MOST_COMPONENTS = 100
"""A relation of more components is derived only where a back end is named."""


def preview_problem(
    problem: Problem,
    physics: str | None = None,
    collision: tuple[str, ...] = (),
    options: Mapping[str, Mapping[str, Any]] | None = None,
    cache: VerdictCache | None = None,
) -> Preview:
    """Check a valid file before any search: warnings, derived orders, overview.

    Parameters
    ----------
    problem
        The loaded file.
    physics
        Name of the engine; None for ``kinematic``, because a preview is instant.
    collision
        Names of the detectors; empty for the default one. No order is derived by default for
        hollow parts or many components.
    options
        Plugin name to option values.
    cache
        Verdict cache; None for a new one in memory.

    Raises
    ------
    OptionError
        If a named back end refuses a task, or an option is wrong.
    PluginError
        If a named back end is unknown or broken.
    BackEndError
        If a back end fails.
    """
    # An order derived from the chart would only repeat it.
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
            messages, skills = warn_unreachable(problem, task)
        warnings += [*messages, *warn_never_feasible(problem, task, order, skills)]
        warnings += [f"{problem.source}: {line}" for line in order.lines]
        issues = (
            Issue(line.removeprefix("chart: "), ("chart",), at_key=True)
            for line in order.contradictions
        )
        warnings += problem.told(issues)
    return Preview(tuple(warnings), orders, problem.domain.overview(problem.config))


def _order(task: Task, setup: Setup, cache: VerdictCache | None, *, named: bool) -> DerivedOrder:
    if not named:
        left_out = _explain_expense(task)
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


def _explain_expense(task: Task) -> str:
    """Return the reason why an order is too expensive to derive; empty without one.

    A box about a hollow part fills the space that another part goes into, and an order of true
    meshes takes minutes.
    """
    if any(body.surfaces for body in task.scene.bodies):
        return "hollow parts"
    return "so many components" if len(task.operations) > MOST_COMPONENTS else ""


def _obstacles(chart: DerivedChart, task: Task, names: tuple[str, ...]) -> Iterator[str]:
    """Yield messages about the reason why no order exists."""
    by = f"by {', '.join(names)}"
    first, *rest = explain_conflict(task, chart.relations) or ("",)
    if first:
        yield f"{by} no order exists: {first}."
        yield from (f"{line}." for line in rest)


def explain_infeasible(model: SkillModel, *, charted: bool) -> str:
    """Return the obstacle to every plan: a skill that fails in every state, or a cycle.

    Parameters
    ----------
    model
        A model of the task, which has no plan.
    charted
        True if a chart may be derived, which queries states that the search did not meet.
    """
    task = model.task
    if charted and task.deterministic and len(task.operations) <= _MOST_CHARTED:
        chart = derive_chart(model.feasibility)
        # The message about a cycle names the line of the chart that closes it.
        obstacle = ("" if chart.cycle else _contradict_chart(model)) or chart.obstacle(task)
        if obstacle:
            return obstacle
    return explain_obstruction(model) or f"none within {task.step_limit} skills"


def _contradict_chart(model: SkillModel) -> str:
    """Return the obstacle without the chart, or else the contradictions of chart and back ends."""
    back_ends = model.feasibility.back_ends
    others = [back_end for back_end in back_ends if back_end.name != CHART]
    if len(others) in (0, len(back_ends)):
        return ""
    # The chart's detector was introduced to them before, which changes none of their answers.
    chart = derive_chart(Feasibility(model.task, IntroducedBackEnds(others)))
    return chart.obstacle(model.task) or "\n".join(chart.contradictions[:_MOST_CONTRADICTIONS])
