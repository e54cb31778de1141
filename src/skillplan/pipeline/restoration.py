"""Stored results: finding and loading their task, restoring their setup, and judging their plans.

A result may come from anybody and may name any file of the reader. So a task file that the user did
not name is not quoted in messages, unless it lies beside the result or in the current folder.

Results of versions in which back ends had dwell times of their own are checked by the rule of their
time: a back end that planned times added its own dwells. Without one, dwells were added once a
skill, so that a tool put back in a swap, and a screw fetched from a feeder, took none. A bit went
down to the feeder, not to the head of a screw that stands on it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, Issue, OptionError, PluginError, TaskError, name_hint
from skillplan.files.regular_file import is_regular
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.setup import BACK_END_KINDS, BOXES, CHART, SCREEN, Setup, load_problem
from skillplan.pipeline.solving import solve
from skillplan.records.chain_result import ChainPart, ChainResult
from skillplan.records.result import Origin, Result, Status
from skillplan.records.stored.policy_file import read_policy
from skillplan.records.stored.result_file import (
    StoredClaims,
    StoredPart,
    StoredResult,
    other_task,
    read_result,
)
from skillplan.records.stored.result_folder import policies_path, result_path
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.task.back_end import RemovedDwell
from skillplan.task.cost import Cost, DistanceCost
from skillplan.task.motion import Event, Motion, Visit
from skillplan.task.skill import Skill
from skillplan.task.task import BackEndChoice, Task


@contextmanager
def unquoted(document: str, file: str) -> Iterator[None]:
    """Word what is wrong with a file so that nothing of its content is told.

    Parameters
    ----------
    document
        What names the file.
    file
        The file.

    Raises
    ------
    TaskError
        If anything within raises one: the same file and place, without what stands there.
    OptionError
        Likewise.
    """
    try:
        yield
    except TaskError as error:
        if isinstance(error.__cause__, PluginError):
            raise  # it quotes the kind alone, which is a known one
        first = error.issues[0]
        message = (
            f"is no sound task file here. {document} names it, so it is not quoted: see "
            f"'skillplan check {file}', or name another by --task."
        )
        raise TaskError(error.source, [Issue(message, (), first.line, first.column)]) from None
    except OptionError:
        raise OptionError(
            f"{document}: what it says was changed of {file} does not fit that file, which is not "
            "quoted. Name the task file by --task."
        ) from None


def is_near(file: str, document_folder: Path) -> bool:
    """Whether a file lies in the current folder, or in the one that holds a document's folder.

    Parameters
    ----------
    file
        The file.
    document_folder
        The folder of the document that names it.
    """
    real = Path(os.path.realpath(file))
    beside = os.path.realpath(document_folder / os.pardir)
    try:
        here = os.getcwd()
    except OSError:
        return real.is_relative_to(beside)
    return real.is_relative_to(beside) or real.is_relative_to(here)


def origin_problem(
    path: str, stored: StoredResult, origin: Origin, *, named: bool
) -> tuple[Problem, str | None]:
    """Load the task of a result; return it, and in words how it is another than was solved.

    Parameters
    ----------
    path
        Of the result.
    stored
        What it says.
    origin
        How its task is loaded.
    named
        Whether the user named the task file; of others nothing is told that they hold, unless
        they lie near.

    Raises
    ------
    OptionError
        If the file is far off, another task, and not named by the user.
    TaskError
        If the task file is wrong.
    """
    queried, former = named_back_ends(origin), stored.dwells_from is None
    with nullcontext() if named else unquoted(path, origin.file):
        problem = load_problem(origin.file, queried, origin.changes, former=former)
    told = named or is_near(origin.file, result_path(path).parent)
    difference = other_task(stored, problem, quoted=told)
    if difference is not None and former:
        was_solved = _with_former_defaults(stored, origin, problem)
        if was_solved is not None:
            return was_solved, None
    if difference is None or told:
        return problem, difference
    before = {} if stored.origin is None else stored.origin.changes
    if before != origin.changes:
        # The user changes something; what counts is whether the file is the one that was solved.
        with unquoted(path, origin.file):
            was = load_problem(origin.file, queried, before, former=former)
        if other_task(stored, was) is None:
            return problem, difference
    raise OptionError(f"{path}: is of another task: {difference}. Name its own by --task.")


def _with_former_defaults(stored: StoredResult, origin: Origin, problem: Problem) -> Problem | None:
    """Return a file's task with the defaults of earlier versions; None if that is another task.

    Equal hashes show that it is the task that was solved, so nothing else is taken for it.
    """
    changes = {**problem.domain.former_defaults, **origin.changes}
    if changes == origin.changes:
        return None
    try:
        former = load_problem(origin.file, named_back_ends(origin), changes, former=True)
    except TaskError:
        # The file gives a key that excludes the default, which did not count then.
        return None
    return former if other_task(stored, former) is None else None


def found_origin(path: str, stored: StoredResult, task_file: str | None) -> Origin:
    """Return how to load a result's task; by the names of its back ends where no more is known.

    Parameters
    ----------
    path
        Of the result, beside which the task file is looked for.
    stored
        What it says.
    task_file
        The task file, if it is not to be looked for.

    Raises
    ------
    OptionError
        If the task file is not said, or not found.
    """
    if stored.origin is not None:
        origin = stored.origin.origin()
    elif task_file is None:
        raise OptionError(f"{path}: does not say which file its task is from. Name it by --task.")
    else:
        part = None if stored.is_chain else stored.task.name
        collision = tuple(filter(None, stored.collision.split(",")))
        origin = Origin(task_file, part, {}, stored.physics, collision)
    if task_file is not None:
        return replace(origin, file=task_file)
    folder = result_path(path).parent
    for candidate in (Path(origin.file), folder / origin.file, folder / Path(origin.file).name):
        if is_regular(candidate):
            return replace(origin, file=str(candidate))
    raise OptionError(
        f"{path}: its task {origin.file} is neither here nor beside it. Name it by --task."
    )


def restored_setup(origin: Origin, collision: str, task: Task) -> Setup:
    """Return the setup under which a stored result was made.

    A result whose origin names no detectors was made under the defaults of its version, which may
    not be those of this one. Its `collision` key says which they were: older versions checked a
    chart alone by default, or no chart if the task file chose a detector.

    Parameters
    ----------
    origin
        How its task was read.
    collision
        Names of the detectors that it claims, with commas.
    task
        The task, or one of the chain.
    """
    setup = Setup(origin.physics, origin.collision, origin.options, origin.screening)
    candidates = [setup, replace(setup, with_chart=False)]
    if not origin.collision and not task.collision:
        names = tuple(filter(None, collision.split(",")))
        if task.chart:
            candidates.append(replace(setup, collision=(CHART,)))
        if set(names) <= {CHART, SCREEN, BOXES} and CHART not in names[:1]:
            candidates.append(replace(setup, collision=names, with_chart=False))
    for candidate in candidates:
        if candidate.detector_names(task) == collision:
            return candidate
    return setup


def named_back_ends(origin: Origin) -> Mapping[str, list[str]]:
    """Return the names of the back ends that an origin chooses, by kind."""
    named = {"physics": [] if origin.physics is None else [origin.physics]}
    named["collision"] = list(origin.collision)
    return {kind: names for kind, names in named.items() if names}


Options = Mapping[str, Mapping[str, Any]]


def without_removed(origin: Origin) -> tuple[Origin, Options]:
    """Return an origin without options that were removed since, and these, by plugin."""
    kept, removed = {}, {}
    for plugin, values in origin.options.items():
        known = _removed_options(plugin)
        removed[plugin] = {key: value for key, value in values.items() if key in known}
        kept[plugin] = {key: value for key, value in values.items() if key not in known}
    return replace(origin, options=kept), removed


def with_former_dwells(
    path: str, problem: Problem, setup: Setup, removed: Options
) -> tuple[Problem, str]:
    """Return a problem with the dwell times of earlier versions, and a sentence about them.

    Parameters
    ----------
    path
        The result, for messages.
    problem
        As it is loaded now; its hash stays.
    setup
        The back ends under which the result was made.
    removed
        The removed options that the result names, by plugin.

    Raises
    ------
    OptionError
        If a removed option is not a time.
    """
    tasks, sentences = [], []
    for task in problem.tasks:
        if not task.dwells_from:
            tasks.append(task)
            continue
        timer = setup.timed_by(task).partition(",")[0]
        chosen = {choice.name: choice.options for choice in task.collision}
        given = {**chosen.get(timer, {}), **removed.get(timer, {})}
        known = _removed_options(timer)
        dwells_s = {one.event: _time_s(path, key, given, one) for key, one in known.items()}
        tasks.append(_with_dwells(task, dwells_s))
        words = ", ".join(f"{key} {dwells_s[one.event]:g} s" for key, one in known.items())
        words = f"the options of {timer} at that time ({words})" if known else "one dwell a skill"
        sentences.append(
            f"today's durations_s: the result is of an earlier version, and its times are those "
            f"with {words}"
        )
    return replace(problem, tasks=tuple(tasks), spare_back_ends=[]), "; ".join(sentences)


def _removed_options(plugin: str) -> Mapping[str, RemovedDwell]:
    for kind in BACK_END_KINDS:
        if plugin in registry.names(kind):
            removed: Mapping[str, RemovedDwell] = registry.load(kind, plugin).removed_options
            return removed
    return {}


def _time_s(path: str, key: str, given: Mapping[str, Any], option: RemovedDwell) -> float:
    try:
        value_s = float(given.get(key, option.default_s))
    except (TypeError, ValueError):
        value_s = math.nan
    if not 0 <= value_s < math.inf:
        raise OptionError(f"{path}: is damaged: its option {key} is {given[key]!r}, no time.")
    return value_s


def _with_dwells(task: Task, dwells_s: Mapping[Event, float]) -> Task:
    """Return a task with other dwells and without removed options; its hash stays."""

    def dwell_s(visit: Visit, last: Visit) -> float:
        if dwells_s:
            return dwells_s.get(visit.event, visit.dwell_s)
        return visit.dwell_s if visit is last else 0.0

    bare_bit = Event.FETCH in dwells_s
    skills = tuple(_redwelt(skill, dwell_s, bare_bit=bare_bit) for skill in task.skills)
    collision = tuple(
        BackEndChoice(
            choice.name,
            {k: v for k, v in choice.options.items() if k not in _removed_options(choice.name)},
        )
        for choice in task.collision
    )
    return task.replace(skills=skills, collision=collision, sha256=task.sha256)


def _redwelt(skill: Skill, dwell_s: Callable[[Visit, Visit], float], *, bare_bit: bool) -> Skill:
    def former(visit: Visit) -> Visit:
        # The bit went down to the feeder itself, and the screw that it took was not modelled: as
        # if it took up its own tool there.
        if bare_bit and visit.event is Event.FETCH:
            return replace(visit, event=Event.LOAD, subject=skill.parameters["tool"])
        return visit

    def moved(motion: Motion) -> Motion:
        routes = [
            replace(
                route,
                visits=tuple(
                    former(replace(visit, dwell_s=dwell_s(visit, route.visits[-1])))
                    for visit in route.visits
                ),
            )
            for route in motion.routes
        ]
        return replace(motion, routes=tuple(routes))

    def timed(cost: Cost) -> Cost:
        is_time = isinstance(cost, DistanceCost) and cost.dwells
        return replace(cost, motion=moved(cost.motion)) if is_time else cost  # type: ignore

    return replace(
        skill,
        motion=None if skill.motion is None else moved(skill.motion),
        ways=tuple(replace(way, motion=moved(way.motion)) for way in skill.ways),
        cost=timed(skill.cost),
        duration_s=timed(skill.duration_s),
    )


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
