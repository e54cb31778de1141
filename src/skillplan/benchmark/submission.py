"""Submissions: results of agents as a document, and their check by the referee."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from pydantic import Field

from skillplan import __version__
from skillplan.benchmark.agents import is_learner
from skillplan.benchmark.instances import PROOF_GAP, Instance, hash_instances
from skillplan.domains.domain import Strict
from skillplan.errors import OptionError, PluginError, SkillplanError
from skillplan.files.json_file import read_checked
from skillplan.judge.referee import judge
from skillplan.pipeline import registry
from skillplan.pipeline.solving import SearchRequest, describe, make_model
from skillplan.records import schemas
from skillplan.records.result import Result, Status
from skillplan.solvers.solution import Plan, Policy, Solution, relative_gap
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

# A run that ends at its time limit may take this much longer [s].
_OVERTIME_S = 5.0


class Row(Strict):
    """Result of an agent on an instance."""

    agent: str = Field(min_length=1, max_length=200, description="name of the agent")
    instance: str = Field(description="name of the instance")
    sha256: str = Field(description="hash of its task")
    seed: int = Field(default=0, ge=0, description="seed of all random numbers")
    status: Status = Field(strict=False, description="verdict of the referee, or claim")
    cost: float | None = Field(default=None, ge=0, description="cost, expected under chance")
    lower_bound: float | None = Field(default=None, description="claimed lower bound")
    wall_s: float = Field(ge=0, description="duration [s]")
    steps: int | None = Field(default=None, ge=0, description="environment steps of a learner")
    skills: list[str] | None = Field(default=None, description="skills of the plan, in order")
    policy: dict[str, str] | None = Field(
        default=None,
        description="under chance: skill for each state; a state is its facts, separated by ', '",
    )
    reason: str = Field(default="", description="reason for the status")

    @property
    def is_solved(self) -> bool:
        """Return whether there is a plan or policy."""
        return self.status in (Status.OPTIMAL, Status.SOLVED)

    @property
    def is_proved(self) -> bool:
        """Return whether cost and bound agree, or no plan is proved to exist."""
        if self.status is Status.INFEASIBLE:
            return True
        gap = relative_gap(self.cost, self.lower_bound)
        return gap is not None and gap <= PROOF_GAP

    @property
    def key(self) -> tuple[str, str, int]:
        """The run of the row: agent, instance and seed."""
        return self.agent, self.instance, self.seed

    @classmethod
    def of(cls, agent: str, instance: Instance, task: Task, result: Result) -> Row:
        """Return the row of a judged result."""
        policy = None
        if result.policy is not None and not task.deterministic:
            reached = _list_reached(result.policy, task)
            policy = {", ".join(state): skill.name for state, skill in reached.items()}
        is_solved = result.status in (Status.OPTIMAL, Status.SOLVED)
        steps = result.trace.get("steps")
        return cls(
            agent=agent,
            instance=instance.name,
            sha256=task.sha256,
            seed=result.seed,
            status=result.status,
            cost=result.cost,
            lower_bound=result.lower_bound,
            wall_s=round(result.wall_s, 4),
            steps=steps if isinstance(steps, int) else None,
            skills=[step.skill for step in result.steps] if is_solved else None,
            policy=policy,
            reason=result.reason,
        )


def _list_reached(policy: Mapping[State, Skill], task: Task) -> dict[State, Skill]:
    """Return the choices of a policy in the states that it can reach."""
    choices: dict[State, Skill] = {}
    waiting = [task.initial]
    while waiting:
        state = waiting.pop()
        skill = None if state in choices or task.goal.holds(state) else policy.get(state)
        if skill is not None:
            choices[state] = skill
            waiting += [outcome.apply(state) for outcome in skill.outcomes_in(state)]
    return choices


class Submission(Strict):
    """Results of agents on instances of the benchmark."""

    document: Literal["skillplan.benchmark/1"] = Field(
        default="skillplan.benchmark/1", alias="schema"
    )
    skillplan: str = Field(description="version of skillplan")
    benchmark: str = Field(description="hash of names, tasks and optima of the instances")
    machine: str = Field(description="processor, cores and system")
    jobs: int = Field(ge=1, description="number of processes at once")
    search_limit_s: float = Field(gt=0, description="time limit of a search [s]")
    learning_limit_s: float = Field(gt=0, description="time limit of a learner [s]")
    steps: int = Field(ge=1, description="environment steps of learners from elsewhere, at most")
    agents: dict[str, str] = Field(description="agents, each with its version or file hash")
    rows: list[Row] = Field(description="one for each agent, instance and seed")


@dataclass(frozen=True)
class Refusal:
    """A row that the referee refuses, and why."""

    row: Row
    reason: str


def read_submission(path: str) -> Submission:
    """Read a document ``skillplan.benchmark/1``.

    Raises
    ------
    OptionError
        If it cannot be read or is not such a document.
    """
    remedy = "skillplan benchmark --out writes such a file"
    content = read_checked(Path(path), schemas.BENCHMARK, Submission, remedy)
    (key, times), *_ = [*Counter(row.key for row in content.rows).most_common(1), ((), 0)]
    if times > 1:
        agent, instance, seed = key
        raise OptionError(f"{path}: {agent} on {instance} with seed {seed} stands twice.")
    return content


def check_rows(submission: Submission, instances: Mapping[str, Instance]) -> Iterator[Refusal]:
    """Yield the rows that are false: their plans are replayed and their costs added up again.

    Rows beyond the limits of the submission are false, too.

    Parameters
    ----------
    submission
        The submission.
    instances
        All instances by name.
    """
    by_instance: dict[str, list[Row]] = {}
    for row in submission.rows:
        by_instance.setdefault(row.instance, []).append(row)
    for name, own in by_instance.items():
        instance = instances.get(name)
        if instance is None:
            reason = "no such instance is installed"
            yield from (Refusal(row, reason) for row in own)
            continue
        task = instance.load()
        for row in own:
            reason = _find_excess(row, submission) or _find_fault(row, instance, task)
            if reason:
                yield Refusal(row, reason)


def find_limit_s(agent: str, submission: Submission) -> float:
    """Return the time limit of an agent [s]: the larger one if it is not installed."""
    try:
        is_learning = is_learner(agent)
    except PluginError:
        return max(submission.learning_limit_s, submission.search_limit_s)
    return submission.learning_limit_s if is_learning else submission.search_limit_s


def _find_excess(row: Row, submission: Submission) -> str:
    """Return the limit of the header that a row exceeds; empty if it keeps them."""
    if row.agent not in submission.agents:
        return "the header does not list its agent under agents"
    has_steps = row.agent not in registry.names("solver")
    if has_steps and row.steps is not None and row.steps > submission.steps:
        return f"it took {row.steps} environment steps, more than {submission.steps}"
    if row.wall_s <= _OVERTIME_S:
        return ""
    limit_s = find_limit_s(row.agent, submission)
    if row.wall_s > limit_s + _OVERTIME_S:
        return f"it took {row.wall_s:.4g} s, more than the limit of {limit_s:g} s"
    return ""


def list_header_notes(submission: Submission, instances: Mapping[str, Instance]) -> list[str]:
    """Return differences of a header from this installation, each of which ends no check."""
    notes = []
    if submission.skillplan != __version__:
        notes.append(f"written by skillplan {submission.skillplan}, checked by {__version__}")
    names = {row.instance for row in submission.rows}
    own = [instances[name] for name in names if name in instances]
    if len(own) == len(names) and submission.benchmark == hash_instances(own):
        return notes
    start = f"benchmark  {submission.benchmark[:12]} is not the hash of the {len(names)} instances"
    suites = dict.fromkeys(each.suite for each in instances.values())
    sets = {"all instances": list(instances.values())} | {
        f"the suite {suite}": [each for each in instances.values() if each.suite == suite]
        for suite in suites
    }
    fits = [title for title, some in sets.items() if hash_instances(some) == submission.benchmark]
    end = f"but of {fits[0]}" if fits else "and fits no suite here, so it cannot be checked"
    return [*notes, f"{start} of its rows, {end}"]


def _find_fault(row: Row, instance: Instance, task: Task) -> str:
    """Return the reason why a row is false; empty if it is sound."""
    if row.sha256 != task.sha256:
        return f"it is for another task, {row.sha256[:12]} instead of {task.sha256[:12]}"
    if row.status is Status.INFEASIBLE and instance.status == "optimal":
        return f"it claims that no plan exists; a plan costs {instance.optimum:.10g}"
    bound, optimum = row.lower_bound, instance.optimum
    slack = PROOF_GAP * max(1.0, optimum or 0.0)
    if bound is not None and optimum is not None and bound > optimum + slack:
        return f"it claims the bound {bound:.10g}, above the optimum {optimum:.10g}"
    if not row.is_solved:
        return "" if row.cost is None else f"a row {row.status} has no cost"
    if row.status is Status.OPTIMAL and not row.is_proved:
        return "it claims a proof, but its bound leaves a gap"
    if row.cost is None:
        return f"a row {row.status} needs a cost"
    result = _judge(row, instance, task)
    if result.cost is None:
        return result.reason
    if abs(result.cost - row.cost) > 1e-6 * max(1.0, result.cost):
        return f"it claims the cost {row.cost:.10g}, but it costs {result.cost:.10g}"
    if optimum is not None and result.cost < optimum - slack:
        proofs = instance.proof_text
        return f"it costs {result.cost:.10g}, below the optimum {optimum:.10g} ({proofs})"
    return ""


def _judge(row: Row, instance: Instance, task: Task) -> Result:
    """Return the plan or policy of a row, executed on the task."""
    request = SearchRequest(task, row.agent, instance.setup, row.seed)
    ungraded = describe(request)
    try:
        if task.deterministic:
            answer: Plan | Policy = Plan(tuple(row.skills or ()))
        else:
            answer = Policy(
                {
                    task.facts.of(*filter(None, state.split(", "))): task.skill(skill)
                    for state, skill in (row.policy or {}).items()
                }
            )
    except SkillplanError as error:
        return replace(ungraded, reason=f"it is not for this task: {error}")
    model = make_model(task, instance.setup)
    with closing(model.feasibility):
        return judge(ungraded, Solution(answer), model, unknown_met=False, audit=False)
