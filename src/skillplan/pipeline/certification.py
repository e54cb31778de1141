"""A stored result, verified: its task is loaded again and every claim is checked on its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from skillplan.checks.verdict_cache import AskingCache, VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, OptionError, SearchStopped
from skillplan.files.regular_file import read_bytes
from skillplan.judge.claim_check import (
    ARITHMETIC,
    REPLAY,
    calculated_claims,
    checked_claims,
    stopped_words,
    walked_plan,
)
from skillplan.judge.document_check import differences, leaves
from skillplan.model.policy_value import PolicyValue, evaluate_policy
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.derivation import (
    UNCHECKED,
    UNDER_CHANCE,
    Replayed,
    derived_chain,
    derived_result,
)
from skillplan.pipeline.policy_check import policies_fault
from skillplan.pipeline.result_origin import found_origin, origin_problem
from skillplan.pipeline.run import make_model
from skillplan.pipeline.setup import Setup
from skillplan.records.certificate import Asked, Certificate, Claim, Outcome
from skillplan.records.chain_result import ChainResult
from skillplan.records.origin import Origin
from skillplan.records.result import Result, Status, tolerance
from skillplan.records.stored.policy_file import read_policies, read_policy
from skillplan.records.stored.result_file import (
    StoredPart,
    StoredResult,
    read_with_document,
)
from skillplan.records.stored.result_folder import POLICIES, RESULT, result_path
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task

MOST_REPLANS = 100
"""No solver plans the upper levels of a chain again more often, and every time costs more."""
_MOST_SHOWN = 5
_MOST_BYTES = 64 * 1024 * 1024

SavedTables = Callable[[Result | ChainResult, Task], Mapping[str, str]]
"""Returns the text of the tables that lie beside a result, by the name of the file."""


def certify(
    path: str,
    task_file: str | None = None,
    *,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
    saved_tables: SavedTables = lambda result, task: {},
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
        Kept verdicts to use; by default none, so that back ends are asked about everything.
    saved_tables
        What the tables beside the result should hold.

    Raises
    ------
    OptionError
        If the file is no result, claims nothing, is of another task, or demands too much.
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
    origin = found_origin(path, stored, task_file)
    problem, difference = origin_problem(path, stored, origin, named=task_file is not None)
    if difference is not None:
        raise OptionError(f"{path}: cannot be verified: {difference}. Name its own by --task.")
    if stored.is_chain and origin.part is not None:
        raise OptionError(f"{path}: is damaged: it is of the whole chain and of {origin.part!r}.")
    check = _Check(path, stored, problem, origin, Stop() if stop is None else stop, cache)
    claims = list(check.chain() if stored.is_chain else check.single())
    claims += check.record_claims(document, saved_tables)
    unchecked = dict(UNCHECKED)
    if not all(one.task.deterministic for one in check.replayed.values()):
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
    )


class _Check:
    """What checking the tasks of one result shares.

    Attributes
    ----------
    replayed
        The tasks so far, by name.
    asked
        The back ends that were queried, by what distinguishes them.
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
        self.setup = Setup(origin.physics, origin.collision, origin.options)
        self.stop = stop
        self.warm = cache is not None
        self.cache = VerdictCache() if cache is None else cache
        self.replayed: dict[str, Replayed] = {}
        self.asked: dict[str, Asked] = {}

    def single(self) -> Iterator[Claim]:
        """Yield the claims of the only task."""
        task = self.problem.part(self.origin.part)
        if self._replay(self.stored, task):
            yield from self._task_claims(self.stored, task)
        else:
            yield self._given_up("plan")

    def chain(self) -> Iterator[Claim]:
        """Yield the claims of every task of a chain, grounded as it was when that was solved.

        All plans are replayed before anything is proved, which may take the time that there is.
        """
        grounded: list[tuple[StoredPart, Task]] = []
        amiss = self._replay_chain(grounded)
        for part, task in grounded:
            for claim in self._task_claims(part, task):
                yield replace(claim, claim=f"{part.name}: {claim.claim}")
        if amiss is not None:
            yield amiss
        elif all(one.sound for one in self.replayed.values()):
            yield from self._sum_claims(self.stored.sequences or [])

    def _replay_chain(self, grounded: list[tuple[StoredPart, Task]]) -> Claim | None:
        """Replay part after part, as far as that goes; return why it does not go to the end."""
        stored, problem = self.stored, self.problem
        parts = [*stored.stages, *(stored.sequences or ())]
        tasks = problem.follow({}, stored.replans) if stored.replans else problem.tasks
        plans: dict[str, tuple[str, ...]] = {}
        for index, part in enumerate(parts):
            if index and part.stage != parts[index - 1].stage:
                if self.stop.overdue():
                    return self._given_up(part.name)
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
                return self._given_up(f"{part.name}: plan")
            grounded.append((part, tasks[index]))
            one = self.replayed[part.name]
            if not one.sound:
                # Nothing can be grounded on a plan that does not hold.
                return None
            if one.walked is not None:
                plans[part.name] = tuple(step.skill for step in one.walked.steps)
        return None

    def _given_up(self, claim: str) -> Claim:
        words = "interrupted" if self.stop.interrupted else stopped_words(self.stop)
        return Claim(claim, Outcome.NOT_CHECKED, words, REPLAY, open=False)

    def _model(self, task: Task, cache: VerdictCache) -> SkillModel:
        model = make_model(task, self.setup, cache, self.stop.overdue)
        for back_end in model.feasibility.back_ends:
            options = back_end.options.model_dump(mode="json")
            one = Asked(back_end.name, back_end.version, options)
            self.asked.setdefault(repr(one), one)
        return model

    def _replay(self, stored: StoredResult | StoredPart, task: Task) -> bool:
        """Replay a plan; return whether there was time for it."""
        if self.stop.interrupted:
            return False
        # A verdict of one state does not answer for another where the plan is replayed.
        fresh = self.cache if self.warm else AskingCache(self.cache)
        try:
            model = self._model(task, fresh)
            with closing(model.feasibility):
                walked = walked_plan(stored, model)
                expected = self._expected(task, model)
        except SearchStopped:
            return False
        self.replayed[task.name] = Replayed(task, stored, walked, expected)
        return True

    def _task_claims(self, stored: StoredResult | StoredPart, task: Task) -> Iterator[Claim]:
        self.stop.renew()
        self.stop.decimals = task.metric.decimals
        one = self.replayed[task.name]
        model = self._model(task, self.cache)
        with closing(model.feasibility):
            yield from checked_claims(stored, one.walked, model, self.stop, one.expected)

    def _expected(self, task: Task, model: SkillModel) -> PolicyValue | None:
        """Return what the policy beside the result is worth, of a task with chance."""
        path = self._beside(POLICIES)
        if task.deterministic or path is None:
            return None
        try:
            return evaluate_policy(
                model, read_policy(str(path), task, within=str(path.parent)).policy.get
            )
        except OptionError:
            # Said where the file itself is checked.
            return None

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

    def record_claims(self, document: Mapping[str, Any], tables: SavedTables) -> Iterator[Claim]:
        """Yield whether every figure of the document, and of the files beside, is as it should be.

        Parameters
        ----------
        document
            The result, as it was read.
        tables
            Returns what the tables beside it should hold.
        """
        if self.stop.interrupted:
            yield Claim("record", Outcome.NOT_CHECKED, "interrupted", ARITHMETIC)
            return
        expected = len([*self.stored.stages, *(self.stored.sequences or ())]) or 1
        replayed = list(self.replayed.values())
        if len(replayed) < expected or not all(one.sound for one in replayed):
            words = "follows from the plans, and those do not hold"
            yield Claim("record", Outcome.NOT_CHECKED, words, ARITHMETIC)
            return
        origin = None if self.stored.origin is None else self.stored.origin.origin()
        try:
            derived = self._derived(replayed, origin)
        except ValueError as error:
            yield Claim("record", Outcome.FAILS, f"does not go together: {error}", ARITHMETIC)
            return
        should = derived.document()
        should.pop("schema")
        if origin is None and "origin" not in document:
            should.pop("origin")
        amiss = list(differences(document, should))
        words = "; ".join(amiss[:_MOST_SHOWN])
        words += f"; and {len(amiss) - _MOST_SHOWN} more" if len(amiss) > _MOST_SHOWN else ""
        outcome = Outcome.FAILS if amiss else Outcome.HOLDS
        yield Claim("record", outcome, words or f"{leaves(should)} entries", ARITHMETIC)
        yield from self._table_claims(tables(derived, replayed[-1].task))
        yield from self._policy_claims()

    def _derived(self, replayed: list[Replayed], origin: Origin | None) -> Result | ChainResult:
        if self.stored.is_chain:
            return derived_chain(self.problem, self.stored, replayed, self.setup, origin)
        return derived_result(replayed[0], self.setup, self.stored.solver, origin)

    def _beside(self, name: str) -> Path | None:
        """Return a file beside the result; None where there is none, or it is in no folder."""
        result = result_path(self.path)
        path = result.parent / name
        there = path.exists() or path.is_symlink()
        return path if result.name == RESULT and there else None

    def _table_claims(self, tables: Mapping[str, str]) -> Iterator[Claim]:
        for name, text in tables.items():
            path = self._beside(name)
            if path is None:
                continue
            try:
                found = read_bytes(path, _MOST_BYTES, within=path.parent).decode("utf-8")
            except (OSError, UnicodeDecodeError) as error:
                words = f"cannot be read: {getattr(error, 'strerror', None) or 'it is no text'}"
                yield Claim(name, Outcome.FAILS, words, ARITHMETIC)
                continue
            fault = _line_fault(found.splitlines(), text.splitlines())
            outcome = Outcome.FAILS if fault else Outcome.HOLDS
            yield Claim(name, outcome, fault or "as the result says", ARITHMETIC)

    def _policy_claims(self) -> Iterator[Claim]:
        path = self._beside(POLICIES)
        if path is None:
            return
        header = {"sha256": self.problem.sha256, "solver": self.stored.solver}
        try:
            fault = policies_fault(
                read_policies(str(path), within=str(path.parent)),
                header,
                self.replayed,
                lambda task: self._model(task, self.cache),
                self.stop,
            )
        except OptionError as error:
            fault = str(error)
        except (SearchStopped, TimeoutError):
            words = stopped_words(self.stop)
            yield Claim(POLICIES, Outcome.NOT_CHECKED, words, ARITHMETIC)
            return
        outcome = Outcome.FAILS if fault else Outcome.HOLDS
        words = fault or "take the way of the plan; all choices can be executed"
        yield Claim(POLICIES, outcome, words, ARITHMETIC)


def _line_fault(found: list[str], should: list[str]) -> str:
    for number, (one, other) in enumerate(zip(found, should, strict=False), start=1):
        if one != other:
            return f"line {number} is {other!r}, claimed {one!r}"
    if len(found) != len(should):
        return f"has {len(found)} lines, not {len(should)}"
    return ""
