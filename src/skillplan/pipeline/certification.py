"""A stored result, verified: its task is loaded again and every claim is checked on its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, OptionError
from skillplan.judge.claim_check import ARITHMETIC, calculated_claims, checked_claims
from skillplan.pipeline.result_origin import found_origin, origin_problem
from skillplan.pipeline.run import make_model
from skillplan.pipeline.setup import Setup
from skillplan.records.certificate import Certificate, Claim, Outcome
from skillplan.records.result import Status, tolerance
from skillplan.records.stored.result_file import (
    StoredPart,
    StoredResult,
    read_result,
)
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task


def certify(
    path: str,
    task_file: str | None = None,
    *,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
) -> Certificate:
    """Verify a result of search-optimal without trusting what made it.

    Parameters
    ----------
    path
        A document ``skillplan.result/1``, or the folder that holds it as result.json.
    task_file
        The task; by default the file that the result names, from here or beside the result.
    stop
        When to give up second proofs; by default never.
    cache
        Where verdicts of expensive back ends are kept; a fresh one in memory by default.

    Raises
    ------
    OptionError
        If the file is no result, claims nothing, or is of another task.
    TaskError
        If the task file is wrong.
    PluginError
        If a back end is unknown or broken.
    BackEndError
        If a back end fails.
    """
    stored = read_result(path)
    if stored.status in (Status.REFUSED, Status.WRONG, Status.FAILED):
        raise OptionError(f"{path}: claims nothing, its status is {stored.status}.")
    origin = found_origin(path, stored, task_file)
    problem, difference = origin_problem(path, stored, origin, named=task_file is not None)
    if difference is not None:
        raise OptionError(f"{path}: cannot be verified: {difference}. Name its own by --task.")
    setup = Setup(origin.physics, origin.collision, origin.options)
    check = _Check(path, stored, problem, setup, Stop() if stop is None else stop, cache)
    claims = tuple(check.chain() if stored.is_chain else check.single(origin.part))
    return Certificate(path, problem.name, problem.kind, problem.sha256, claims)


class _Check:
    """What checking the tasks of one result shares."""

    def __init__(
        self,
        path: str,
        stored: StoredResult,
        problem: Problem,
        setup: Setup,
        stop: Stop,
        cache: VerdictCache | None,
    ) -> None:
        self.path = path
        self.stored = stored
        self.problem = problem
        self.setup = setup
        self.stop = stop
        self.cache = VerdictCache() if cache is None else cache

    def single(self, part: str | None) -> Iterator[Claim]:
        """Yield the claims of the only task."""
        only = part if self.problem.is_chain else None
        yield from self._task_claims(self.stored, self.problem.part(only))

    def chain(self) -> Iterator[Claim]:
        """Yield the claims of every task of a chain, grounded as it was when that was solved."""
        stored, problem = self.stored, self.problem
        parts = [*stored.stages, *(stored.sequences or ())]
        tasks = problem.follow({}, stored.replans) if stored.replans else problem.tasks
        plans: dict[str, tuple[str, ...]] = {}
        for index, part in enumerate(parts):
            if index and part.stage != parts[index - 1].stage:
                try:
                    tasks = problem.follow(plans, stored.replans)
                except ChainBroken as error:
                    words = f"does not follow from the parts before: {error}"
                    yield Claim(part.name, Outcome.FAILS, words, "grounding")
                    return
            if index >= len(tasks) or tasks[index].name != part.name:
                here = tasks[index].name if index < len(tasks) else "nothing"
                words = f"{part.name} stands where the chain has {here}"
                yield Claim(part.name, Outcome.FAILS, words, "grounding")
                return
            for claim in self._task_claims(part, tasks[index]):
                yield replace(claim, claim=f"{part.name}: {claim.claim}")
            plans[part.name] = tuple(part.skills)
        yield from self._sum_claims(stored.sequences or [])

    def _task_claims(self, stored: StoredResult | StoredPart, task: Task) -> Iterator[Claim]:
        if self.stop.interrupted:
            words = "interrupted"
            yield Claim("plan", Outcome.NOT_CHECKED, words, "replay")
            return
        self.stop.renew()
        self.stop.decimals = task.metric.decimals
        model = make_model(task, self.setup, self.cache, self.stop.overdue)
        with closing(model.feasibility):
            yield from checked_claims(stored, model, self.stop)

    def _sum_claims(self, main: list[StoredPart]) -> Iterator[Claim]:
        """Yield what is claimed of the whole: the sum, and what is proved of it."""
        stored = self.stored
        costs = [part.cost for part in main if part.cost is not None]
        if stored.cost is not None:
            total = sum(costs)
            holds = len(costs) == len(main) and abs(total - stored.cost) <= tolerance(total)
            outcome = Outcome.HOLDS if holds else Outcome.FAILS
            words = f"the parts cost {total:.10g}, claimed {stored.cost:.10g}"
            yield Claim("cost", outcome, words, ARITHMETIC)
        yield from calculated_claims(stored)
        bounds = [part.lower_bound for part in main if part.lower_bound is not None]
        if stored.lower_bound is None:
            return
        added = sum(bounds)
        whole = len(bounds) == len(main) and not stored.stages
        if whole and stored.lower_bound <= added + tolerance(added):
            words = f"those of the parts add up to {added:.10g}"
            yield Claim("lower bound", Outcome.HOLDS, words, ARITHMETIC)
        else:
            words = "is about all plans of the stages together; only the parts are proved again"
            yield Claim("lower bound", Outcome.NOT_CHECKED, words, ARITHMETIC)
