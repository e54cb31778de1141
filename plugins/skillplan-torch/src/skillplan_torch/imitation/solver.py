"""The solver `imitate`: a network learns from `replan`, then from what comes of its choices.

Imitation asks the teacher in the states that the network itself gets to (DAgger: Ross, Gordon and
Bagnell, "A reduction of imitation learning and structured prediction to no-regret online
learning", 2011). Reinforcement follows the policy gradient (Williams, 1992) with the mean of what
is still to pay, state by state, as its baseline. Of all networks the one of the least expected
cost is kept, worked out from its Markov chain.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from typing import Any

import numpy as np
import torch

from skillplan.errors import ModelTooLarge
from skillplan.model.policy_value import evaluate_policy
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.chance.replan import ReplanSolver
from skillplan.solvers.learning.network_choice import NetworkChoice, reachable_policy
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan.solvers.solution import Solution
from skillplan.solvers.solver import Solver
from skillplan.task.state import State
from skillplan_torch.batched_adam import BatchedAdam
from skillplan_torch.batched_network import BatchedNetwork, padded
from skillplan_torch.imitation.episodes import Episode, Sight, Views, roll_out
from skillplan_torch.imitation.options import ImitateOptions

# A roll-out is given up after so many times the step limit.
_LIMITS = 2
# What an answer takes is measured on so many.
_TIMED = 1_000


class ImitateSolver(Solver):
    """Learn from what replan does, then from what comes of it; a policy in milliseconds."""

    name = "imitate"
    polls = True
    Options = ImitateOptions
    options: ImitateOptions

    def refuses(self, model: SkillModel) -> str | None:
        """Return why not, where the teacher refuses."""
        why = ReplanSolver().refuses(model)
        return None if why is None else f"replan, from which it would learn, refuses: {why}"

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Learn on one model; the teacher's lower bound is passed on."""
        taught = ReplanSolver(ReplanSolver.Options(roll_outs=2), self.stop).solve(model, seed=seed)
        teacher = taught.policy
        if teacher is None:
            return Solution(None, taught.lower_bound, trace=taught.trace)
        begin_s = time.perf_counter()
        lesson = _Lesson(self, model, seed)
        torch.set_num_threads(1)
        for _ in range(self.options.rounds):
            if self.stop():
                break
            lesson.imitate(teacher)
            lesson.keep()
        imitated, imitated_s = lesson.least, time.perf_counter() - begin_s
        for _ in range(self.options.reinforcements):
            if self.stop():
                break
            lesson.reinforce()
            lesson.keep()
        choice = lesson.choice(lesson.best)
        policy = reachable_policy(model, choice)
        trace: dict[str, Any] = {
            "teacher_cost": evaluate_policy(model, teacher.get).cost,
            "imitated_cost": None if math.isinf(imitated) else imitated,
            "learned_cost": None if math.isinf(lesson.least) else lesson.least,
            "demonstrations": len(lesson.said),
            "imitation_s": imitated_s,
            "reinforcement_s": time.perf_counter() - begin_s - imitated_s,
            "answer_ms": _answer_ms(choice, list(policy)),
            "bound_method": taught.trace.get("bound_method", ""),
            "teacher": dict(taught.trace),
        }
        return Solution(policy, taught.lower_bound, trace=trace)


class _Lesson:
    """A network that learns, and the best one that it has been."""

    def __init__(self, solver: ImitateSolver, model: SkillModel, seed: int) -> None:
        self._options, self._model = solver.options, model
        self._chance = np.random.Generator(np.random.PCG64(seed))
        self._views = Views(model, self._options.observation, self._options.mask)
        self._actions = len(model.task.skills)
        hidden = [self._options.width] * self._options.layers
        sizes = [self._views.width, *hidden, padded(self._actions)]
        self._network = BatchedNetwork(sizes, [self._chance], last_gain=0.01)
        self._adam = BatchedAdam(self._network.parameters)
        self._limit = _LIMITS * model.step_limit
        self._to_pay: dict[State, float] = {}
        self.said: dict[State, int] = {}
        self.best = self._network.policy(0, self._actions)
        self.least = math.inf

    def choice(self, network: NetworkPolicy) -> NetworkChoice:
        """Return the greedy policy of a network."""
        options = self._options
        return NetworkChoice(network, self._model, options.observation, options.mask)

    def keep(self) -> None:
        """Keep the network where its greedy policy costs less than the best so far."""
        network = self._network.policy(0, self._actions)
        try:
            cost = evaluate_policy(self._model, self.choice(network)).cost
        except ModelTooLarge:
            return
        if cost is not None and cost < self.least:
            self.best, self.least = network, cost

    def imitate(self, teacher: Any) -> None:
        """Ask the teacher where the network gets to, and learn all it has said."""

        def choose(state: State, sight: Sight) -> int:
            if state not in self.said:
                skill = teacher.get(state)
                self.said[state] = -1 if skill is None else self._model.task.action(skill)
            if self._chance.random() < self._options.slips or self.said[state] < 0:
                return int(self._chance.choice(list(sight.arrows)))
            if first:
                return self.said[state]
            action = int(np.argmax(self._scores(sight)))
            return action if action in sight.arrows else self.said[state]

        first = not self.said
        for _ in range(self._options.roll_outs):
            roll_out(self._views, choose, self._chance, self._limit)
        known = {state: action for state, action in self.said.items() if action >= 0}
        features, masks = self._seen(list(known))
        actions = torch.from_numpy(np.array(list(known.values()), dtype=np.int64))
        for epoch in range(self._options.epochs):
            logits = self._logits(features, masks)
            rate = self._options.learning_rate * (1.0 - 0.9 * epoch / self._options.epochs)
            self._adam.step(torch.nn.functional.cross_entropy(logits, actions), rate)

    def reinforce(self) -> None:
        """Follow the gradient of what roll-outs cost, once."""
        options = self._options

        def choose(state: State, sight: Sight) -> int:
            scores = self._scores(sight).astype(np.float64)
            weights = np.exp(scores - scores.max())
            return int(self._chance.choice(self._actions, p=weights / weights.sum()))

        episodes = [
            roll_out(self._views, choose, self._chance, self._limit) for _ in range(options.batch)
        ]
        states = [state for one in episodes for state in one.states]
        actions = np.array([action for one in episodes for action in one.actions], dtype=np.int64)
        advantages = self._advantages(episodes, states)
        features, masks = self._seen(states)
        logs = torch.log_softmax(self._logits(features, masks), dim=1)
        taken = logs.gather(1, torch.from_numpy(actions)[:, None])[:, 0]
        loss = -(torch.from_numpy(advantages) * taken).sum() / len(episodes)
        self._adam.step(loss, options.reinforcement_rate)

    def _advantages(self, episodes: list[Episode], states: list[State]) -> np.ndarray[Any, Any]:
        """Return by how much less is paid from every state on than the mean there, scaled."""
        failure = 2.0 * max(sum(one.costs) for one in episodes)
        to_pay = []
        for one in episodes:
            tail = 0.0 if one.complete else failure
            sums = []
            for cost in reversed(one.costs):
                tail += cost
                sums.append(tail)
            to_pay += sums[::-1]
        by_state: defaultdict[State, list[float]] = defaultdict(list)
        for state, one_paid in zip(states, to_pay, strict=True):
            by_state[state].append(one_paid)
        for state, sums_there in by_state.items():
            mean = sum(sums_there) / len(sums_there)
            self._to_pay[state] = 0.8 * self._to_pay.get(state, mean) + 0.2 * mean
        paid = np.array(to_pay, dtype=np.float32)
        usual = np.array([self._to_pay[state] for state in states], dtype=np.float32)
        gains = usual - paid
        spread = float(gains.std())
        return gains / spread if spread > 0 else gains

    def _seen(self, states: list[State]) -> tuple[torch.Tensor, torch.Tensor]:
        sights = [self._views[state] for state in states]
        features = np.stack([one.features for one in sights])
        masks = np.stack([one.mask for one in sights])
        return torch.from_numpy(features), torch.from_numpy(masks)

    def _logits(self, features: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        logits = self._network(features[None])[0, :, : self._actions]
        return logits.masked_fill(~masks, -1e9)

    def _scores(self, sight: Sight) -> np.ndarray[Any, Any]:
        scores = self._network.of_one(sight.features[None])[0, : self._actions]
        return np.where(sight.mask, scores, -np.inf)


def _answer_ms(choice: NetworkChoice, states: list[State]) -> float | None:
    """Return the mean time of an answer [ms]; None without states."""
    if not states:
        return None
    begin_s = time.perf_counter()
    for count in range(_TIMED):
        choice(states[count % len(states)])
    return 1000 * (time.perf_counter() - begin_s) / _TIMED
