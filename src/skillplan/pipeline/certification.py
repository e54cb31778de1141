"""Verification of a stored result: its task is loaded again, and each claim is checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import chain

from skillplan.checks.single_check import list_not_checked
from skillplan.checks.verdict_cache import AskingCache, VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, ModelTooLarge, OptionError, SearchStopped, name_hint
from skillplan.judge.claim_check import (
    ARITHMETIC,
    REPLAY,
    check_arithmetic,
    check_claims,
    explain_stop,
    replay_plan,
)
from skillplan.judge.fast_downward import NAME, check_with_planner, find_driver
from skillplan.model.policy_value import PolicyValue, evaluate_policy
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.exchange import is_charted
from skillplan.pipeline.record_check import (
    UNCHECKED,
    UNDER_CHANCE,
    RecordCheck,
    Replayed,
    SavedTables,
)
from skillplan.pipeline.restoration import (
    Override,
    drop_removed_options,
    find_origin,
    load_origin,
    load_result,
    restore_dwells,
    restore_setup,
)
from skillplan.pipeline.setup import CHART, DEFAULT_PHYSICS, Setup
from skillplan.pipeline.solving import make_model
from skillplan.records.certificate import Asked, Certificate, Claim, Outcome
from skillplan.records.result import Origin, Status, tolerance
from skillplan.records.stored.policy_file import read_policy
from skillplan.records.stored.result_file import StoredPart, StoredResult, read_with_document
from skillplan.records.stored.result_folder import POLICIES, find_file_beside
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task

_MOST_NAMED = 3
MOST_REPLANS = 100
"""No solver plans the upper levels of a chain again more often, and every time costs more."""


def certify(
    path: str,
    task_file: str | None = None,
    *,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
    saved_tables: SavedTables = lambda result, task: {},
) -> Certificate:
    """Verify a result of search-optimal without trusting the solver that made it.

    Parameters
    ----------
    path
        A document ``skillplan.result/1``, or the folder that holds it as result.json.
    task_file
        The task file; by default as the result names it, from the current folder or the result's.
    stop
        Limits of the second proofs; none by default.
    cache
        Kept verdicts; by default none, so that back ends are queried about everything.
    saved_tables
        Returns the expected tables of the result folder.

    Raises
    ------
    OptionError
        If the file is not a result, claims nothing, is for another task, or demands too much.
    TaskError
        If the task file is wrong.
    PluginError
        If a back end is unknown or broken.
    BackEndError
        If a back end fails.
    """
    stored, document = read_with_document(path)
    if stored.status in (Status.REFUSED, Status.WRONG, Status.FAILED):
        raise OptionError(f"{path}: claims nothing, its status is {stored.status}.")
    if not 0 <= stored.replans <= MOST_REPLANS:
        raise OptionError(
            f"{path}: cannot be verified: replans is {stored.replans}, and at most {MOST_REPLANS} "
            "are followed."
        )
    origin, removed = drop_removed_options(find_origin(path, stored, task_file))
    problem, difference = load_origin(path, stored, origin, named=task_file is not None)
    if difference is not None:
        raise OptionError(f"{path}: cannot be verified: {difference}. Name its own by --task.")
    notes: list[str] = []
    if stored.dwells_from is None:
        setup = restore_setup(origin, stored.collision, problem.tasks[-1])
        problem, sentence = restore_dwells(path, problem, setup, removed)
        notes += filter(None, [sentence])
    if stored.is_chain and origin.part is not None:
        raise OptionError(f"{path}: is damaged: it is of the whole chain and of {origin.part!r}.")
    check = _Check(path, stored, problem, origin, Stop() if stop is None else stop, cache)
    misfit = _find_shape_fault(stored, problem, origin)
    if misfit is not None:
        claims: list[Claim] = [Claim("parts", Outcome.FAILS, misfit, ARITHMETIC)]
    else:
        claims = list(check.chain() if stored.is_chain else check.single())
    record = RecordCheck(path, stored, problem, check.setup, check.model, check.stop)
    if misfit is None:
        claims += record.claims(document, check.replayed, saved_tables)
    unchecked = dict(UNCHECKED)
    if not all(part.task.deterministic for part in check.replayed.values()):
        unchecked["steps"] = UNDER_CHANCE
    return Certificate(
        path,
        problem.name,
        problem.kind,
        problem.sha256,
        tuple(claims),
        tuple(check.asked.values()),
        unchecked,
        cache is not None,
        tuple(dict.fromkeys(chain(notes, *(r.not_checked for r in check.replayed.values())))),
        origin,
    )


def _find_shape_fault(stored: StoredResult, problem: Problem, origin: Origin) -> str | None:
    """Return the reason why a result cannot belong to this file; None if it can."""
    whole = problem.is_chain and origin.part is None
    if stored.is_chain and not problem.is_chain:
        return f"it has the parts of a chain, and {problem.name} is a single task"
    if stored.is_chain and not stored.stages and not stored.sequences:
        return f"it holds none of the {len(problem.tasks)} tasks of {problem.name}"
    if whole and not stored.is_chain and len(problem.tasks) > 1:
        return f"it holds none of the {len(problem.tasks)} tasks of {problem.name}, nor names one"
    return None


_OUTCOMES = {True: Outcome.HOLDS, False: Outcome.FAILS, None: Outcome.NOT_CHECKED}


class _Check:
    """The state shared by the checks of the tasks of one result.

    Attributes
    ----------
    replayed
        The tasks so far, by name.
    asked
        The queried back ends, by name, version and options.
    """

    def __init__(
        self,
        path: str,
        stored: StoredResult,
        problem: Problem,
        origin: Origin,
        stop: Stop,
        cache: VerdictCache | None,
    ) -> None:
        self.path = path
        self.stored = stored
        self.problem = problem
        self.origin = origin
        self.setup = restore_setup(origin, stored.collision, problem.tasks[-1])
        self.stop = stop
        self.warm = cache is not None
        self.cache = VerdictCache() if cache is None else cache
        self.replayed: dict[str, Replayed] = {}
        self.asked: dict[str, Asked] = {}

    def single(self) -> Iterator[Claim]:
        """Yield the claims of the only task."""
        task = self.problem.part(self.origin.part)
        if self._replay(self.stored, task):
            yield from self._check_task(self.stored, task)
        else:
            yield self._make_given_up("plan")

    def chain(self) -> Iterator[Claim]:
        """Yield the claims of each task of a chain, grounded as it was when it was solved.

        All plans are replayed before the proofs, which may use up the time limit.
        """
        grounded: list[tuple[StoredPart, Task]] = []
        ending = self._replay_chain(grounded)
        for part, task in grounded:
            for claim in self._check_task(part, task):
                yield replace(claim, claim=f"{part.name}: {claim.claim}")
        if ending is not None:
            yield ending
        whole = ending is not None and ending.outcome is Outcome.HOLDS
        if whole and all(replayed.sound for replayed in self.replayed.values()):
            yield from self._check_sums(self.stored.sequences or [])
            yield from self._check_domain()

    def _replay_chain(self, grounded: list[tuple[StoredPart, Task]]) -> Claim | None:
        """Replay the parts in turn.

        Returns
        -------
        Claim or None
            The claim that no part is missing or extra; None if a plan does not hold, so that
            the parts after it cannot be grounded.
        """
        stored, problem = self.stored, self.problem
        parts = [*stored.stages, *(stored.sequences or ())]
        tasks = problem.follow({}, stored.replans) if stored.replans else problem.tasks
        plans: dict[str, tuple[str, ...]] = {}
        for index, part in enumerate(parts):
            if index > len(plans):
                words = f"it follows {parts[index - 1].name}, which has no plan"
                return Claim(part.name, Outcome.FAILS, words, "grounding")
            if index and part.stage != parts[index - 1].stage:
                if self.stop.overdue():
                    return self._make_given_up(part.name)
                try:
                    tasks = problem.follow(plans, stored.replans)
                except ChainBroken as error:
                    words = f"does not follow from the parts before: {error}"
                    return Claim(part.name, Outcome.FAILS, words, "grounding")
            if index >= len(tasks) or tasks[index].name != part.name:
                here = tasks[index].name if index < len(tasks) else "nothing"
                words = f"{part.name} stands where the chain has {here}"
                return Claim(part.name, Outcome.FAILS, words, "grounding")
            if not self._replay(part, tasks[index]):
                return self._make_given_up(f"{part.name}: plan")
            grounded.append((part, tasks[index]))
            replayed = self.replayed[part.name]
            if not replayed.sound:
                # Later parts cannot be grounded on a plan that does not hold.
                return None
            if replayed.walked is not None:
                plans[part.name] = tuple(step.skill for step in replayed.walked.steps)
        return self._check_parts(parts, plans)

    def _check_parts(
        self, parts: Sequence[StoredPart], plans: Mapping[str, Sequence[str]]
    ) -> Claim:
        """Return the claim that the parts are the tasks of the chain."""
        last = parts[-1].name
        if last not in plans:
            words = f"{len(parts)}; the chain ends with {last}, which has no plan"
            return Claim("parts", Outcome.HOLDS, words, "grounding")
        try:
            tasks = self.problem.follow(plans, self.stored.replans)
        except ChainBroken as error:
            words = f"{len(parts)}; the chain ends with {last}: {error}"
            return Claim("parts", Outcome.HOLDS, words, "grounding")
        missing = [task.name for task in tasks[len(parts) :]]
        if not missing or self.stored.status is Status.UNSOLVED:
            words = f"{len(parts)} of {len(tasks)} tasks"
            return Claim("parts", Outcome.HOLDS, words, "grounding")
        more = f" and {len(missing) - _MOST_NAMED} more" if len(missing) > _MOST_NAMED else ""
        words = f"after {last}, {', '.join(missing[:_MOST_NAMED])}{more} missing"
        return Claim("parts", Outcome.FAILS, words, "grounding")

    def _check_domain(self) -> Iterator[Claim]:
        """Yield the claims that the kind of task requires of a complete chain."""
        plans = {name: tuple(replayed.stored.skills) for name, replayed in self.replayed.items()}
        if self.stored.cost is None and self.stored.status is not Status.INFEASIBLE:
            return
        problem = self.problem
        for check in problem.domain.recheck(problem.config, plans, self.stored.replans):
            outcome = _OUTCOMES[check.holds]
            yield Claim(check.claim, outcome, check.detail, check.method)

    def _make_given_up(self, claim: str) -> Claim:
        words = "interrupted" if self.stop.interrupted else explain_stop(self.stop)
        return Claim(claim, Outcome.NOT_CHECKED, words, REPLAY, open=False)

    def model(self, task: Task, cache: VerdictCache | None = None) -> SkillModel:
        """Return a model of a task, and record the back ends that it queries."""
        kept = self.cache if cache is None else cache
        model = make_model(task, self.setup, kept, self.stop.overdue)
        for back_end in model.feasibility.back_ends:
            options = back_end.options.model_dump(mode="json")
            queried = Asked(back_end.name, back_end.version, options)
            self.asked.setdefault(repr(queried), queried)
        return model

    def _replay(self, stored: StoredResult | StoredPart, task: Task) -> bool:
        """Replay a plan; return False if the time limit ended it."""
        if self.stop.interrupted:
            return False
        # In the replay each state has a verdict of its own.
        fresh = self.cache if self.warm else AskingCache(self.cache)
        try:
            model = self.model(task, fresh)
            with closing(model.feasibility):
                walked = replay_plan(stored, model)
                expected = self._evaluate_policy(task, model)
        except SearchStopped:
            return False
        not_checked = list_not_checked(model.feasibility.back_ends)
        self.replayed[task.name] = Replayed(task, stored, walked, expected, not_checked)
        return True

    def _check_task(self, stored: StoredResult | StoredPart, task: Task) -> Iterator[Claim]:
        self.stop.renew()
        self.stop.decimals = task.metric.decimals
        replayed = self.replayed[task.name]
        model = self.model(task)
        with closing(model.feasibility):
            yield from check_claims(
                stored, replayed.walked, model, self.stop, replayed.expected, self.problem.domain
            )
        if replayed.walked is not None:
            yield from self._check_later_detectors(stored, task)

    def _check_later_detectors(
        self, stored: StoredResult | StoredPart, task: Task
    ) -> Iterator[Claim]:
        """Yield the claim that a plan holds under detectors that were no default of its version.

        If it does, a proof about more plans also holds for the plans that all detectors allow.
        """
        origin = self.origin
        today = Setup(DEFAULT_PHYSICS, origin.collision, origin.options)
        names = [choice.name for choice in today.named_collision_choices(task)]
        used = [choice.name for choice in self.setup.named_collision_choices(task)]
        missing = [name for name in names if name not in used]
        # Another geometric detector is a choice of the user, none at all is an omission.
        if set(used) - {CHART}:
            missing = [name for name in missing if name == CHART]
        if not missing:
            return
        claim = "chart" if missing == [CHART] else "geometry"
        setup = replace(today, collision=tuple(missing), with_chart=False)
        try:
            model = make_model(task, setup, overdue=self.stop.overdue)
            with closing(model.feasibility):
                walked = replay_plan(stored, model)
        except (OptionError, SearchStopped) as error:
            words = str(error) if isinstance(error, OptionError) else explain_stop(self.stop)
            yield Claim(claim, Outcome.NOT_CHECKED, words, REPLAY, open=False)
            return
        by = f"{', '.join(missing)}, which the result was not checked by"
        fault = next(iter(walked.violations), None) if walked is not None else None
        if fault is None:
            yield Claim(claim, Outcome.HOLDS, f"the plan holds under {by}", REPLAY)
        else:
            words = f"step {fault.step + 1}, {fault.skill}, fails under {by}: {fault.reason}"
            yield Claim(claim, Outcome.FAILS, words, REPLAY)

    def _evaluate_policy(self, task: Task, model: SkillModel) -> PolicyValue | None:
        """Return the value of the stored policy, for a task with chance."""
        path = find_file_beside(self.path, POLICIES)
        if task.deterministic or path is None:
            return None
        try:
            return evaluate_policy(
                model, read_policy(str(path), task, within=str(path.parent)).policy.get
            )
        except (OptionError, ModelTooLarge):
            # A faulty file is reported with the claim on the file itself.
            return None

    def _check_sums(self, main: list[StoredPart]) -> Iterator[Claim]:
        """Yield the claims about the whole chain: the sum of costs, and the proof."""
        stored = self.stored
        costs = [part.cost for part in main if part.cost is not None]
        if stored.cost is not None:
            total = sum(costs)
            holds = len(costs) == len(main) and abs(total - stored.cost) <= tolerance(total)
            outcome = Outcome.HOLDS if holds else Outcome.FAILS
            words = f"the parts cost {total:.10g}, claimed {stored.cost:.10g}"
            yield Claim("cost", outcome, words, ARITHMETIC)
        yield from check_arithmetic(stored)
        bounds = [part.lower_bound for part in main if part.lower_bound is not None]
        if stored.lower_bound is None:
            return
        added = sum(bounds)
        whole = len(bounds) == len(main) and not stored.stages
        plans = {
            name: replayed.stored.skills
            for name, replayed in self.replayed.items()
            if replayed.walked
        }
        account = self.problem.account(plans, stored.replans).lower_bound
        if whole and stored.lower_bound <= added + tolerance(added):
            words = f"those of the parts add up to {added:.10g}"
            yield Claim("lower bound", Outcome.HOLDS, words, ARITHMETIC)
        elif account is not None and stored.lower_bound <= account + tolerance(account):
            words = f"no plans of the stages together cost less than {account:.10g}"
            yield Claim("lower bound", Outcome.HOLDS, words, "account of the whole job")
        else:
            words = "is about all plans of the stages together; only the parts are proved again"
            yield Claim("lower bound", Outcome.NOT_CHECKED, words, ARITHMETIC, open=False)


REFEREES = (NAME,)


def check_referee(name: str) -> None:
    """Check that a referee is known and installed.

    Raises
    ------
    OptionError
        If it is not.
    """
    if name not in REFEREES:
        raise OptionError(f"--with {name}: no such referee. {name_hint(name, REFEREES)}")
    find_driver()


def referee_claims(path: str, task_file: str | None, limit_s: float, stop: Stop) -> Iterator[Claim]:
    """Yield the claims of a result as Fast Downward judges them, task by task.

    Parameters
    ----------
    path
        The result.
    task_file
        The task file; None for the file that the result names.
    limit_s
        Time limit for each task [s], > 0.
    stop
        Ends the check if it is interrupted.

    Raises
    ------
    OptionError
        If the result cannot be used, or the planner is not installed.
    BackEndError
        If a back end fails.
    """
    loaded = load_result(path, Override(task_file))
    stored = loaded.stored
    tasks = list(loaded.plans()) if stored.cost is not None else []
    if not tasks and not stored.is_chain:
        tasks = [(loaded.problem.part(loaded.origin.part), stored)]
    for task, claims in tasks:
        if stop.interrupted:
            return
        clock = Stop(time_limit_s=limit_s)
        model = make_model(task, loaded.setup, overdue=partial(_is_over, stop, clock))
        with closing(model.feasibility):
            by_chart = is_charted(model, loaded.setup)
            for claim in check_with_planner(claims, model, limit_s, charted=by_chart):
                prefix = f"{task.name}: " if stored.is_chain else ""
                yield replace(claim, claim=f"{prefix}{claim.claim}")


def _is_over(stop: Stop, clock: Stop) -> bool:
    return stop.interrupted or clock.overdue()
