"""Replay of a sequence on a model: its cost, and its first fault."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from skillplan.model.skill_model import SkillModel, Transition
from skillplan.task.motion import Point
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import VerdictStatus

GOAL = "goal"
STEP_LIMIT = "step-limit"


@dataclass(frozen=True, slots=True)
class Step:
    """One executed skill.

    Parameters
    ----------
    index, skill, action
        Position in the sequence, name, and action number.
    start, goal
        First and last position of the arm [m]; None for a skill without motion.
    reward
        The reward; None if the task has no reward scheme.
    place
        Final place of a walking skill.
    wait_s
        Part of the duration in which the arm waits for a part [s], >= 0.
    """

    index: int
    skill: str
    action: int
    start: Point | None
    goal: Point | None
    cost: float
    duration_s: float
    reward: float | None
    place: str | None = None
    way: str | None = None
    wait_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Violation:
    """A fault of a sequence.

    Parameters
    ----------
    step
        Index of the skill, or the length of the sequence for a fault at its end.
    skill
        Name of the skill; None for a fault at the end.
    stage, reason, facts
        As in the verdict.
    """

    step: int
    skill: str | None
    stage: str
    reason: str
    facts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Replay:
    """A replayed sequence.

    Parameters
    ----------
    feasible
        True if every skill could be executed within the step limit.
    complete
        True if the goal holds at the end.
    violations
        Faults; empty if feasible and complete.
    penalty
        Reward of the skill that could not be executed, else 0; None if the task has no reward
        scheme.
    """

    steps: tuple[Step, ...]
    state: State
    feasible: bool
    complete: bool
    violations: tuple[Violation, ...]
    penalty: float | None = None

    @property
    def cost(self) -> float:
        """Sum of the costs."""
        return sum(step.cost for step in self.steps)

    @property
    def duration_s(self) -> float:
        """Sum of the durations [s]."""
        return sum(step.duration_s for step in self.steps)

    @property
    def total_reward(self) -> float | None:
        """Sum of the rewards; None if the task has no reward scheme."""
        if self.penalty is None:
            return None
        return sum(step.reward or 0.0 for step in self.steps) + self.penalty


def replay(model: SkillModel, skills: Sequence[Skill]) -> Replay:
    """Execute skills in sequence from the initial state, each with its nominal outcome.

    The replay stops at the first skill that cannot be executed. Skills after the goal are executed
    like any other.
    """
    state, steps = model.initial, []
    reward = model.task.reward
    penalty = None if reward is None else 0.0
    violations: list[Violation] = []
    over = model.is_goal(state)
    elapsed_s = 0.0
    for index, skill in enumerate(skills):
        if index == model.step_limit:
            reason = f"the sequence has {len(skills)} skills, the limit is {model.step_limit}"
            violations.append(Violation(index, skill.name, STEP_LIMIT, reason, ()))
            break
        verdict = model.verdict(state, skill)
        if not verdict.is_feasible:
            unknown = verdict.status is VerdictStatus.UNKNOWN
            reason = f"could not be decided: {verdict.reason}" if unknown else verdict.reason
            violations.append(
                Violation(index, skill.name, verdict.stage, reason, tuple(verdict.facts))
            )
            penalty = None if reward is None else reward.infeasible
            break
        transition = model.transition(state, skill, elapsed_s)
        elapsed_s += transition.duration_s
        way = verdict.evidence.get("way") if skill.ways else None
        steps.append(replace(_step(model, index, transition, over), way=way))
        over = over or model.is_goal(transition.next_state)
        state = transition.next_state
    feasible = not violations
    complete = feasible and model.is_goal(state)
    if feasible and not complete:
        missing = model.task.goal.why_not(state)
        reason = f"the goal is not reached: {', '.join(missing)}"
        violations.append(Violation(len(skills), None, GOAL, reason, tuple(missing)))
    return Replay(tuple(steps), state, feasible, complete, tuple(violations), penalty)


def _step(model: SkillModel, index: int, transition: Transition, over: bool) -> Step:
    """Return the record of a step; steps after the end of the episode have no reward."""
    task, state, skill = model.task, transition.state, transition.skill
    start = goal = place = None
    if skill.motion is not None:
        start = task.scene.robot(skill.motion.robot).place(state)[1]
        goal = skill.motion.visits(state)[-1].position
    elif task.places:
        following = transition.next_state
        # A skill whose place does not change neither leaves nor reaches one.
        left = task.places_in(state - following) or task.places_in(state)
        reached = task.places_in(following - state) or task.places_in(following)
        if len(left) == len(reached) == 1:
            start, goal, place = left[0].position, reached[0].position, reached[0].name
    reward = None
    if task.reward is not None and over:
        reward = 0.0
    elif task.reward is not None:
        at_goal = model.is_goal(transition.next_state)
        reward = task.reward.of_step(
            state,
            skill.name,
            transition.cost,
            goal=at_goal,
            out_of_time=not at_goal and index + 1 == task.step_limit,
        )
    return Step(
        index,
        skill.name,
        task.action(skill),
        start,
        goal,
        transition.cost,
        transition.duration_s,
        reward,
        place,
        wait_s=transition.wait_s,
    )
