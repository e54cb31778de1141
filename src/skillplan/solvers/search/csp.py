"""Constraint satisfaction: depth-first backtracking with forward checking, the paper's baseline.

The planner that learning replaced (Veeramani and Muthuswamy 2022, section 2): consecutive goal
positions of the base must share a docking pin. Otherwise the planner backtracks and replans, and
may fail altogether. The cheapest choice is tried first. Forward checking drops a choice at once if
no successor shares a pin with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

from pydantic import Field

from skillplan.model.skill_model import SkillModel, Transition
from skillplan.solvers.search.landmark_bound import convert_from_units, convert_to_units
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.task import back_end
from skillplan.task.state import State

# Greatest number of choices named in a message.
_MOST_NAMED = 4

_Key = tuple[int, frozenset[str]]


@dataclass(slots=True)
class _Choice:
    """A choice with its resources and untried successors.

    Parameters
    ----------
    name
        Name of the skill; empty for the start.
    held
        Resources of the choice; if it has none, resources of the choice before.
    cost
        Cost up to and including the choice [units].
    """

    name: str
    held: frozenset[str]
    cost: int
    following: Iterator[Transition]


class CspSolver(Solver):
    """Take the first sequence in which consecutive choices occupy something in common."""

    name = "csp"
    polls = True
    seeded = False
    stage: ClassVar[str | None] = "goals"

    class Options(back_end.Options):
        """Number of replans."""

        replans: int = Field(
            default=3,
            ge=0,
            le=20,
            description="number of finer replans of the upper levels after a failure [-]",
        )

    options: Options

    @property
    def replans(self) -> int:
        """Limited by an option."""
        return self.options.replans

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason if resources are missing or outcomes are random, or None."""
        if not model.task.deterministic:
            return "constraint satisfaction looks for one sequence and needs certain outcomes"
        if not any(case.occupies for skill in model.task.skills for case in skill.cases):
            return (
                "its rule is that consecutive choices occupy something in common, such as a "
                "docking pin, and no skill of this task occupies anything"
            )
        return None

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Search depth first, without a proof of optimality or infeasibility.

        The first choice is free, and skills without resources always fit. The trace has
        ``backtracks``.
        Without a plan it has ``failed_at``, the deepest choice without successors, and the
        ``reason``.
        """
        return _Search(self, model).run()


class _Search:
    """The search on one model."""

    def __init__(self, solver: CspSolver, model: SkillModel) -> None:
        self.stop = solver.stop
        self.model = model
        self.visited = 0
        self.backtracks = 0
        # Least depth at which a state was reached; reaching it later is useless.
        self._seen: dict[_Key, int] = {}
        self._deepest = -1
        self._failed_at = ""
        self._reason = "nothing is feasible at the start"

    def run(self) -> Solution:
        initial, nothing = self.model.initial, frozenset[str]()
        if self.model.is_goal(initial):
            return self._solution(Plan((), 0.0))
        self._seen[initial.bits, nothing] = 0
        chosen = [_Choice("", nothing, 0, self._open(initial, nothing, 0))]
        while chosen and not self.stop():
            last = chosen[-1]
            step = next(last.following, None)
            if step is None:
                chosen.pop()
                self.backtracks += bool(chosen)
                continue
            self.visited += 1
            held = _get_held(step) or last.held
            cost = last.cost + convert_to_units(step.cost)
            if self.model.is_goal(step.next_state):
                names = (*(choice.name for choice in chosen[1:]), step.skill.name)
                return self._solution(Plan(names, convert_from_units(cost)))
            following = self._open(step.next_state, held, len(chosen))
            chosen.append(_Choice(step.skill.name, held, cost, following))
        return self._solution(None)

    def _open(self, state: State, held: frozenset[str], depth: int) -> Iterator[Transition]:
        """Return the choices at a depth, cheapest first."""
        steps = sorted(self.model.transitions(state), key=lambda step: step.cost)
        return (
            step for step in steps if _has_common(step, held) and self._promising(step, held, depth)
        )

    def _promising(self, step: Transition, held: frozenset[str], depth: int) -> bool:
        """Return True if a choice is new or better than when it failed, and has successors."""
        if self.model.is_goal(step.next_state):
            return True
        held = _get_held(step) or held
        key = (step.next_state.bits, held)
        if self._seen.get(key, depth + 1) <= depth:
            return False
        self._seen[key] = depth
        name = step.skill.name
        if depth + 1 >= self.model.step_limit:
            return self._fail(depth, name, f"{name} is the last that the step limit allows")
        ahead = self.model.transitions(step.next_state)
        if any(_has_common(following, held) for following in ahead):
            return True
        return self._fail(depth, name, _describe_conflict(ahead, name))

    def _fail(self, depth: int, name: str, reason: str) -> bool:
        """Keep the deepest failure, the first among equals; return True if it is the new one."""
        if depth > self._deepest:
            self._deepest, self._failed_at, self._reason = depth, name, reason
        return False

    def _solution(self, plan: Plan | None) -> Solution:
        trace: dict[str, object] = {"visited": self.visited, "backtracks": self.backtracks}
        if plan is not None:
            self.stop.incumbent(plan)
        elif self.stop.reason is None:
            trace["failed_at"] = self._failed_at
            trace["reason"] = f"{self._reason} ({self.backtracks} backtracks)"
        return Solution(plan, trace=trace)


def _describe_conflict(steps: Sequence[Transition], name: str) -> str:
    """Return the reason why a choice has no successor."""
    if not steps:
        return f"nothing is feasible after {name}"
    names = list(dict.fromkeys(step.skill.name for step in steps))
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"nothing that {name} occupies is shared by {', '.join(names[:_MOST_NAMED])}{more}"


def _get_held(step: Transition) -> frozenset[str]:
    """Return the resources of a choice."""
    case = step.skill.case(step.state)
    return frozenset() if case is None else case.occupies


def _has_common(step: Transition, held: frozenset[str]) -> bool:
    """Return True if a choice shares a resource with the one before; the first choice is free."""
    occupied = _get_held(step)
    return not held or not occupied or bool(held & occupied)
