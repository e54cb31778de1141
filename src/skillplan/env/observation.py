"""Observations, action masks and rewards of the environments."""

from __future__ import annotations

import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from skillplan.errors import OptionError, name_hint
from skillplan.model.skill_model import SkillModel
from skillplan.task.reward import Reward
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Literal, Task, read_start_state

ObservationKind = typing.Literal["paper", "markov", "layout"]
MaskKind = typing.Literal["none", "applicable", "feasible"]
Objective = typing.Literal["reward", "cost"]


def check_name(what: str, name: str, kinds: Any) -> Any:
    """Return a name that must belong to a kind.

    Parameters
    ----------
    what
        Meaning of the name, for the message.
    kinds
        Literal type of this module.

    Raises
    ------
    OptionError
        If the name is unknown; the message lists the known ones.
    """
    known = get_args(kinds)
    if name not in known:
        raise OptionError(f"Unknown {what} {name!r}. {name_hint(str(name), known)}")
    return name


@dataclass(frozen=True)
class Observation:
    """The features of a state that learners observe.

    Parameters
    ----------
    kind
        ``paper``: the bits that the task lists, or all facts; on the board as in Moller et al.,
        Fig. 5. ``markov``: these and the places of robots, on which costs depend. ``layout``: these
        and the cost of every skill from here, applicable or not, which distinguishes the boards of
        a family. These costs are the task's figures, never times of back ends.
    literals
        The bits, in order.
    priced
        Skills whose costs are observed, in order; after the bits.
    """

    kind: ObservationKind
    literals: tuple[Literal, ...]
    priced: tuple[Skill, ...] = ()

    def __post_init__(self) -> None:
        if not self.width:
            raise ValueError("An observation has at least one feature.")

    @classmethod
    def of(cls, task: Task, kind: str) -> Observation:
        """Return the observation of a task's states.

        Raises
        ------
        OptionError
            If the kind is unknown.
        """
        named: ObservationKind = check_name("observation", kind, ObservationKind)
        literals = task.observation or tuple(Literal(name) for name in task.facts.names)
        if named != "paper":
            seen = {literal.fact for literal in literals}
            places = {fact for robot in task.scene.robots for fact in robot.places}
            places |= set(task.places)
            literals += tuple(Literal(name) for name in task.facts.names if name in places - seen)
        return cls(named, literals, task.skills if named == "layout" else ())

    @property
    def width(self) -> int:
        """Number of features."""
        return len(self.literals) + len(self.priced)

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the features, such as ``not hand_free`` or ``cost(pick(pcb))``."""
        return (*map(str, self.literals), *(f"cost({skill.name})" for skill in self.priced))

    @property
    def space(self) -> Space[NDArray[np.float32]]:
        """Observation space, shape (width,): bits are at most 1, costs are unbounded."""
        highest = np.ones(self.width, dtype=np.float32)
        highest[len(self.literals) :] = np.finfo(np.float32).max
        box: Space[Any] = Box(np.zeros_like(highest), highest, dtype=np.float32)
        return box

    def encode(self, state: State) -> NDArray[np.float32]:
        """Return the features of a state, shape (width,), float32.

        Bits are 0 or 1, costs are in the task's metric. A cost that the state leaves undefined,
        such as that of loading the attached tool, is 0.
        """
        costs = (_cost(skill, state) for skill in self.priced)
        bits = (literal.value(state) for literal in self.literals)
        return np.array([*bits, *costs], dtype=np.float32)


def _cost(skill: Skill, state: State) -> float:
    try:
        return skill.cost.at(state)
    except ValueError:
        return 0.0


def read_start(model: SkillModel, options: Mapping[str, Any] | None) -> State:
    """Return the state in which a reset with these options begins an episode.

    Parameters
    ----------
    options
        None, or ``{"start": ...}``: a place such as ``C20``, or a list of all facts that hold, such
        as ``info["state"]``. See `read_start_state`.

    Raises
    ------
    OptionError
        If another option is given, a name is unknown, or the state already completes the task.
    """
    for name in options or ():
        if name != "start":
            hint = name_hint(str(name), ["start"])
            raise OptionError(f"Unknown option {name!r} of reset. {hint}")
    start = (options or {}).get("start")
    if start is None:
        return model.initial
    is_readable = isinstance(start, str | Iterable)
    names = start if isinstance(start, str) or not is_readable else list(start)
    if not is_readable or not all(isinstance(name, str) for name in names):
        raise OptionError(f"start {start!r}: is neither a name nor a list of facts.")
    try:
        state = read_start_state(model.task, names)
    except OptionError as error:
        raise OptionError(f"start {start!r}: {error}") from None
    if model.is_goal(state):
        raise OptionError(f"start {start!r}: already completes the task.")
    return state


def list_allowed_actions(
    model: SkillModel, state: State, mask: MaskKind, feasible: Callable[[int], bool]
) -> Sequence[int]:
    """Return the actions that a mask allows in a state, in ascending order.

    Parameters
    ----------
    model
        Model; no back end is queried through it.
    mask
        ``none`` allows all actions; ``applicable`` those whose preconditions hold; ``feasible``
        only feasible ones of them. Goal states allow none of the latter, without a query.
    feasible
        Returns whether an applicable action is feasible; called for the mask ``feasible`` only.
    """
    if mask == "none":
        return range(len(model.task.skills))
    applicable = [model.task.action(skill) for skill in model.applicable(state)]
    if mask == "applicable":
        return applicable
    return [] if model.is_goal(state) else [action for action in applicable if feasible(action)]


# Rewards in addition to costs, if the task has no reward scheme.
_COMPLETE = 10.0
_FAILED = -10.0


@dataclass(frozen=True)
class RewardFunction:
    """The rewards of an environment, one per step.

    Parameters
    ----------
    scheme
        Reward scheme of the task. None for minus the costs, with the following figures.
    infeasible
        Reward of a skill that cannot be executed; it has no cost.
    complete
        Bonus of the skill that completes the task.
    out_of_time
        Bonus of the last skill that the step limit allows.
    """

    scheme: Reward | None
    infeasible: float
    complete: float
    out_of_time: float

    @classmethod
    def of(cls, task: Task, objective: str) -> RewardFunction:
        """Return the rewards of a task.

        For the objective ``reward``, this is the task's reward scheme. For ``cost``, and for tasks
        without a scheme, it is minus the cost, so that the best policy is the cheapest that
        completes the task. Bonuses at the end of episodes come from the scheme, or else are 10 for
        completing the task and -10 for failing.

        Raises
        ------
        OptionError
            If the objective is unknown, or costs depend on the time since the begin.
        """
        check_name("objective", objective, Objective)
        if task.counts_waits:
            raise OptionError(
                f"{task.name!r}: parts arrive at a time ('arrives_s'), and how long the arm waits "
                "depends on more than the state, on which rewards rest. Take cost: distance."
            )
        reward = task.reward
        infeasible = _FAILED if reward is None else reward.infeasible
        return cls(
            reward if objective == "reward" else None,
            infeasible,
            float(getattr(reward, "complete", _COMPLETE)),
            float(getattr(reward, "out_of_time", infeasible)),
        )

    def of_step(
        self, state: State, skill: str, cost: float, *, goal: bool, out_of_time: bool
    ) -> float:
        """Return the reward of an executed step."""
        if self.scheme is not None:
            return self.scheme.of_step(state, skill, cost, goal=goal, out_of_time=out_of_time)
        if goal:
            return self.complete - cost
        return self.out_of_time - cost if out_of_time else -cost
