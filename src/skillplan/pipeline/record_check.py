"""The figures and files of a stored result, compared with figures derived from its plans.

Everything is derived again from the plans, except what only the search knew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from skillplan.domains.domain import Account
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, OptionError, PluginError, SearchStopped, format_path
from skillplan.files.regular_file import read_bytes
from skillplan.judge.claim_check import ARITHMETIC, explain_stop
from skillplan.model.policy_value import PolicyValue, roll_out
from skillplan.model.replay import Replay
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.chain import Chain, policy_key
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import SearchRequest
from skillplan.records.certificate import Claim, Outcome
from skillplan.records.chain_result import ChainPart, ChainResult
from skillplan.records.result import Origin, Result, Status
from skillplan.records.stored.policy_file import fingerprint, read_policies
from skillplan.records.stored.result_file import StoredClaims, StoredPart, StoredResult
from skillplan.records.stored.result_folder import (
    POLICIES,
    RESULT,
    find_file_beside,
    find_result_path,
)
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import VerdictStatus

UNCHECKED = {
    "solver": "who searched leaves no trace in a plan; of a chain, who took which stage is checked",
    "seed": "of the search; the parts of a chain must have the same one",
    "bound_method": "what proved the bound; the bound itself is proved again where it can be",
    "reason": "words, where the status is not optimal; those of a chain are checked",
    "stats": "wall time and counters of the search; of a chain their sums are checked",
    "trace": "figures of the search",
    "origin": "which file, changes and options were given: they are used, and what was queried is "
    "listed; the task must have the hash that the result names",
}
"""Reasons why figures cannot be derived from a plan, by key."""
UNDER_CHANCE = "steps and time are those of the nominal outcomes; expected time is not worked out"


@dataclass(frozen=True, slots=True)
class Replayed:
    """A task of a result, with its claims and its replayed plan.

    Parameters
    ----------
    task
        The task, grounded as it was when it was solved.
    stored
        Claims of the result.
    walked
        The replayed plan; None without a plan.
    expected
        Under chance, the value of the stored policy; None without one.
    not_checked
        Sentences of the back ends about unchecked properties of the task.
    """

    task: Task
    stored: StoredClaims
    walked: Replay | None
    expected: PolicyValue | None = None
    not_checked: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """True if the plan leads to the goal at the claimed cost, or no plan is claimed."""
        planned = self.stored.cost is not None
        return planned == (self.walked is not None and self.walked.complete)


def derive_result(replayed: Replayed, setup: Setup, solver: str, origin: Origin | None) -> Result:
    """Return the result of one task, derived from its plan.

    Parameters
    ----------
    replayed
        The task, with a sound plan.
    setup
        Back ends that were queried.
    solver
        Name of the solver.
    origin
        Task file and how it was read; None for a part of a chain.

    Raises
    ------
    ValueError
        If the claims contradict each other.
    """
    task, stored, walked = replayed.task, replayed.stored, replayed.walked
    cost, makespan_s = stored.cost, stored.makespan_s
    if walked is not None and task.deterministic:
        cost, makespan_s = walked.cost, walked.duration_s
    elif replayed.expected is not None and replayed.expected.cost is not None:
        cost, makespan_s = replayed.expected.cost, replayed.expected.duration_s
    bound = stored.lower_bound
    if cost is not None and bound is not None:
        # Rounding may put the bound above the cost.
        bound = cost if 0 < bound - cost <= 1e-9 * max(1.0, cost) else bound
    return Result(
        task=task.name,
        kind=task.kind,
        sha256=task.sha256,
        solver=solver,
        seed=stored.seed,
        physics=setup.physics_choice(task).name,
        collision=setup.detector_names(task),
        status=stored.status,
        cost=cost,
        cost_unit=task.metric.unit,
        timed_by=setup.timed_by(task),
        lower_bound=bound,
        bound_method=stored.bound_method,
        steps=() if walked is None else walked.steps,
        makespan_s=makespan_s,
        reason="" if stored.status is Status.OPTIMAL else stored.reason,
        states=stored.stats.states,
        expanded=stored.stats.expanded,
        checks=stored.stats.checks,
        cache_hits=stored.stats.cache_hits,
        trajectories=stored.stats.trajectories,
        wall_s=stored.stats.wall_s,
        trace=stored.trace,
        origin=origin,
        not_checked=replayed.not_checked,
        dwells_from=task.dwells_from,
    )


def derive_chain(
    problem: Problem,
    stored: StoredResult,
    replayed: Sequence[Replayed],
    setup: Setup,
    origin: Origin | None,
) -> ChainResult:
    """Return the result of a chain, derived from its plans.

    Parameters
    ----------
    problem
        The loaded task file.
    stored
        Claims of the result.
    replayed
        The parts, with sound plans.
    setup
        Back ends that were queried.
    origin
        Task file and how it was read.

    Raises
    ------
    ValueError
        If the claims contradict each other.
    """
    solvers = _solvers(problem, stored, setup)
    parts = []
    kept_policies = set()
    for part in replayed:
        claims = part.stored
        assert isinstance(claims, StoredPart)
        solver = solvers(part.task) if solvers is not None else claims.solver
        claims = claims.model_copy(update={"seed": stored.seed})
        result = derive_result(replace(part, stored=claims), setup, solver, None)
        optimum = _optimum(claims, result)
        key = policy_key(part.task)
        # A policy can only be reused after an earlier task with the same goal and skills.
        reused = claims.reused_policy and key in kept_policies
        kept_policies.add(key)
        parts.append(ChainPart(part.task, result, optimum, reused))
    plans = {
        part.task.name: tuple(part.stored.skills) for part in replayed if part.walked is not None
    }
    tasks = problem.follow({}, stored.replans) if stored.replans else problem.tasks
    broken = ""
    account: Any
    try:
        if len(plans) == len(replayed):
            tasks = problem.follow(plans, stored.replans)
        account = problem.account(plans, stored.replans)
    except ChainBroken as error:
        broken, account = str(error), Account()
    return ChainResult(
        problem.name,
        problem.kind,
        problem.sha256,
        stored.solver,
        stored.seed,
        tuple(parts),
        max(len(tasks), len(parts)),
        account,
        stored.replans,
        broken,
        origin,
    )


def _solvers(problem: Problem, stored: StoredResult, setup: Setup) -> Any:
    """Return a function from a task of a chain to its solver; None if that is unknown."""
    try:
        request = SearchRequest(problem.tasks[0], stored.solver, setup, stored.seed)
        chain = Chain(problem, request, spare=[])
    except (PluginError, OptionError):
        return None

    def solver_of(task: Task) -> str:
        by_rule = chain.rule_solution(task) is not None
        return "rule" if by_rule else chain.solvers[task.stage]

    return solver_of


def _optimum(claims: StoredPart, result: Result) -> float | None:
    """Return the optimum of a part, which is its cost or has given its bound."""
    if result.status is Status.OPTIMAL:
        return result.cost
    if claims.optimum is None or result.cost is None or result.lower_bound is None:
        return None
    # Only rounding puts the proved optimum above the cost of a plan.
    close = abs(claims.optimum - result.lower_bound) <= 1e-9 * max(1.0, abs(claims.optimum))
    return claims.optimum if close else result.lower_bound


# Tolerances of figures, and of times [s], which engines round differently.
_ROUNDING = 1e-9
_SAME_TIME_S = 1e-6
_MOST_CHARACTERS = 80
_Path = tuple[str | int, ...]


def list_differences(claimed: Any, derived: Any, path: _Path = ()) -> Iterator[str]:
    """Yield a message for each leaf by which a document differs from the derived one.

    Parameters
    ----------
    claimed, derived
        The document and the derived one, as JSON values.
    path
        Place of both in the whole document.
    """
    if isinstance(claimed, Mapping) and isinstance(derived, Mapping):
        for key, value in derived.items():
            if key in claimed:
                yield from list_differences(claimed[key], value, (*path, key))
            else:
                yield f"{format_path((*path, key))} is missing"
        for key in claimed:
            if key not in derived:
                yield f"{format_path((*path, key))} does not belong there"
    elif isinstance(claimed, list) and isinstance(derived, list | tuple):
        for index, (claimed_item, other) in enumerate(zip(claimed, derived, strict=False)):
            yield from list_differences(claimed_item, other, (*path, index))
        if len(claimed) != len(derived):
            yield f"{format_path(path)} has {len(claimed)} entries, not {len(derived)}"
    elif not _is_same(claimed, derived, path):
        yield f"{format_path(path)} is {_shorten(derived)}, claimed {_shorten(claimed)}"


def count_leaves(value: Any) -> int:
    """Return the number of values of a document that contain no others."""
    if isinstance(value, Mapping):
        return sum(map(count_leaves, value.values()))
    if isinstance(value, list | tuple):
        return sum(map(count_leaves, value))
    return 1


def _is_same(claimed: Any, derived: Any, path: _Path) -> bool:
    numbers = all(
        isinstance(value, int | float) and not isinstance(value, bool)
        for value in (claimed, derived)
    )
    if numbers:
        timed = bool(path) and str(path[-1]).endswith("_s")
        allowed = _ROUNDING * max(1.0, abs(derived))
        return bool(abs(claimed - derived) <= (max(_SAME_TIME_S, allowed) if timed else allowed))
    return type(claimed) is type(derived) and bool(claimed == derived)


def _shorten(value: Any) -> str:
    text = f"{value:.10g}" if isinstance(value, float) else repr(value)
    return text if len(text) <= _MOST_CHARACTERS else f"{text[:_MOST_CHARACTERS]}..."


def find_policy_fault(
    document: Mapping[str, Any],
    header: Mapping[str, str],
    replayed: Mapping[str, Replayed],
    model_of: Callable[[Task], SkillModel],
    stop: Stop,
) -> str:
    """Return a message about the first fault of some policies; empty without one.

    A policy must be for a task of the result, follow its plan, and choose in each state a skill
    that can be executed there. Choices off the plan need not be good.

    Parameters
    ----------
    document
        A document ``skillplan.policy/1``.
    header
        Expected header of the document.
    replayed
        The tasks of the result, by name.
    model_of
        Returns a fresh model of a task.
    stop
        Polled between states.

    Raises
    ------
    BackEndError
        If a back end fails.
    TimeoutError
        If the stop ends the check of the choices and no fault was found before.
    """
    own = {key: value for key, value in document.items() if key not in ("schema", "policies")}
    for words in list_differences(own, dict(header)):
        return words
    holders = [entry.get("task", "") for entry in document["policies"]]
    for name in holders:
        if holders.count(name) > 1:
            return f"holds {holders.count(name)} policies of {name!r}"
    for name, part in replayed.items():
        needed = part.stored.policy or (part.walked is not None and not part.task.deterministic)
        if needed and name not in holders:
            return f"holds no policy of {name!r}"
        if part.stored.policy is False and name in holders:
            return f"holds a policy of {name!r}, and the result names none"
    for entry in document["policies"]:
        replayed_task = replayed.get(entry.get("task", ""))
        if replayed_task is None:
            return f"holds a policy of {entry.get('task')!r}, which is no task of the result"
        expected = {
            "task": replayed_task.task.name,
            "fingerprint": fingerprint(replayed_task.task),
            "goal": list(replayed_task.task.goal.requires),
        }
        claimed = {key: value for key, value in entry.items() if key != "choices"}
        fault = next(iter(list_differences(claimed, expected)), "")
        fault = fault or _find_choice_fault(
            entry["choices"], replayed_task, model_of(replayed_task.task), stop
        )
        if fault:
            return f"{replayed_task.task.name}: {fault}"
    return ""


def _find_choice_fault(
    choices: Mapping[str, str], replayed: Replayed, model: SkillModel, stop: Stop
) -> str:
    task = replayed.task
    by_name = {skill.name: skill for skill in task.skills}
    cheap = not any(back_end.expensive for back_end in model.feasibility.back_ends)
    policy: dict[State, Skill] = {}
    given_up = False
    for names, name in choices.items():
        if name not in by_name:
            return f"{name!r} in [{names}] is no skill of the task"
        try:
            state = task.facts.of(*filter(None, names.split(", ")))
        except OptionError as error:
            return f"[{names}] is no state: {error}"
        skill = by_name[name]
        policy[state] = skill
        if not skill.applicable(state):
            return f"{name} is not applicable in [{names}]"
        given_up = given_up or (cheap and stop())
        if (
            cheap
            and not given_up
            and model.verdict(state, skill).status is VerdictStatus.INFEASIBLE
        ):
            return f"{name} is infeasible in [{names}]"
    taken = [skill.name for skill in roll_out(model, policy.get)]
    if replayed.stored.cost is not None and taken != replayed.stored.skills:
        at = next(
            (
                index
                for index, (taken_name, other) in enumerate(
                    zip(taken, replayed.stored.skills, strict=False)
                )
                if taken_name != other
            ),
            min(len(taken), len(replayed.stored.skills)),
        )
        return f"it leaves the plan at step {at + 1}"
    if given_up:
        raise TimeoutError
    return ""


_MOST_FAULTS = 5
_LATER_KEYS = (
    *("proved_by", "simulation", "not_checked", "policy", "dwells_from"),
    *("reachable", "relax", "sampling"),
)
MISSING = "is missing beside the result"
_MOST_BYTES = 64 * 1024 * 1024

SavedTables = Callable[[Result | ChainResult, Task], Mapping[str, str]]
"""Returns the expected tables of a result folder, by file name."""


class RecordCheck:
    """Checks the figures and files of a result after its plans were replayed.

    Parameters
    ----------
    path
        Path of the result.
    stored
        Content of the result.
    problem
        The loaded task file.
    setup
        Back ends and options of the result.
    model
        Returns a model of a task, to check the choices of policies.
    stop
        Limits of the check.
    """

    def __init__(
        self,
        path: str,
        stored: StoredResult,
        problem: Problem,
        setup: Setup,
        model: Callable[[Task], SkillModel],
        stop: Stop,
    ) -> None:
        self._path = path
        self._stored = stored
        self._problem = problem
        self._setup = setup
        self._model = model
        self._stop = stop

    def claims(
        self, document: Mapping[str, Any], replayed: Mapping[str, Replayed], tables: SavedTables
    ) -> Iterator[Claim]:
        """Yield a claim for the document, and one for each file in its folder.

        Parameters
        ----------
        document
            The result as JSON values.
        replayed
            Its tasks with their plans, by name.
        tables
            Returns the expected tables of the result folder.
        """
        if self._stop.interrupted:
            yield Claim("record", Outcome.NOT_CHECKED, "interrupted", ARITHMETIC, open=False)
            return
        expected = len([*self._stored.stages, *(self._stored.sequences or ())]) or 1
        parts = list(replayed.values())
        if len(parts) < expected or not all(part.sound for part in parts):
            words = "follows from the plans, and those do not hold"
            yield Claim("record", Outcome.NOT_CHECKED, words, ARITHMETIC, open=False)
            return
        origin = None if self._stored.origin is None else self._stored.origin.origin()
        try:
            derived = self._derive(parts, origin)
        except ValueError as error:
            yield Claim("record", Outcome.FAILS, f"does not go together: {error}", ARITHMETIC)
            return
        should = derived.document()
        should.pop("schema")
        if origin is None and "origin" not in document:
            should.pop("origin")
        _fit_to_version(should, document)
        amiss = list(list_differences(document, should))
        words = "; ".join(amiss[:_MOST_FAULTS])
        words += f"; and {len(amiss) - _MOST_FAULTS} more" if len(amiss) > _MOST_FAULTS else ""
        outcome = Outcome.FAILS if amiss else Outcome.HOLDS
        yield Claim("record", outcome, words or f"{count_leaves(should)} entries", ARITHMETIC)
        yield from self._table_claims(tables(derived, parts[-1].task))
        yield from self._policy_claims(replayed)

    def _derive(self, replayed: list[Replayed], origin: Origin | None) -> Result | ChainResult:
        if self._stored.is_chain:
            return derive_chain(self._problem, self._stored, replayed, self._setup, origin)
        return derive_result(replayed[0], self._setup, self._stored.solver, origin)

    def _table_claims(self, tables: Mapping[str, str]) -> Iterator[Claim]:
        for name, text in tables.items():
            path = find_file_beside(self._path, name)
            if path is None:
                if find_result_path(self._path).name == RESULT:
                    yield Claim(name, Outcome.NOT_CHECKED, MISSING, ARITHMETIC)
                continue
            try:
                text_found = read_bytes(path, _MOST_BYTES, within=path.parent).decode("utf-8")
            except (OSError, UnicodeDecodeError) as error:
                words = f"cannot be read: {getattr(error, 'strerror', None) or 'it is no text'}"
                yield Claim(name, Outcome.FAILS, words, ARITHMETIC)
                continue
            fault = _find_line_fault(text_found.splitlines(), text.splitlines())
            outcome = Outcome.FAILS if fault else Outcome.HOLDS
            yield Claim(name, outcome, fault or "as the result says", ARITHMETIC)

    def _missing_policies(self, replayed: Mapping[str, Replayed]) -> Iterator[Claim]:
        """Yield the claim of missing policies, which are essential if outcomes are uncertain."""
        planned = [part for part in replayed.values() if part.walked is not None]
        if not all(part.task.deterministic for part in planned):
            words = f"{MISSING}: the plan shows nominal outcomes, the policy decides on the others"
            yield Claim(POLICIES, Outcome.NOT_CHECKED, words, ARITHMETIC, open=False)
        elif self._stored.policy:
            yield Claim(POLICIES, Outcome.NOT_CHECKED, MISSING, ARITHMETIC)

    def _policy_claims(self, replayed: Mapping[str, Replayed]) -> Iterator[Claim]:
        path = find_file_beside(self._path, POLICIES)
        if path is None:
            yield from self._missing_policies(replayed)
            return
        header = {"sha256": self._problem.sha256, "solver": self._stored.solver}
        try:
            fault = find_policy_fault(
                read_policies(str(path), within=str(path.parent)),
                header,
                replayed,
                self._model,
                self._stop,
            )
        except OptionError as error:
            fault = str(error)
        except (SearchStopped, TimeoutError):
            words = explain_stop(self._stop)
            yield Claim(POLICIES, Outcome.NOT_CHECKED, words, ARITHMETIC)
            return
        outcome = Outcome.FAILS if fault else Outcome.HOLDS
        words = fault or "take the way of the plan; all choices can be executed"
        yield Claim(POLICIES, outcome, words, ARITHMETIC)


def _fit_to_version(should: dict[str, Any], document: Mapping[str, Any]) -> None:
    """Remove keys that results of older versions lack, also from the parts of a chain.

    The policy of a task is compared with policies.json, not with the plan.
    """
    parts = [*(document.get("stages") or ()), *(document.get("sequences") or ())]
    claimed = [part.get("policy") is True for part in parts]
    should["policy"] = any(claimed) if parts else document.get("policy")
    for key in _LATER_KEYS:
        if key not in document:
            should.pop(key, None)
    for key in ("sequences", "stages"):
        for part, own in zip(should.get(key, ()), document.get(key) or (), strict=False):
            _fit_to_version(part, own)


def _find_line_fault(lines: list[str], should: list[str]) -> str:
    for number, (line, other) in enumerate(zip(lines, should, strict=False), start=1):
        if line != other:
            return f"line {number} is {other!r}, claimed {line!r}"
    if len(lines) != len(should):
        return f"has {len(lines)} lines, not {len(should)}"
    return ""
