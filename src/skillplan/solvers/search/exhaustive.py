"""Exhaustive search: enumerates and counts all feasible sequences up to the step limit.

Moller et al., section 5.3: "determined through an exhaustive search". Sequences are not pruned and
end at the goal.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from skillplan.model.skill_model import SkillModel, Transition
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver

_TIE = 1e-12


class ExhaustiveSolver(Solver):
    """Enumerate every feasible sequence, depth first."""

    name = "exhaustive"
    polls = True
    seeded = False

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason if a skill may have several outcomes, or None."""
        if not model.task.deterministic:
            return (
                "exhaustive search counts sequences and needs skills with one outcome each; "
                "under chance take value-iteration"
            )
        return None

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Count all complete sequences and keep the cheapest, the shortest among equals."""
        best: Plan | None = None
        best_key = (float("inf"), 0)
        cheapest: dict[int, float] = {}
        worst: dict[int, float] = {}
        complete: Counter[int] = Counter()
        visited = 1
        # One frame for each skill of the current sequence: successors and index of the next.
        frames: list[tuple[tuple[Transition, ...], float]] = []
        nexts: list[int] = []
        names: list[str] = []
        if model.is_goal(model.initial):
            trace = _trace(1, Counter({0: 1}), {}, {})
            return Solution(Plan((), 0.0), 0.0, proved=True, trace=trace)
        frames.append((model.transitions(model.initial), 0.0))
        nexts.append(0)
        stopped = False
        while frames:
            if visited % 256 == 0 and self.stop():
                stopped = True
                break
            following, cost = frames[-1]
            index = nexts[-1]
            if index == len(following):
                frames.pop()
                nexts.pop()
                if names:
                    names.pop()
                continue
            nexts[-1] += 1
            step = following[index]
            visited += 1
            total, length = cost + step.cost, len(names) + 1
            if model.is_goal(step.next_state):
                complete[length] += 1
                cheapest[length] = min(cheapest.get(length, total), total)
                worst[length] = max(worst.get(length, 0.0), total)
                key = (total, length)
                if key[0] < best_key[0] - _TIE or (
                    key[0] <= best_key[0] + _TIE and length < best_key[1]
                ):
                    best_key = key
                    best = Plan((*names, step.skill.name), total)
                    self.stop.incumbent(best)
            elif length < model.step_limit:
                frames.append((model.transitions(step.next_state), total))
                nexts.append(0)
                names.append(step.skill.name)
            if visited % 4096 == 0:
                self.stop.bound(self._open_bound(frames, nexts, best_key[0]), visited)
        bound = self._open_bound(frames, nexts, best_key[0]) if stopped else best_key[0]
        trace = _trace(visited, complete, cheapest, worst)
        return Solution(best, bound, proved=not stopped, trace=trace)

    @staticmethod
    def _open_bound(
        frames: list[tuple[tuple[Transition, ...], float]], nexts: list[int], best: float
    ) -> float:
        """Return the least possible cost of a sequence not enumerated yet."""
        bound = best
        for (following, cost), index in zip(frames, nexts, strict=True):
            for step in following[index:]:
                bound = min(bound, cost + step.cost)
        return bound


def _trace(
    visited: int, complete: Counter[int], cheapest: dict[int, float], worst: dict[int, float]
) -> dict[str, Any]:
    """Return the figures of a search: sequences visited, and costs of complete ones by length."""
    return {
        "visited": visited,
        "bound_method": "enumeration of all sequences",
        "sequences": complete.total(),
        "sequences_by_length": dict(sorted(complete.items())),
        "best_cost_by_length": dict(sorted(cheapest.items())),
        "worst_cost_by_length": dict(sorted(worst.items())),
    }
