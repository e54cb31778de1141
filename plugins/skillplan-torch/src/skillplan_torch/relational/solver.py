"""The solver `relational`: one policy for boards of any size."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from pydantic import Field

from skillplan.errors import OptionError
from skillplan.model.policy_value import roll_out
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.records.training.relational_file import read_relational
from skillplan.solvers.learning.family_learner import FamilyLearner, FamilyLesson
from skillplan.solvers.learning.learner import reachable_policy
from skillplan.solvers.solution import Plan, Solution
from skillplan.task import back_end
from skillplan_torch.relational.network import NetworkSize, RelationalNetwork


class RelationalOptions(back_end.Options):
    """Options of `relational`."""

    run: str = Field(
        default="",
        description="folder of a policy that `train --family generated:LEAST-MOST` has written; "
        "needed to solve a task",
    )
    boards: int = Field(default=600, ge=1, le=100_000, description="boards to learn on [-]")
    rounds: int = Field(
        default=6,
        ge=1,
        le=1_000,
        description="rounds of roll-outs on all boards, each followed by updates [-]",
    )
    updates: int = Field(default=400, ge=1, le=1_000_000, description="updates of a round [-]")
    batch: int = Field(default=256, ge=1, le=65_536, description="states of an update [-]")
    learning_rate: float = Field(
        default=1e-3, gt=0.0, le=1.0, description="initial learning rate of Adam; it falls to 0 [-]"
    )
    slips: float = Field(
        default=0.15,
        ge=0.0,
        le=1.0,
        description="share of random choices in roll-outs, so that the network also learns from "
        "states off its own plan [-]",
    )
    sharpness: float = Field(
        default=100.0,
        gt=0.0,
        le=1e6,
        description="preference for a choice per share of the board's cost that it saves [-]",
    )
    width: int = Field(
        default=64, ge=4, le=1024, multiple_of=4, description="width of the network [-]"
    )
    layers: int = Field(default=3, ge=1, le=12, description="layers of attention [-]")


_UNTRAINED = (
    "it follows a policy that was trained on a family of boards: 'skillplan train --family "
    "generated:6-12 --solver relational --out RUN', then -O run=RUN"
)


class RelationalSolver(FamilyLearner):
    """Follow a policy that was learned on other boards, with any number of elements."""

    name = "relational"
    Policy = RelationalNetwork
    Options = RelationalOptions
    options: RelationalOptions

    @property
    def boards(self) -> int:
        """Number of boards to learn on."""
        return self.options.boards

    @property
    def steps(self) -> int:
        """Number of rounds."""
        return self.options.rounds

    def refuses(self, model: SkillModel) -> str | None:
        """Return a reason if no policy is given."""
        return None if self.options.run else _UNTRAINED

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Follow the policy greedily; the solution claims no bound."""
        if not self.options.run:
            raise OptionError(f"relational: {_UNTRAINED}.")
        stored = read_relational(Path(self.options.run), lambda _: type(self))
        choose = stored.policy.choice_on(model)
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
        """Learn in rounds: roll out on all boards, then update from all states so far."""
        # Only learning needs torch; a stored policy is evaluated with numpy.
        import torch

        from skillplan_torch.relational.learning import Board, RelationalLearning

        options = self.options
        torch.set_num_threads(1)
        learnable: list[Board] = []
        for model in boards:
            if self.stop() and learnable:
                break
            try:
                learnable.append(Board.of(model))
            except ValueError as error:
                raise OptionError(
                    f"relational cannot learn on {model.task.name}: {error}"
                ) from None
        learning = RelationalLearning(
            learnable,
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
            "boards": len(learnable),
            "states": learning.states,
            "updates": learning.updates,
            "rounds": len(regrets),
            "regrets": [regret for regret in regrets if regret == regret],
        }
        return FamilyLesson(learning.network, trace)
