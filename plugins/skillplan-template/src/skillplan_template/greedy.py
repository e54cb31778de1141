"""Greedy search: the cheapest feasible skill, sometimes a random one, in many attempts."""

import random

from pydantic import BaseModel, Field

from skillplan import Plan, SkillModel, Solution, Solver


class GreedySolver(Solver):
    """Follow the cheapest feasible skill to the goal; keep the best of many attempts."""

    name = "greedy"
    polls = True  # `self.stop()`, at every step

    class Options(BaseModel):
        """Options of the solver."""

        attempts: int = Field(default=300, ge=1, description="walks from the start [-]")
        epsilon: float = Field(default=0.3, ge=0, le=1, description="chance of a random skill [-]")

    options: Options

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Return the best plan of all attempts, without a proof."""
        rng = random.Random(seed)
        for _ in range(self.options.attempts):
            state, seen, skills, cost = model.initial, {model.initial}, list[str](), 0.0
            while not model.is_goal(state) and len(skills) < model.step_limit:
                steps = [s for s in model.transitions(state) if s.next_state not in seen]
                if not steps or self.stop():
                    break
                explore = rng.random() < self.options.epsilon
                step = rng.choice(steps) if explore else min(steps, key=lambda s: s.cost)
                state, cost = step.next_state, cost + step.cost
                seen.add(state)
                skills.append(step.skill.name)
            if model.is_goal(state):
                self.stop.incumbent(Plan(tuple(skills), cost))
        return Solution(self.stop.best)
