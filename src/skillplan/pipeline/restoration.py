"""A stored result brought back: its task as it was read, its plans, the referee's rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, OptionError, name_hint
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.former_dwells import with_former_dwells, without_removed
from skillplan.pipeline.result_origin import found_origin, origin_problem, restored_setup
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import solve
from skillplan.records.chain_result import ChainPart, ChainResult
from skillplan.records.origin import Origin
from skillplan.records.result import Result, Status
from skillplan.records.stored.policy_file import read_policy
from skillplan.records.stored.result_file import (
    StoredClaims,
    StoredPart,
    StoredResult,
    read_result,
)
from skillplan.records.stored.result_folder import policies_path, result_path
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.task.task import Task

# So many tasks are named in a message.
_MOST_NAMED = 8


@dataclass(frozen=True, slots=True)
class Override:
    """What goes before what a result says of its origin.

    Parameters
    ----------
    file
        The task file; None for that of the result.
    part
        The task meant, of a chain; None for that of the result.
    changes
        Key path to YAML value, beside those of the result.
    physics, collision
        Names of back ends; None and empty for those of the result.
    options
        Plugin name to option values, beside those of the result.
    """

    file: str | None = None
    part: str | None = None
    changes: Mapping[str, str] = field(default_factory=dict)
    physics: str | None = None
    collision: tuple[str, ...] = ()
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def over(self, origin: Origin) -> Origin:
        """Return an origin with what is overridden."""
        named = {**origin.options, **self.options}
        return Origin(
            origin.file if self.file is None else self.file,
            origin.part if self.part is None else self.part,
            {**origin.changes, **self.changes},
            self.physics or origin.physics,
            self.collision or origin.collision,
            {
                plugin: {**origin.options.get(plugin, {}), **self.options.get(plugin, {})}
                for plugin in named
            },
            origin.screening,
        )


@dataclass(frozen=True)
class LoadedResult:
    """A stored result and what it is of.

    Parameters
    ----------
    path
        As the user named it.
    stored
        What it claims.
    origin
        The task file and how it was read.
    problem
        What the file describes.
    setup
        The back ends and options.
    times_note
        Sentence on the times of a result of an earlier version; empty for others.
    """

    path: str
    stored: StoredResult
    origin: Origin
    problem: Problem
    setup: Setup
    times_note: str = ""

    def planned(self) -> tuple[Task, tuple[str, ...]]:
        """Return the task that is meant and the skills of its plan.

        Raises
        ------
        OptionError
            If it holds no plan, or is of a chain of several tasks none of which is named.
        """
        found = [(task, tuple(claims.skills)) for task, claims in self.plans()]
        names = [task.name for task, _ in found]
        if not self.stored.is_chain or (self.origin.part is None and len(names) == 1):
            return found[0]
        if self.origin.part is None:
            named = ", ".join(
                [*names[:_MOST_NAMED], *(["..."] if len(names) > _MOST_NAMED else [])]
            )
            raise OptionError(
                f"{self.path}: is of a chain of {len(names)} tasks. Name one by --part: {named}."
            )
        if self.origin.part not in names:
            hint = name_hint(self.origin.part, names)
            raise OptionError(f"{self.path}: has no task {self.origin.part!r}. {hint}")
        return found[names.index(self.origin.part)]

    def taken_ways(self) -> tuple[str | None, ...]:
        """Return by step of the plan that is meant the way that it takes; None for the only one.

        Raises
        ------
        OptionError
            As `planned`.
        """
        task, _ = self.planned()
        claims = next(claims for one, claims in self.plans() if one.name == task.name)
        return tuple(step.way for step in claims.steps)

    def plans(self) -> Iterator[tuple[Task, StoredClaims]]:
        """Yield every task, grounded as it was when it was solved, with what is claimed of it.

        Raises
        ------
        OptionError
            If a task holds no plan, or one does not follow from those before it.
        """
        if not self.stored.is_chain:
            only = self.origin.part if self.problem.is_chain else None
            yield self.problem.part(only), self._with_plan(self.stored, self.stored.task.name)
            return
        parts: list[StoredPart] = [*self.stored.stages, *(self.stored.sequences or ())]
        replans = self.stored.replans
        tasks = self.problem.follow({}, replans) if replans else self.problem.tasks
        plans: dict[str, tuple[str, ...]] = {}
        for index, part in enumerate(parts):
            if index and part.stage != parts[index - 1].stage:
                try:
                    tasks = self.problem.follow(plans, replans)
                except ChainBroken as error:
                    raise OptionError(f"{self.path}: {part.name}: {error}") from None
            if index >= len(tasks) or tasks[index].name != part.name:
                raise OptionError(f"{self.path}: {part.name} is not where the chain has it.")
            yield tasks[index], self._with_plan(part, part.name)
            plans[part.name] = tuple(part.skills)

    def answer_for(self, task: Task | None) -> Result | ChainResult | None:
        """Return what the result holds of a task, or of the whole where it is None.

        None where it holds nothing of it.
        """
        if task is None:
            return self.answer() if self.stored.is_chain else None
        for own, claims in self.plans():
            if own.name == task.name:
                return self._judged(own, claims, VerdictCache())
        return None

    def answer(self, cache: VerdictCache | None = None) -> Result | ChainResult:
        """Return the result as the referee grants it now, without a search.

        Parameters
        ----------
        cache
            Where verdicts are kept; a fresh one in memory by default.

        Raises
        ------
        OptionError
            If it holds no plan.
        """
        cache = VerdictCache() if cache is None else cache
        parts = []
        for task, claims in self.plans():
            parts.append(ChainPart(task, self._judged(task, claims, cache)))
        if not self.stored.is_chain:
            return parts[0].result
        plans = {one.task.name: tuple(step.skill for step in one.result.steps) for one in parts}
        return ChainResult(
            self.problem.name,
            self.problem.kind,
            self.problem.sha256,
            self.stored.solver,
            self.stored.seed,
            tuple(parts),
            len(parts),
            self.problem.account(plans, self.stored.replans),
            self.stored.replans,
            origin=self.origin,
        )

    def _judged(self, task: Task, claims: StoredClaims, cache: VerdictCache) -> Result:
        stand_in = _Stored(claims, self._policy(task))
        result = solve(task, stand_in, self.setup, seed=self.stored.seed, cache=cache)
        return replace(result, solver=claims.solver)

    def _with_plan(self, claims: StoredClaims, name: str) -> StoredClaims:
        if claims.cost is None:
            raise OptionError(
                f"{self.path}: holds no plan of {name}, its status is {claims.status}."
            )
        return claims

    def _policy(self, task: Task) -> Policy | None:
        """Return the policy that was stored beside the result, if there is one for the task."""
        folder = str(result_path(self.path).parent)
        with suppress(OptionError):
            return read_policy(policies_path(folder), task, within=folder).policy
        return None


def load_result(
    path: str, override: Override = Override(), *, changed_task: bool = False
) -> LoadedResult:
    """Load a result and the task that it is of, as it was read and with the same back ends.

    Parameters
    ----------
    path
        A document ``skillplan.result/1``, or the folder that holds it as result.json.
    override
        What is to be otherwise.
    changed_task
        Whether the task may be another one than was solved.

    Raises
    ------
    OptionError
        If the file is no result, claims nothing, or is of another task.
    TaskError
        If the task file is wrong.
    """
    stored = read_result(path)
    if stored.status in (Status.REFUSED, Status.WRONG, Status.FAILED):
        raise OptionError(f"{path}: claims nothing, its status is {stored.status}.")
    own, removed = without_removed(found_origin(path, stored, override.file))
    origin = override.over(own)
    problem, difference = origin_problem(path, stored, origin, named=override.file is not None)
    if difference is not None and not changed_task:
        raise OptionError(f"{path}: is of another task: {difference}.")
    # Detectors that the user names are those of this version.
    collision = "" if override.collision else stored.collision
    setup = restored_setup(origin, collision, problem.tasks[-1])
    times_note = ""
    if stored.dwells_from is None and not override.changes:
        former = restored_setup(own, stored.collision, problem.tasks[-1])
        problem, times_note = with_former_dwells(path, problem, former, removed)
    return LoadedResult(path, stored, origin, problem, setup, times_note)


class _Stored(Solver):
    """Answers with what is stored, so that the referee can judge it."""

    name = "stored"

    def __init__(self, claims: StoredClaims, policy: Policy | None) -> None:
        super().__init__()
        self._claims, self._policy = claims, policy

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Return the stored plan, or the policy that it is from, and what was claimed."""
        claims = self._claims
        found: Plan | Policy = self._policy or Plan(tuple(claims.skills), claims.cost)
        proved = claims.status is Status.OPTIMAL and self._policy is None
        return Solution(found, claims.lower_bound, proved=proved, trace=claims.trace)
