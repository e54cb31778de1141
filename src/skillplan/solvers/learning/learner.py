"""Interface of learners: solvers that train several runs together and can resume.

`skillplan train` advances their trainings, stores snapshots and resumes from them. Learners
neither write files nor evaluate themselves.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from skillplan.env.observation import MaskKind, Observation, check_name, list_allowed_actions
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.learning.network_policy import GREEDY, ActionRule, NetworkPolicy
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

# A policy that reaches more states than this is followed no further.
_MOST_STATES = 20_000


class NetworkChoice:
    """The greedy policy of a network, state by state.

    Parameters
    ----------
    network
        As many inputs as are observed, as many actions as there are skills.
    model
        The skill model; it is queried where the mask needs it.
    observation
        Observation: ``paper``, ``markov`` or ``layout``.
    mask
        Mask of the choice: ``none``, ``applicable`` or ``feasible``.

    Raises
    ------
    OptionError
        If a name is unknown.
    """

    def __init__(
        self, network: NetworkPolicy, model: SkillModel, observation: str, mask: str
    ) -> None:
        self._network, self._model = network, model
        self._mask: MaskKind = check_name("mask", mask, MaskKind)
        self._observation = Observation.of(model.task, observation)

    def __call__(self, state: State) -> Skill:
        """Return the skill that is taken in a state."""
        masks = None if self._mask == "none" else self._allowed(state)[None]
        action = self._network.greedy(self._observation.encode(state)[None], masks)[0]
        return self._model.task.skills[int(action)]

    def _allowed(self, state: State) -> NDArray[np.bool_]:
        model, skills = self._model, self._model.task.skills
        mask = np.zeros(len(skills), dtype=np.bool_)

        def feasible(action: int) -> bool:
            # All transitions are queried at once, and kept by the model.
            return any(arrow.skill is skills[action] for arrow in model.transitions(state))

        mask[list(list_allowed_actions(model, state, self._mask, feasible))] = True
        return mask


def reachable_policy(model: SkillModel, choose: Callable[[State], Skill]) -> Policy:
    """Return a policy in every state that it may reach from the initial one.

    It is followed up to the step limit; a skill that is not feasible is left out.
    """
    choices: dict[State, Skill] = {}
    level = [model.initial]
    for _ in range(model.step_limit):
        following: dict[State, None] = {}
        for state in level:
            if state in choices or model.is_goal(state) or len(choices) >= _MOST_STATES:
                continue
            skill = choose(state)
            if skill.applicable(state) and model.verdict(state, skill).is_feasible:
                choices[state] = skill
                following.update(
                    (outcome.apply(state), None) for outcome in skill.outcomes_in(state)
                )
        level = list(following)
    return Policy(choices)


MODEL_BASED = " with model-based planning"
"""Suffix of the name of a learner that plans its episodes with a learned model."""
STRIDE_STEPS = 100
"""Environment steps between two records of a run, at which it may be stopped."""

# Environment steps of a run for a pair of skills: a run learns what each skill costs after each
# other one. Under chance, and on several layouts, it needs more.
_STEPS_PER_PAIR, _STEPS_PER_PAIR_BY_CHANCE = 20, 160
_ROUND = 1_000
_FEWEST_STEPS, _MOST_STEPS = 2_000, 200_000

End = Literal["complete", "infeasible", "out-of-time"]


@dataclass(frozen=True, slots=True)
class Episode:
    """An episode of training that has ended.

    Parameters
    ----------
    run
        Index of the run among those side by side.
    step
        Environment steps that the run had done when it ended, >= 1.
    end
        ``complete``, ``infeasible`` after a skill that could not be executed, or ``out-of-time``
        at the step limit.
    actions
        Actions taken, in order, including a failed one.
    cost
        Sum of the costs of the skills executed, in the task's metric.
    reward
        Sum of the environment's rewards.
    greedy
        True if all actions were the policy's own.
    planned
        True if actions were planned with a learned model.
    """

    run: int
    step: int
    end: End
    actions: tuple[int, ...]
    cost: float
    reward: float
    greedy: bool
    planned: bool = False

    @property
    def success(self) -> bool:
        """True if the task was completed."""
        return self.end == "complete"


@dataclass(frozen=True)
class Snapshot:
    """State of a training, from which it resumes bit for bit.

    Parameters
    ----------
    arrays
        Weights, moments of optimisers and replay memories by name.
    notes
        States of random number generators, counts and the rest as JSON values.
    """

    arrays: Mapping[str, NDArray[Any]]
    notes: Mapping[str, Any]


@dataclass(frozen=True)
class Learned:
    """The policy of a run.

    Parameters
    ----------
    best
        The evaluated policy of lowest cost; None if none completed the task.
    last
        The current policy.
    best_cost
        Cost of the best policy; None without one.
    best_step
        Environment steps after which it was kept; None without one.
    """

    last: NetworkPolicy
    best: NetworkPolicy | None = None
    best_cost: float | None = None
    best_step: int | None = None

    @property
    def policy(self) -> NetworkPolicy:
        """The reported policy: the best one, or the last if no policy completed the task."""
        return self.last if self.best is None else self.best


class Training(ABC):
    """Runs of equal length in progress, one for each environment of the vector.

    A run does not depend on the others: a seed gives the same figures alone and among others.

    Attributes
    ----------
    steps
        Environment steps of every run so far.
    failed
        Reason for each run that cannot continue, such as weights that are not finite. It has no
        further episodes; the others continue.
    """

    steps: int
    failed: dict[int, str]

    @abstractmethod
    def advance(self, steps: int) -> list[Episode]:
        """Take environment steps in every run; return the episodes that ended, in order."""

    @abstractmethod
    def figures(self) -> list[dict[str, float]]:
        """Return metrics of every run since the previous call, such as ``loss``."""

    def remarks(self, run: int) -> dict[str, Any]:
        """Return facts about a run's training as JSON values; none by default."""
        return {}

    @abstractmethod
    def learned(self, run: int) -> Learned:
        """Return a run's policies."""

    def start_from(self, networks: Sequence[NetworkPolicy]) -> None:
        """Begin with these networks; called before the first step.

        Only called if `Learner.hidden_layers` is not None.

        Parameters
        ----------
        networks
            One for every run, with the task's inputs and outputs.
        """
        raise NotImplementedError

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """Return the state of the training, the environment included."""

    @abstractmethod
    def restore(self, snapshot: Snapshot) -> None:
        """Resume from a snapshot of a training of the same solver, options, seeds and steps.

        Raises
        ------
        ValueError
            If it is another one.
        """


class LearnerOptions(BaseModel):
    """Options of every learner.

    With ``schedule_steps``, a run's first steps do not depend on the length of the training.
    """

    steps: int | None = Field(
        default=None,
        ge=1,
        le=1_000_000_000,
        description="environment steps of a run; null to derive them from the number of skills; "
        "`train --steps` takes precedence [-]",
    )
    schedule_steps: int | None = Field(
        default=None,
        ge=1,
        le=1_000_000_000,
        description="length of the exploration and learning-rate schedules, in environment steps; "
        "null for the whole run [-]",
    )
    observation: Literal["paper", "markov", "layout"] = Field(
        default="markov",
        description="observation: paper, the bits listed in the task file; markov, also the "
        "place of the arm, on which costs depend; layout, also the cost of every action [-]",
    )
    mask: Literal["none", "applicable", "feasible"] = Field(
        default="applicable",
        description="mask of the actions: none; applicable, skills whose preconditions hold; "
        "feasible, skills that back ends allow, which are queried for all of them [-]",
    )
    objective: Literal["reward", "cost"] = Field(
        default="reward",
        description="reward of the environment: reward, the task's rewards; cost, minus its costs "
        "and the rewards of failures [-]",
    )

    @classmethod
    def upgrade(cls, stored: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options of a stored training, completed if an earlier version wrote them."""
        return dict(stored)


class Learner(Solver):
    """A solver that trains network policies.

    Attributes
    ----------
    presets
        Options by the name of a preset; the docstring of the learner gives their source.
    """

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    Options: ClassVar[type[BaseModel]] = LearnerOptions
    polls = True
    options: LearnerOptions

    def derived(self, tasks: Sequence[Task]) -> dict[str, Any]:
        """Return the values of options that are null, derived from the task.

        Parameters
        ----------
        tasks
            The task, or the layouts of a family.
        """
        if self.options.steps is not None:
            return {}
        return {"steps": usual_steps(tasks)}

    def scales(self, task: Task) -> dict[str, float]:
        """Return further values that are derived from the task, by name."""
        return {"horizon": task.step_limit}

    @property
    def own_rule(self) -> ActionRule:
        """How its policies act at the end of a training; greedily by default."""
        return GREEDY

    @property
    def hidden_layers(self) -> tuple[int, ...] | None:
        """Units of every hidden layer; None if trainings cannot start from given networks."""
        return None

    @abstractmethod
    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training before its first step.

        Parameters
        ----------
        env
            One environment for every run; the training resets it.
        seeds
            Seed of all randomness of every run.
        steps
            Environment steps of every run in all; schedules span them without
            ``schedule_steps``.
        """

    def resume(
        self, env: SkillVectorEnv, seeds: Sequence[int], steps: int, snapshot: Snapshot
    ) -> Training:
        """Return a training that resumes from a snapshot, bit for bit.

        Parameters
        ----------
        env, seeds, steps
            As for `begin`, and with the same values.
        snapshot
            Snapshot of the training.

        Raises
        ------
        ValueError
            If the snapshot does not fit this solver and its options.
        """
        training = self.begin(env, seeds, steps)
        training.restore(snapshot)
        return training

    def figures(self, model: SkillModel) -> dict[str, Any]:
        """Return further figures of a solution by this learner; none by default."""
        return {}

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Train one run and return its policy in the states that it reaches."""
        options = self.options
        steps = options.steps or self.derived([model.task]).get("steps")
        steps = int(steps or usual_steps([model.task]))
        env = SkillVectorEnv(
            model,
            1,
            observation=options.observation,
            mask=options.mask,
            objective=options.objective,
        )
        training = self.begin(env, [seed], steps)
        episodes = completed = planned = 0
        best: float | None = None
        while training.steps < steps and not training.failed and not self.stop():
            for episode in training.advance(min(STRIDE_STEPS, steps - training.steps)):
                episodes += 1
                completed += episode.success
                planned += episode.planned
                if episode.success and model.task.deterministic:
                    names = tuple(model.task.skills[action].name for action in episode.actions)
                    self.stop.incumbent(Plan(names, episode.cost))
                if episode.success and (best is None or episode.cost < best):
                    best = episode.cost
        trace: dict[str, Any] = {
            "steps": training.steps,
            "iterations": training.steps,
            "episodes_done": episodes,
            "completed": completed,
            "best_cost_seen": best,
            **self.figures(model),
            **training.remarks(0),
        }
        # A run that explored in the end depends on its seed, whatever it planned before.
        if planned and "explores" not in training.figures()[0]:
            trace["planned_episodes"] = planned
        if training.failed:
            return Solution(trace={**trace, "reason": training.failed[0]})
        choose = NetworkChoice(training.learned(0).policy, model, options.observation, options.mask)
        return Solution(reachable_policy(model, choose), trace=trace)


def is_certain(tasks: Sequence[Task]) -> bool:
    """Return whether one episode shows the cost of a policy: one task without chance."""
    return len(tasks) == 1 and tasks[0].deterministic


def usual_steps(tasks: Sequence[Task], factor: float = 1.0) -> int:
    """Return the default number of environment steps of a run, in whole thousands.

    Parameters
    ----------
    tasks
        The task, or the layouts of a family; at least one.
    factor
        Factor of the learner, > 0.
    """
    per_pair = _STEPS_PER_PAIR if is_certain(tasks) else _STEPS_PER_PAIR_BY_CHANCE
    pairs = max(len(task.skills) for task in tasks) ** 2
    rounded = round(factor * per_pair * pairs / _ROUND) * _ROUND
    return min(_MOST_STEPS, max(_FEWEST_STEPS, rounded))
