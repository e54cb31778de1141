"""Stored results: finding and loading their task, restoring their setup, and judging their plans.

A result may come from anyone and may name any file of the reader. So messages quote a task file
only if the user named it, or if it is in the current folder or near the result.

Results of versions in which back ends had dwell times of their own are checked by the rule of their
time: a back end that planned times added its own dwells. Without one, dwells were added once a
skill, so that a tool put back in a swap, and a screw fetched from a feeder, took none. A bit went
down to the feeder, not to the head of a screw that stands on it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
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
    describe_other_task,
    read_result,
)
from skillplan.records.stored.result_folder import find_policies_path, find_result_path
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.task.back_end import RemovedDwell
from skillplan.task.cost import Cost, DistanceCost
from skillplan.task.motion import Event, Motion, Visit
from skillplan.task.skill import Skill
from skillplan.task.task import BackEndChoice, Task

# End of messages that ask for the task file.
_OR_NAME = ", or name it by --task."


@contextmanager
def unquoted(document: str, file: str) -> Iterator[None]:
    """Replace errors about a file by errors that quote none of its content.

    Parameters
    ----------
    document
        The document that names the file, for messages.
    file
        The file.

    Raises
    ------
    TaskError
        In place of a `TaskError`, with the same place in the file.
    OptionError
        In place of an `OptionError`.
    """
    try:
        yield
    except TaskError as error:
        if isinstance(error.__cause__, PluginError):
            raise  # quotes only the kind, which is a known one
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
    """Return whether a file is in the current folder or in the parent folder of the document's."""
    real = Path(os.path.realpath(file))
    beside = os.path.realpath(document_folder / os.pardir)
    try:
        here = os.getcwd()
    except OSError:
        return real.is_relative_to(beside)
    return real.is_relative_to(beside) or real.is_relative_to(here)


def _is_task(origin: Origin, *, former: bool) -> bool:
    """Return whether a file is a task that some back ends may refuse."""
    none: Mapping[str, Collection[str]] = dict.fromkeys(BACK_END_KINDS, ())
    try:
        load_problem(origin.file, none, origin.changes, former=former)
    except (TaskError, OptionError):
        return False
    return True


def load_origin(
    path: str, stored: StoredResult, origin: Origin, *, named: bool
) -> tuple[Problem, str | None]:
    """Load the task of a result; return it, and its difference from the task that was solved.

    Parameters
    ----------
    path
        The result, for messages.
    stored
        Content of the result.
    origin
        Task file and how it is read.
    named
        True if the user named the task file. Other files are quoted only if they lie near.

    Raises
    ------
    OptionError
        If the file holds another task, lies far off, and was not named by the user.
    TaskError
        If the task file is wrong.
    """
    queried, former = list_back_ends(origin), stored.dwells_from is None
    is_quotable = named or is_near(origin.file, find_result_path(path).parent)
    try:
        problem = load_problem(origin.file, queried, origin.changes, former=former)
    except (TaskError, OptionError):
        if named or (is_quotable and _is_task(origin, former=former)):
            raise  # a fault that a back end finds in a task
        with unquoted(path, origin.file):
            raise
    difference = describe_other_task(stored, problem, quoted=is_quotable)
    if difference is not None and former:
        was_solved = _load_with_former_defaults(stored, origin, problem)
        if was_solved is not None:
            return was_solved, None
    if difference is None or is_quotable:
        return problem, difference
    before = {} if stored.origin is None else stored.origin.changes
    if before != origin.changes:
        # The user changes something, so compare the file without changes with the solved task.
        with unquoted(path, origin.file):
            was = load_problem(origin.file, queried, before, former=former)
        if describe_other_task(stored, was) is None:
            return problem, difference
    raise OptionError(f"{path}: is of another task: {difference}. Put its own there{_OR_NAME}")


def _load_with_former_defaults(
    stored: StoredResult, origin: Origin, problem: Problem
) -> Problem | None:
    """Load a file with the defaults of earlier versions; return None if that is another task.

    Equal hashes prove that it is the task that was solved.
    """
    changes = {**problem.domain.former_defaults, **origin.changes}
    if changes == origin.changes:
        return None
    try:
        former = load_problem(origin.file, list_back_ends(origin), changes, former=True)
    except TaskError:
        # The file has a key that excludes the default.
        return None
    return former if describe_other_task(stored, former) is None else None


def find_origin(path: str, stored: StoredResult, task_file: str | None) -> Origin:
    """Return the task file of a result and the way to read it.

    A result of an early version has no origin, only the names of its back ends.

    Parameters
    ----------
    path
        The result. Its folder is searched for the task file, too.
    stored
        Content of the result.
    task_file
        The task file; None for the file that the result names.

    Raises
    ------
    OptionError
        If the result names no task file, or it is not found.
    """
    if stored.origin is not None:
        origin = stored.origin.origin()
    elif task_file is None:
        raise OptionError(
            f"{path}: does not say which file its task is from. Solve the task again{_OR_NAME}"
        )
    else:
        part = None if stored.is_chain else stored.task.name
        collision = tuple(filter(None, stored.collision.split(",")))
        origin = Origin(task_file, part, {}, stored.physics, collision)
    if task_file is not None:
        return replace(origin, file=task_file)
    folder = find_result_path(path).parent
    for candidate in (Path(origin.file), folder / origin.file, folder / Path(origin.file).name):
        if is_regular(candidate):
            return replace(origin, file=str(candidate))
    raise OptionError(
        f"{path}: its task {origin.file} is neither here nor beside it. Copy it there{_OR_NAME}"
    )


def restore_setup(origin: Origin, collision: str, task: Task) -> Setup:
    """Return the setup under which a stored result was made.

    A result whose origin names no detectors was made under the defaults of its version. Its
    `collision` key has their names: older versions checked a chart alone by default, or no chart
    if the task file chose a detector.

    Parameters
    ----------
    origin
        Task file and how it is read.
    collision
        Names of the detectors in the result, separated by commas.
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


def list_back_ends(origin: Origin) -> Mapping[str, list[str]]:
    """Return the names of the back ends that an origin chooses, by kind."""
    named = {"physics": [] if origin.physics is None else [origin.physics]}
    named["collision"] = list(origin.collision)
    return {kind: names for kind, names in named.items() if names}


Options = Mapping[str, Mapping[str, Any]]


def drop_removed_options(origin: Origin) -> tuple[Origin, Options]:
    """Return an origin without removed options, and the removed options by plugin."""
    kept, removed = {}, {}
    for plugin, values in origin.options.items():
        known = _removed_options(plugin)
        removed[plugin] = {key: value for key, value in values.items() if key in known}
        kept[plugin] = {key: value for key, value in values.items() if key not in known}
    return replace(origin, options=kept), removed


def restore_dwells(
    path: str, problem: Problem, setup: Setup, removed: Options
) -> tuple[Problem, str]:
    """Return a problem with the dwell times of earlier versions, and a sentence about them.

    Parameters
    ----------
    path
        The result, for messages.
    problem
        The loaded problem, whose hash stays.
    setup
        Setup under which the result was made.
    removed
        Removed options that the result names, by plugin.

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
        dwells_s = {
            option.event: _time_s(path, key, given, option) for key, option in known.items()
        }
        tasks.append(_replace_dwells(task, dwells_s))
        words = ", ".join(f"{key} {dwells_s[option.event]:g} s" for key, option in known.items())
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


def _replace_dwells(task: Task, dwells_s: Mapping[Event, float]) -> Task:
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


# Number of tasks that a message names.
_MOST_NAMED = 8


@dataclass(frozen=True, slots=True)
class Override:
    """Choices of the user that override the origin of a result.

    Parameters
    ----------
    file
        The task file; None to keep it.
    part
        Name of one task of a chain; None to keep it.
    changes
        Key path to YAML value, in addition to the changes of the origin.
    physics, collision
        Names of back ends; None and empty to keep them.
    options
        Plugin name to option values, in addition to the options of the origin.
    """

    file: str | None = None
    part: str | None = None
    changes: Mapping[str, str] = field(default_factory=dict)
    physics: str | None = None
    collision: tuple[str, ...] = ()
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def over(self, origin: Origin) -> Origin:
        """Return an origin with these choices."""
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
    """A stored result with its task.

    Parameters
    ----------
    path
        Path as the user typed it.
    stored
        Content of the result.
    origin
        Task file and how it was read.
    problem
        The loaded task file.
    setup
        Back ends and options.
    times_note
        Sentence about the times of a result of an earlier version; empty for others.
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
            If the result holds no plan, or has several tasks and none is named.
        """
        plans = [(task, tuple(claims.skills)) for task, claims in self.plans()]
        names = [task.name for task, _ in plans]
        if not self.stored.is_chain or (self.origin.part is None and len(names) == 1):
            return plans[0]
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
        return plans[names.index(self.origin.part)]

    def taken_ways(self) -> tuple[str | None, ...]:
        """Return the variant of each step of the plan; None for a skill with a single variant.

        Raises
        ------
        OptionError
            As `planned`.
        """
        task, _ = self.planned()
        claims = next(claims for own, claims in self.plans() if own.name == task.name)
        return tuple(step.way for step in claims.steps)

    def plans(self) -> Iterator[tuple[Task, StoredClaims]]:
        """Yield each task, grounded as it was when it was solved, with its claims.

        Raises
        ------
        OptionError
            If a task has no plan, or a plan does not follow from the plans before it.
        """
        if not self.stored.is_chain:
            only = self.origin.part if self.problem.is_chain else None
            yield self.problem.part(only), self._require_plan(self.stored, self.stored.task.name)
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
            yield tasks[index], self._require_plan(part, part.name)
            plans[part.name] = tuple(part.skills)

    def answer_for(self, task: Task | None) -> Result | ChainResult | None:
        """Return the result of one task, or of the whole chain for None; None if it is missing."""
        if task is None:
            return self.answer() if self.stored.is_chain else None
        for own, claims in self.plans():
            if own.name == task.name:
                return self._judge(own, claims, VerdictCache())
        return None

    def answer(self, cache: VerdictCache | None = None) -> Result | ChainResult:
        """Return the result as the referee grades it now, without a search.

        Parameters
        ----------
        cache
            Verdict cache; by default a new one in memory.

        Raises
        ------
        OptionError
            If the result holds no plan.
        """
        cache = VerdictCache() if cache is None else cache
        parts = []
        for task, claims in self.plans():
            parts.append(ChainPart(task, self._judge(task, claims, cache)))
        if not self.stored.is_chain:
            return parts[0].result
        plans = {part.task.name: tuple(step.skill for step in part.result.steps) for part in parts}
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

    def _judge(self, task: Task, claims: StoredClaims, cache: VerdictCache) -> Result:
        stand_in = _Stored(claims, self._policy(task))
        result = solve(task, stand_in, self.setup, seed=self.stored.seed, cache=cache)
        return replace(result, solver=claims.solver)

    def _require_plan(self, claims: StoredClaims, name: str) -> StoredClaims:
        if claims.cost is None:
            raise OptionError(
                f"{self.path}: holds no plan of {name}, its status is {claims.status}."
            )
        return claims

    def _policy(self, task: Task) -> Policy | None:
        """Return the stored policy for the task, or None."""
        folder = str(find_result_path(self.path).parent)
        with suppress(OptionError):
            return read_policy(find_policies_path(folder), task, within=folder).policy
        return None


def load_result(
    path: str, override: Override = Override(), *, changed_task: bool = False
) -> LoadedResult:
    """Load a result, its task and its back ends, as they were when it was made.

    Parameters
    ----------
    path
        A document ``skillplan.result/1``, or the folder that holds it as result.json.
    override
        Choices of the user that override the origin.
    changed_task
        True if the task may differ from the task that was solved.

    Raises
    ------
    OptionError
        If the file is not a result, claims nothing, or is for another task.
    TaskError
        If the task file is wrong.
    """
    stored = read_result(path)
    if stored.status in (Status.REFUSED, Status.WRONG, Status.FAILED):
        raise OptionError(f"{path}: claims nothing, its status is {stored.status}.")
    own, removed = drop_removed_options(find_origin(path, stored, override.file))
    origin = override.over(own)
    problem, difference = load_origin(path, stored, origin, named=override.file is not None)
    if difference is not None and not changed_task:
        raise OptionError(f"{path}: is of another task: {difference}.")
    # Names of detectors on the command line are names of this version.
    collision = "" if override.collision else stored.collision
    setup = restore_setup(origin, collision, problem.tasks[-1])
    times_note = ""
    if stored.dwells_from is None and not override.changes:
        former = restore_setup(own, stored.collision, problem.tasks[-1])
        problem, times_note = restore_dwells(path, problem, former, removed)
    return LoadedResult(path, stored, origin, problem, setup, times_note)


class _Stored(Solver):
    """A solver that returns a stored plan or policy, so that the referee can judge it."""

    name = "stored"

    def __init__(self, claims: StoredClaims, policy: Policy | None) -> None:
        super().__init__()
        self._claims, self._policy = claims, policy

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Return the stored answer with its claims."""
        claims = self._claims
        plan: Plan | Policy = self._policy or Plan(tuple(claims.skills), claims.cost)
        proved = claims.status is Status.OPTIMAL and self._policy is None
        return Solution(plan, claims.lower_bound, proved=proved, trace=claims.trace)
