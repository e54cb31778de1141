"""Skills that no state makes feasible, told with the place in the file that is to change."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import closing

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.precedence_query import CheckSteps, PrecedenceQuery, run_queries
from skillplan.domains.load import Problem
from skillplan.errors import BackEndError, Issue, PluginError
from skillplan.physics.kinematic import surely_reached
from skillplan.physics.linear_motions import too_wide
from skillplan.pipeline.run import make_feasibility
from skillplan.pipeline.setup import DEFAULT_PHYSICS, SCREEN, Setup
from skillplan.records.preview import DerivedOrder
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

# Whether the arm gets there does not depend on where it comes from, which is dearest to check.
_SHORT = {SCREEN: {"check_travel": False}}


def never_feasible(
    problem: Problem, task: Task, order: DerivedOrder, known: Collection[str] = ()
) -> tuple[str, ...]:
    """Return what a derived order says of skills that are never feasible.

    Parts too wide for jaws are left out: the file's own checks report them.

    Parameters
    ----------
    problem
        The file.
    task
        One of its tasks.
    order
        Of the task.
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
        and too_wide(task.scene, task.scene.robots[0], task.skill(skill)) is None
    )


def unreachable(problem: Problem, task: Task) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return messages about what the arm can do in no state, with places in the file; and skills.

    Parameters
    ----------
    problem
        The file.
    task
        One of its tasks, which the geometric detector serves.
    """
    try:
        found = list(_unreachable(task))
    except (PluginError, BackEndError) as error:
        return (f"{problem.source}: what the arm reaches was not checked: {error}",), ()
    by_key: dict[tuple[str | int, ...], list[tuple[str, Verdict]]] = {}
    for skill, verdict in found:
        path = problem.domain.locate_skill(problem.config, skill, reach=True)
        by_key.setdefault(path, []).append((skill, verdict))
    messages = problem.told(Issue(_words(said), path) for path, said in by_key.items())
    return messages, tuple(skill for skill, _ in found)


def _words(said: Sequence[tuple[str, Verdict]]) -> str:
    """Return what fails by one key: all skills, and why the first of them does."""
    (first, verdict), *others = said
    names = " and ".join([first, *(skill for skill, _ in others)])
    verb = "are" if others else "is"
    return f"by {SCREEN} {names} {verb} never feasible: {verdict.reason}. {_instead(first)}"


def _instead(skill: str) -> str:
    if skill.startswith("fasten("):
        return "Move the screw, or what it goes through."
    return "Give another grasp (approach, closing_axis, at_m), or move the part."


def _unreachable(task: Task) -> Iterator[tuple[str, Verdict]]:
    """Yield the skills, with the verdict where nothing else is done."""
    setup = Setup(DEFAULT_PHYSICS, (SCREEN,), _SHORT, with_chart=False)
    hypothetical = HypotheticalStates(task)
    queries = [
        PrecedenceQuery(hypothetical, component, skill)
        for component in task.operations
        for skill in hypothetical.chain(component)
        # What is too wide for jaws, the file's own checks say.
        if too_wide(task.scene, task.scene.robots[0], skill) is None
    ]
    queries = [query for query in queries if not _surely_reached(task, query)]
    if not queries:
        return
    feasibility = make_feasibility(task, setup, None)
    with closing(feasibility):
        said = run_queries(feasibility, [_never(query) for query in queries])
    for query, verdict in zip(queries, said, strict=True):
        if verdict is not None and not verdict.is_feasible:
            yield query.skill.name, verdict


def _surely_reached(task: Task, query: PrecedenceQuery) -> bool:
    """Whether no arm model is needed to say that the arm gets there: loading one takes long."""
    return surely_reached(task, query.skill, query.hypothetical.before(query.skill, ()))


def _never(query: PrecedenceQuery) -> CheckSteps[Verdict]:
    """Return why a skill fails in a state that nothing else could better; else that it does not."""
    verdict = yield from query.check(frozenset())
    if verdict.is_feasible or query.hypothetical.components(verdict) - {query.component}:
        return Verdict.feasible()
    return verdict
