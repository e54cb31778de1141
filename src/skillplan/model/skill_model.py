"""The lazy skill-transition model: what every solver consumes.

*Applicable* is symbolic and free; *feasible* queries back ends, and only once a solver needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from skillplan.checks.feasibility import Feasibility
from skillplan.errors import SearchStopped
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

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
    """What was queried of a model: states expanded, checks made, verdicts reused, unknown met."""

    states: int = 0
    checks: int = 0
    cache_hits: int = 0
    unknown: int = 0


class SkillModel:
    """Task plus feasibility, queried lazily.

    Parameters
    ----------
    feasibility
        The chain of checks; its task is the model's.
    overdue
        Returns True once a solver should have stopped long ago; then the model raises
        `SearchStopped` in it.
    """

    def __init__(self, feasibility: Feasibility, overdue: Callable[[], bool] | None = None) -> None:
        self.feasibility = feasibility
        self.task: Task = feasibility.task
        self._overdue = overdue
        self._transitions: dict[State, tuple[Transition, ...]] = {}
        self._timed = feasibility.tells_time
        self._unknown = 0
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

    def verdict(self, state: State, skill: Skill) -> Verdict:
        """Return the verdict on `skill` in `state`, querying back ends for what is not known.

        Raises
        ------
        BackEndError
            If a back end fails.
        SearchStopped
            If the solver should have stopped long ago.
        """
        self._cut_off()
        verdict = self.feasibility.verdict(skill, state, self._cut_off)
        if verdict.status is VerdictStatus.UNKNOWN:
            self._unknown += 1
        return verdict

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts on several skills in states, in order; raises as `verdict`."""
        self._cut_off()
        verdicts = self.feasibility.verdicts(queries, self._cut_off)
        self._unknown += sum(v.status is VerdictStatus.UNKNOWN for v in verdicts)
        return verdicts

    def transition(self, state: State, skill: Skill) -> Transition:
        """Return the predicted transition, whether feasible or not.

        No back end is queried for a verdict, but for the way of a skill that has several; one that
        can may say how long it takes.
        """
        return Transition(
            state,
            skill,
            tuple(
                (outcome.probability, outcome.apply(state)) for outcome in skill.outcomes_in(state)
            ),
            skill.cost.at(state),
            self.duration_s(state, skill) if self._timed else skill.duration_s.at(state),
        )

    def duration_s(self, state: State, skill: Skill) -> float:
        """Return the time that `skill` takes from `state` [s]: a back end's, or else the task's.

        Of a skill with several ways that of the one that is taken, for which verdicts are queried.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        said_s = None
        if self._timed:
            said_s = self.feasibility.duration_s(self.feasibility.taken(skill, state), state)
        return skill.duration_s.at(state) if said_s is None else said_s

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

    def _cut_off(self) -> None:
        if self._overdue is not None and self._overdue():
            raise SearchStopped("The solver went on long after it should have stopped.")
