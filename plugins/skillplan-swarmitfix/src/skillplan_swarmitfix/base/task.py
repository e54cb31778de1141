"""Walking the base from one position to another: one task for every goal of the base.

Veeramani and Muthuswamy, section 4.1.2: the states are the positions of the bench, the actions
B0 to B10 are swings, and the reward is that of Eqs 6 and 7. Every action is one skill whose
effect depends on where the base stands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from skillplan.task.cost import CaseCost, ConstantCost, Cost
from skillplan.task.reward import DistanceReward
from skillplan.task.scene import Scene
from skillplan.task.skill import Case, Outcome, Skill
from skillplan.task.state import Condition, Facts
from skillplan.task.task import Metric, Place, Task
from skillplan_swarmitfix.bench.bench import Bench

STEPS = Metric("steps", "steps", 0)


def at(position: str) -> str:
    """Return the fact that the base stands at a position."""
    return f"at({position})"


class BaseGrounding:
    """What the base tasks of one bench share.

    Parameters
    ----------
    bench
        The lattice.
    swing_s
        Time of a swing [s] by its angle [deg].
    step_limit
        The most swings of a plan, >= 1; None for as many as a path round the whole bench takes.
    """

    def __init__(
        self, bench: Bench, swing_s: Mapping[int, float], step_limit: int | None = None
    ) -> None:
        self.bench = bench
        self.step_limit = step_limit or max(100, 2 * (bench.rows + bench.cols))
        names = tuple(at(bench.name(i)) for i in range(bench.n_positions))
        self.facts = Facts(names, exclusive=(names,) if len(names) > 1 else ())
        self.states = tuple(self.facts.state(1 << i) for i in range(bench.n_positions))
        self.places = {
            fact: Place(bench.name(i), (float(x_m), float(y_m), 0.0))
            for i, (fact, (x_m, y_m)) in enumerate(zip(names, bench.centroids_m, strict=True))
        }
        self.skills = tuple(self._skill(action, swing_s) for action in range(bench.actions))

    def task(self, name: str, start: int, goal: int, sha256: str = "") -> Task:
        """Return the task of walking from `start` to `goal`, both positions from 0."""
        bench = self.bench
        distances_m = [math.dist(point, bench.centroids_m[goal]) for point in bench.centroids_m]
        return Task(
            name=name,
            kind="swarmitfix",
            facts=self.facts,
            skills=self.skills,
            initial=self.states[start],
            goal=Condition(self.states[goal], self.facts.none),
            metric=STEPS,
            step_limit=self.step_limit,
            scene=Scene((), ()),
            reward=DistanceReward(
                {1 << i: distance_m for i, distance_m in enumerate(distances_m)},
                complete=1.0,
                # The paper does not give the reward of a swing off the bench: as if it led
                # farther from the goal than any position.
                infeasible=-1.0 - max(distances_m),
            ),
            sha256=sha256,
            starts=self.states,
            stage="base",
            places=self.places,
        )

    def _skill(self, action: int, swing_s: Mapping[int, float]) -> Skill:
        bench, none = self.bench, self.facts.none
        cases: list[Case] = []
        times_s: dict[int, float] = {}
        for start, end in enumerate(bench.successors[:, action].tolist()):
            if end < 0:
                continue
            here, there = self.states[start], self.states[end]
            outcome = Outcome(1.0, there, here if start != end else none)
            pins = frozenset(bench.pin_name(pin) for pin in bench.swept_pins(start, action))
            cases.append(Case(here, (outcome,), none, pins))
            times_s[here.bits] = swing_s[int(bench.swing_deg[start, action])] if action else 0.0
        off_bench = self.facts.state(self.facts.all_bits & ~sum(times_s))
        duration_s: Cost = CaseCost(times_s) if times_s else ConstantCost(0.0)
        return Skill(
            name=f"B{action}",
            kind="stay" if action == 0 else "swing",
            agents=("base",),
            precondition=Condition(none, off_bench),
            outcomes=() if cases else (Outcome(1.0, none, none),),
            cost=ConstantCost(1.0),
            duration_s=duration_s,
            parameters={"action": f"B{action}"},
            cases=tuple(cases),
        )
