"""The solver `relational`: learns one policy on many boards, and follows it on any other."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import torch

from skillplan.errors import OptionError
from skillplan.model.policy_value import roll_out
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.records.training.relational_file import read_relational
from skillplan.solvers.learning.network_choice import reachable_policy
from skillplan.solvers.relational.element_choice import ElementChoice
from skillplan.solvers.relational.family_learner import FamilyLearner, FamilyLesson
from skillplan.solvers.relational.relational_network import NetworkSize
from skillplan.solvers.solution import Plan, Solution
from skillplan_torch.relational.learning import RelationalLearning
from skillplan_torch.relational.lessons import Board
from skillplan_torch.relational.options import RelationalOptions

_UNTRAINED = (
    "it follows a policy that was trained on a family of boards: 'skillplan train --family "
    "generated:6-12 --solver relational --out RUN', then -O run=RUN"
)


class RelationalSolver(FamilyLearner):
    """Follow a policy that was learned on other boards, with any number of elements."""

    name = "relational"
    Options = RelationalOptions
    options: RelationalOptions

    @property
    def boards(self) -> int:
        """How many boards it wants to learn on."""
        return self.options.boards

    @property
    def steps(self) -> int:
        """How many rounds it learns."""
        return self.options.rounds

    def refuses(self, model: SkillModel) -> str | None:
        """Return why not, where no policy is named."""
        return None if self.options.run else _UNTRAINED

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Follow the policy greedily; nothing is claimed of the plan but its cost."""
        if not self.options.run:
            raise OptionError(f"relational: {_UNTRAINED}.")
        stored = read_relational(Path(self.options.run))
        choose = ElementChoice(stored.network, model)
        trace: dict[str, Any] = {"run": self.options.run, "family": stored.content.family}
        if not model.task.deterministic:
            return Solution(reachable_policy(model, choose), trace=trace)
        skills = roll_out(model, choose)
        walked = replay(model, skills)
        if not walked.complete:
            reason = walked.violations[0].reason
            return Solution(trace={**trace, "reason": f"the policy does not complete it: {reason}"})
        plan = Plan(tuple(skill.name for skill in skills), walked.cost)
        return Solution(plan, trace=trace)

    def learn(
        self, boards: Iterable[SkillModel], seed: int, on_step: Callable[[], None]
    ) -> FamilyLesson:
        """Learn in rounds: walk on all boards, then learn from all that was met so far."""
        options = self.options
        torch.set_num_threads(1)
        taught: list[Board] = []
        for model in boards:
            if self.stop() and taught:
                break
            try:
                taught.append(Board.of(model))
            except ValueError as error:
                raise OptionError(
                    f"relational cannot learn on {model.task.name}: {error}"
                ) from None
        learning = RelationalLearning(
            taught,
            NetworkSize(width=options.width, layers=options.layers),
            seed,
            batch=options.batch,
            learning_rate=options.learning_rate,
            slips=options.slips,
            sharpness=options.sharpness,
        )
        regrets = []
        for round_ in range(options.rounds):
            if self.stop():
                break
            learning.walk()
            share = (round_ / options.rounds, (round_ + 1) / options.rounds)
            regrets.append(learning.learn(options.updates, self.stop, share))
            on_step()
        trace = {
            "boards": len(taught),
            "states": learning.states,
            "updates": learning.updates,
            "rounds": len(regrets),
            "regrets": [one for one in regrets if one == one],
        }
        return FamilyLesson(learning.network, trace)
