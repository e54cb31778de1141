"""The lazy skill-transition model: what every solver consumes.

*Applicable* is symbolic and free; *feasible* queries back ends, and only once a solver needs it.
So does a *cost* where it is the time that a back end tells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skillplan.checks.feasibility import Feasibility
from skillplan.errors import SearchStopped
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

if TYPE_CHECKING:
    from skillplan.checks.foresight import Likely

# Transitions are kept for solvers that come back to a state; beyond this, memory counts more.
_KEPT_STATES = 200_000


@dataclass(frozen=True, slots=True)
class Transition:
    """One arrow of the model.

    Parameters
    ----------
    state
        Where it starts.
    skill
        What is done.
    outcomes
        Pairs of probability and next state; one pair where the skill is deterministic.
    cost
        In the task's metric, >= 0.
    duration_s
        Time it takes [s].

    Raises
    ------
    ValueError
        If the probabilities do not sum to 1 or the cost is negative.
    """

    state: State
    skill: Skill
    outcomes: tuple[tuple[float, State], ...]
    cost: float
    duration_s: float

    def __post_init__(self) -> None:
        outcomes = self.outcomes
        # Most have one only, and searches make millions of transitions.
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
    """What was queried of a model.

    Parameters
    ----------
    states
        Expanded.
    checks, cache_hits, unknown
        Checks made, verdicts reused, and verdicts that were unknown.
    trajectories
        Times of skills that back ends told.
    left_open
        Of the first verdict that was unknown the skill, the stage and the reason; or empty.
    """

    states: int = 0
    checks: int = 0
    cache_hits: int = 0
    unknown: int = 0
    trajectories: int = 0
    left_open: str = ""


class SkillModel:
    """Task plus feasibility, queried lazily.

    Parameters
    ----------
    feasibility
        The chain of checks; its task is the model's.
    overdue
        Returns True once a solver should have stopped long ago; then the model raises
        `SearchStopped` in it.

    Attributes
    ----------
    asks_costs
        Whether a back end is asked for costs: then `least_cost` bounds them without asking.
    """

    def __init__(self, feasibility: Feasibility, overdue: Callable[[], bool] | None = None) -> None:
        self.feasibility = feasibility
        self.task: Task = feasibility.task
        self._overdue = overdue
        self._transitions: dict[State, tuple[Transition, ...]] = {}
        self._times = feasibility.times
        self._timed = bool(self._times.sources)
        self.asks_costs = self._timed and self.task.metric.is_duration
        self._unknown = 0
        self._left_open = ""
        self._expanded = 0
        self._masks = [
            (skill.precondition.requires.bits, skill.precondition.forbids.bits, skill)
            for skill in self.task.skills
        ]

    @property
    def initial(self) -> State:
        """The state in which the task starts."""
        return self.task.initial

    @property
    def step_limit(self) -> int:
        """The most skills that a plan may have."""
        return self.task.step_limit

    @property
    def stats(self) -> ModelStats:
        """What has been queried so far."""
        return ModelStats(
            states=self._expanded,
            checks=self.feasibility.checks,
            cache_hits=self.feasibility.hits,
            unknown=self._unknown,
            trajectories=self._times.computed,
            left_open=self._left_open,
        )

    def is_goal(self, state: State) -> bool:
        """Whether the task is done in `state`."""
        return self.task.goal.holds(state)

    def applicable(self, state: State) -> list[Skill]:
        """Return the skills whose preconditions hold in `state`, in the order of the task."""
        bits = state.bits
        return [
            skill
            for requires, forbids, skill in self._masks
            if bits & requires == requires and not bits & forbids and skill.has_case(bits)
        ]

    def verdict(self, state: State, skill: Skill, likely: Likely | None = None) -> Verdict:
        """Return the verdict on `skill` in `state`, querying back ends for what is not known.

        Parameters
        ----------
        state, skill
            What is queried.
        likely
            Begins to yield what is likely to be queried next, states and skills, the most likely
            first: where several processes check, idle ones check that ahead. Neither verdicts nor
            counts depend on it.

        Raises
        ------
        BackEndError
            If a back end fails.
        SearchStopped
            If the solver should have stopped long ago.
        """
        self._cut_off()
        verdict = self.feasibility.verdict(skill, state, self._cut_off, likely)
        self._count(skill, verdict)
        return verdict

    def expected(self, state: State, skill: Skill) -> bool | None:
        """Return whether a skill is feasible as far as that was checked, ahead or not; else None.

        Always None where all checks are made in one process.
        """
        foresight = self.feasibility.foresight
        return None if foresight is None else foresight.expected(skill, state)

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts on several skills in states, in order; raises as `verdict`."""
        self._cut_off()
        verdicts = self.feasibility.verdicts(queries, self._cut_off)
        for (skill, _), verdict in zip(queries, verdicts, strict=True):
            self._count(skill, verdict)
        return verdicts

    def transition(self, state: State, skill: Skill) -> Transition:
        """Return the predicted transition, whether feasible or not.

        No back end is queried for a verdict, but for the way of a skill that has several; one that
        can may say how long it takes.
        """
        duration_s = self.duration_s(state, skill)
        return Transition(
            state,
            skill,
            tuple(
                (outcome.probability, outcome.apply(state)) for outcome in skill.outcomes_in(state)
            ),
            duration_s if self.asks_costs else skill.cost.at(state),
            duration_s,
        )

    def cost(self, state: State, skill: Skill) -> float:
        """Return what `skill` costs from `state`: a back end may be asked where that is its time.

        Raises
        ------
        ValueError
            If the state leaves it open.
        BackEndError
            If a back end fails.
        """
        return self.duration_s(state, skill) if self.asks_costs else skill.cost.at(state)

    def least_cost(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on the cost of a skill, without asking a back end for a time.

        Parameters
        ----------
        skill
            A skill of the task.
        true_bits, false_bits
            Bits of the facts that are known to hold, and not to hold, where it starts.
        """
        if self.asks_costs:
            least_s = self._times.least_s(skill, true_bits, false_bits)
            if math.isfinite(least_s):
                return least_s
        return skill.cost.least(true_bits, false_bits)

    def duration_s(self, state: State, skill: Skill) -> float:
        """Return the time that `skill` takes from `state` [s]: a back end's, or else the task's.

        Of a skill with several ways that of the one that is taken, for which verdicts are queried.
        The task's figure counts as no less than the bound of a back end that could not time it.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        if not self._timed:
            return skill.duration_s.at(state)
        said_s = self._times.duration_s(self.feasibility.taken(skill, state), state)
        if said_s is not None:
            return said_s
        figure_s = skill.duration_s.at(state)
        bits = state.bits
        least_s = self._times.least_s(skill, bits, self.task.facts.all_bits & ~bits)
        return max(figure_s, least_s) if math.isfinite(least_s) else figure_s

    def transitions(self, state: State) -> tuple[Transition, ...]:
        """Return the transitions of all skills that are applicable and feasible in `state`.

        A skill whose verdict is unknown is left out, and counted in `stats.unknown`.

        Raises
        ------
        BackEndError
            If a back end fails.
        SearchStopped
            If the solver should have stopped long ago.
        """
        self._cut_off()
        found = self._transitions.get(state)
        if found is None:
            skills = self.applicable(state)
            verdicts = self.verdicts([(skill, state) for skill in skills])
            found = tuple(
                self.transition(state, skill)
                for skill, verdict in zip(skills, verdicts, strict=True)
                if verdict.is_feasible
            )
            if len(self._transitions) >= _KEPT_STATES:
                self._transitions.clear()
            self._transitions[state] = found
            self._expanded += 1
        return found

    def _count(self, skill: Skill, verdict: Verdict) -> None:
        if verdict.status is VerdictStatus.UNKNOWN:
            self._unknown += 1
            self._left_open = self._left_open or f"{skill.name}: {verdict.stage}: {verdict.reason}"

    def _cut_off(self) -> None:
        if self._overdue is not None and self._overdue():
            raise SearchStopped("The solver went on long after it should have stopped.")
