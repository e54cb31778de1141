"""The lazy skill-transition model that all solvers use.

*Applicable* is symbolic and free. *Feasible* queries back ends, and only when a solver needs it; so
does a *cost* that is an execution time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skillplan.checks.feasibility import Feasibility
from skillplan.errors import SearchStopped
from skillplan.task.cost import WaitingCost, WeightedCost
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

if TYPE_CHECKING:
    from skillplan.checks.foresight import Likely

# Greatest number of states whose transitions are kept in memory.
_KEPT_STATES = 200_000


@dataclass(frozen=True, slots=True)
class Transition:
    """A transition of the model.

    Parameters
    ----------
    outcomes
        Pairs of probability and next state; one pair if the skill is deterministic.
    cost
        Cost in the task's metric, >= 0.
    wait_s
        Part of the duration in which the arm waits for a part [s], >= 0.
    """

    state: State
    skill: Skill
    outcomes: tuple[tuple[float, State], ...]
    cost: float
    duration_s: float
    wait_s: float = 0.0

    def __post_init__(self) -> None:
        outcomes = self.outcomes
        # Most have a single outcome, and searches make millions of transitions.
        total = outcomes[0][0] if len(outcomes) == 1 else sum(share for share, _ in outcomes)
        if abs(total - 1) > 1e-9:
            raise ValueError("Transition probabilities must sum to 1.")
        if not self.cost >= 0:
            raise ValueError(f"Transition cost must be >= 0, not {self.cost}.")

    @property
    def next_state(self) -> State:
        """The nominal next state."""
        return self.outcomes[0][1]


@dataclass(slots=True)
class ModelStats:
    """Counts of queries to a model.

    Parameters
    ----------
    states
        Number of expanded states.
    checks, cache_hits, unknown
        Numbers of checks, reused verdicts, and unknown verdicts.
    trajectories
        Number of execution times that back ends computed.
    left_open
        Skill, stage and reason of the first unknown verdict; or empty.
    """

    states: int = 0
    checks: int = 0
    cache_hits: int = 0
    unknown: int = 0
    trajectories: int = 0
    left_open: str = ""


class SkillModel:
    """A task and its feasibility, queried lazily.

    Parameters
    ----------
    feasibility
        The checks, with the task.
    overdue
        Returns True if the solver should have stopped long ago; then the model raises
        `SearchStopped`.

    Attributes
    ----------
    asks_costs
        True if costs are execution times of back ends, or depend on them; `least_cost` bounds them
        without a query.
    """

    def __init__(self, feasibility: Feasibility, overdue: Callable[[], bool] | None = None) -> None:
        self.feasibility = feasibility
        self.task: Task = feasibility.task
        self._overdue = overdue
        self._transitions: dict[State, tuple[Transition, ...]] = {}
        self._times = feasibility.times
        self._timed = bool(self._times.sources)
        self._waits = any(isinstance(s.duration_s, WaitingCost) for s in self.task.skills)
        self.asks_costs = self._timed and self.task.metric.depends_on_time
        self._unknown = 0
        self._left_open = ""
        self._expanded = 0
        self._masks = [
            (skill.precondition.requires.bits, skill.precondition.forbids.bits, skill)
            for skill in self.task.skills
        ]

    @property
    def initial(self) -> State:
        """The initial state of the task."""
        return self.task.initial

    @property
    def step_limit(self) -> int:
        """Greatest number of skills in a plan."""
        return self.task.step_limit

    @property
    def stats(self) -> ModelStats:
        """Counts of the queries so far."""
        return ModelStats(
            states=self._expanded,
            checks=self.feasibility.checks,
            cache_hits=self.feasibility.hits,
            unknown=self._unknown,
            trajectories=self._times.computed,
            left_open=self._left_open,
        )

    def is_goal(self, state: State) -> bool:
        """Return whether `state` satisfies the goal."""
        return self.task.goal.holds(state)

    def applicable(self, state: State) -> list[Skill]:
        """Return the skills that are applicable in `state`, in the order of the task."""
        bits = state.bits
        return [
            skill
            for requires, forbids, skill in self._masks
            if bits & requires == requires and not bits & forbids and skill.has_case(bits)
        ]

    def verdict(self, state: State, skill: Skill, likely: Likely | None = None) -> Verdict:
        """Return the verdict on `skill` in `state`; back ends check if it is unknown so far.

        Parameters
        ----------
        likely
            Starts to yield the queries that may follow, the most likely first. Idle workers check
            them ahead; verdicts and counts do not depend on it.

        Raises
        ------
        BackEndError
            If a back end fails.
        SearchStopped
            If the solver is overdue.
        """
        self._cut_off()
        verdict = self.feasibility.verdict(skill, state, self._cut_off, likely)
        self._count(skill, verdict)
        return verdict

    def expected(self, state: State, skill: Skill) -> bool | None:
        """Return whether a skill is feasible according to the checks so far, or None.

        Always None without workers.
        """
        foresight = self.feasibility.foresight
        return None if foresight is None else foresight.expected(skill, state)

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts on pairs of skill and state, in order; raises as `verdict`."""
        self._cut_off()
        verdicts = self.feasibility.verdicts(queries, self._cut_off)
        for (skill, _), verdict in zip(queries, verdicts, strict=True):
            self._count(skill, verdict)
        return verdicts

    def transition(self, state: State, skill: Skill, elapsed_s: float | None = None) -> Transition:
        """Return the predicted transition, feasible or not.

        Back ends are queried only for execution times, and for the variant of a skill that has
        several.

        Parameters
        ----------
        elapsed_s
            Time since the begin of the plan, from which the wait for an arriving part follows [s];
            None leaves the wait out, so that cost and duration are lower bounds.
        """
        duration_s = self.duration_s(state, skill)
        wait_s = 0.0 if elapsed_s is None else skill.compute_wait_s(elapsed_s)
        return Transition(
            state,
            skill,
            tuple(
                (outcome.probability, outcome.apply(state)) for outcome in skill.outcomes_in(state)
            ),
            self.price(skill, state, duration_s) + self.task.metric.cost_per_s * wait_s,
            duration_s + wait_s,
            wait_s + self._find_feeder_wait_s(state, skill, duration_s),
        )

    def _find_feeder_wait_s(self, state: State, skill: Skill, duration_s: float) -> float:
        """Return the part of a duration in which the arm waits for a feeder [s]."""
        waiting = skill.duration_s
        if not isinstance(waiting, WaitingCost):
            return 0.0
        if self._timed:
            return duration_s - self._compute_duration_s(state, skill)
        return duration_s - waiting.cost.at(state)

    def cost(self, state: State, skill: Skill) -> float:
        """Return the cost of `skill` in `state`; back ends may be queried.

        Raises
        ------
        ValueError
            If the state does not determine the cost.
        BackEndError
            If a back end fails.
        """
        if not self.asks_costs:
            return skill.cost.at(state)
        return self.price(skill, state, self.duration_s(state, skill))

    def price(self, skill: Skill, state: State, duration_s: float) -> float:
        """Return the cost of `skill` in `state` if its duration is known [s]."""
        if not self.asks_costs:
            return skill.cost.at(state)
        cost = skill.cost
        return cost.price(state, duration_s) if isinstance(cost, WeightedCost) else duration_s

    def least_cost(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on the cost of a skill, without computing an execution time.

        Parameters
        ----------
        true_bits, false_bits
            Bits of the facts that are known to hold, and not to hold.
        """
        if self.asks_costs:
            least_s = self._times.least_s(skill, true_bits, false_bits)
            if math.isfinite(least_s):
                cost = skill.cost
                if isinstance(cost, WeightedCost):
                    return cost.bound(true_bits, false_bits, least_s)
                return least_s
        return skill.cost.least(true_bits, false_bits)

    def duration_s(self, state: State, skill: Skill) -> float:
        """Return the duration of `skill` in `state` [s], from a back end or else from the task.

        For a skill with several motions, verdicts are queried to find the variant to execute. The
        task's figure is raised to the lower bound of a back end that cannot time the skill.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        if not self._timed:
            return skill.duration_s.at(state)
        waiting = skill.duration_s
        if isinstance(waiting, WaitingCost):
            duration_s = self._compute_duration_s(state, skill)
            last = waiting.find_last(state)
            if last is None:
                return duration_s
            return waiting.prolong(duration_s, self._find_time_since_s(state, last, skill))
        return self._compute_duration_s(state, skill)

    def _find_time_since_s(self, state: State, last: str, skill: Skill) -> float:
        """Return the time of the skill that led to `state` from the place that `skill` goes to."""
        done = self.task.skill(last)
        stands = skill.prediction.add.bits & done.prediction.delete.bits
        before = state.bits & ~done.prediction.add.bits | done.precondition.requires.bits | stands
        return self.duration_s(self.task.facts.state(before), done)

    def _compute_duration_s(self, state: State, skill: Skill) -> float:
        """Return the duration of `skill` in `state` without waiting for a feeder [s]."""
        said_s = self._times.duration_s(self.feasibility.taken(skill, state), state)
        figure = skill.duration_s
        if said_s is not None and not self._waits:
            return said_s
        figure_s = (figure.cost if isinstance(figure, WaitingCost) else figure).at(state)
        if said_s is not None:
            # A wait for a feeder assumes that no skill is faster than the task's figure.
            return max(said_s, figure_s)
        bits = state.bits
        least_s = self._times.least_s(skill, bits, self.task.facts.all_bits & ~bits)
        return max(figure_s, least_s) if math.isfinite(least_s) else figure_s

    def least_duration_s(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on the duration of a skill [s], with facts as in `least_cost`."""
        if self._timed:
            least_s = self._times.least_s(skill, true_bits, false_bits)
            if math.isfinite(least_s):
                return least_s
        return skill.duration_s.least(true_bits, false_bits)

    @property
    def times_skills(self) -> bool:
        """True if back ends compute the durations of skills."""
        return self._timed

    def transitions(self, state: State) -> tuple[Transition, ...]:
        """Return the transitions of all feasible skills in `state`.

        Skills with an unknown verdict are left out and counted in `stats.unknown`.

        Raises
        ------
        BackEndError
            If a back end fails.
        SearchStopped
            If the solver is overdue.
        """
        self._cut_off()
        transitions = self._transitions.get(state)
        if transitions is None:
            skills = self.applicable(state)
            verdicts = self.verdicts([(skill, state) for skill in skills])
            transitions = tuple(
                self.transition(state, skill)
                for skill, verdict in zip(skills, verdicts, strict=True)
                if verdict.is_feasible
            )
            if len(self._transitions) >= _KEPT_STATES:
                self._transitions.clear()
            self._transitions[state] = transitions
            self._expanded += 1
        return transitions

    def _count(self, skill: Skill, verdict: Verdict) -> None:
        if verdict.status is VerdictStatus.UNKNOWN:
            self._unknown += 1
            self._left_open = self._left_open or f"{skill.name}: {verdict.stage}: {verdict.reason}"

    def _cut_off(self) -> None:
        if self._overdue is not None and self._overdue():
            raise SearchStopped("The solver went on long after it should have stopped.")
