"""Several bases on one bench: all of them have to reach their goals, and share the pins.

No pin may be docked or swept by two bases at once. A swing sweeps its pivot and every
neighbour of the pivot from its old to its new legs. A plan is a sequence of swings; what may run
at the same time follows from the pins that each occupies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

from skillplan.task.cost import CaseCost, ConstantCost
from skillplan.task.scene import Scene
from skillplan.task.skill import Case, Outcome, Skill
from skillplan.task.state import Condition, Facts
from skillplan.task.task import Metric, Place, Task
from skillplan_swarmitfix.bench.bench import Bench

Fault = tuple[str, tuple[str | int, ...]]
"""A message, and the keys from the root of the document to the fault."""
FEWEST_ROBOTS, MOST_ROBOTS = 2, 8
SWINGS = Metric("swings", "swings", 0)
_SWINGS_A_ROBOT = 250


def robot_at(robot: str, position: str) -> str:
    """Return the fact that a robot's base stands at a position."""
    return f"at({robot},{position})"


def fleet_faults(bench: Bench, robots: Mapping[str, tuple[int, int]]) -> list[Fault]:
    """List the faults of the robots of a task, each with its path.

    Parameters
    ----------
    bench
        The lattice.
    robots
        First and last position of each, both from 0.
    """
    faults: list[Fault] = []
    if not FEWEST_ROBOTS <= len(robots) <= MOST_ROBOTS:
        message = (
            f"a fleet has {FEWEST_ROBOTS} to {MOST_ROBOTS} robots, not {len(robots)}. "
            "Use base.goals or a trajectory for a single one."
        )
        faults.append((message, ("robots",)))
    for end, (key, verb) in enumerate((("home", "start"), ("goal", "end"))):
        known = {}
        for robot, positions in robots.items():
            position = positions[end]
            if 0 <= position < bench.n_positions:
                known[robot] = position
            else:
                message = (
                    f"{robot} cannot {verb} at position {position + 1}: the bench has "
                    f"{bench.name(0)} to {bench.name(bench.n_positions - 1)}."
                )
                faults.append((message, ("robots", robot, key)))
        for (name, first), (other, second) in combinations(known.items(), 2):
            shared = sorted(set(bench.legs[first].tolist()) & set(bench.legs[second].tolist()))
            if shared:
                message = _overlap(bench, (name, other), (first, second), shared, verb)
                faults.append((message, ("robots", other, key)))
    return faults


def _overlap(
    bench: Bench,
    robots: tuple[str, str],
    positions: tuple[int, int],
    shared: Sequence[int],
    verb: str,
) -> str:
    """Say that two robots would dock the same pins."""
    pins = ", ".join(bench.pin_name(pin) for pin in shared)
    if positions[0] == positions[1]:
        where = f"both {verb} at {bench.name(positions[0])}"
    else:
        where = (
            f"{verb} at {bench.name(positions[0])} and {bench.name(positions[1])}, which share "
            f"{'pin' if len(shared) == 1 else 'pins'} {pins}"
        )
    return f"{robots[0]} and {robots[1]} {where}. Choose positions without a common pin."


def fleet_task(
    bench: Bench,
    robots: Mapping[str, tuple[int, int]],
    swing_s: Mapping[int, float],
    *,
    name: str,
    sha256: str = "",
    step_limit: int | None = None,
) -> Task:
    """Return the task of bringing every robot from its first to its last position.

    Parameters
    ----------
    bench
        The lattice.
    robots
        First and last position of each robot, both from 0.
    swing_s
        Time of a swing [s] by its angle [deg].
    name
        The task's name.
    sha256
        Hash of the task file.
    step_limit
        The most swings of a plan, >= 1; None for 250 for every robot.

    Raises
    ------
    ValueError
        If the robots are not as `fleet_faults` wants them.
    """
    faults = fleet_faults(bench, robots)
    if faults:
        raise ValueError(f"Task {name!r}: {faults[0][0]}")
    return _Grounding(bench, robots, swing_s).task(
        name, sha256, step_limit or _SWINGS_A_ROBOT * len(robots)
    )


class _Grounding:
    """Data shared by the skills of one task.

    Robot k's position p is bit ``k * n_positions + p``.
    """

    def __init__(
        self, bench: Bench, robots: Mapping[str, tuple[int, int]], swing_s: Mapping[int, float]
    ) -> None:
        self.bench = bench
        self.robots = robots
        self.swing_s = swing_s
        self.names = [bench.name(position) for position in range(bench.n_positions)]
        groups = tuple(tuple(robot_at(robot, name) for name in self.names) for robot in robots)
        self.facts = Facts(tuple(fact for group in groups for fact in group), exclusive=groups)
        self.shifts = [k * bench.n_positions for k in range(len(robots))]
        self.docking = [0] * bench.n_pins
        for position, legs in enumerate(bench.legs.tolist()):
            for pin in legs:
                self.docking[pin] |= 1 << position
        self.swings = [self._swings(action) for action in range(1, bench.actions)]

    def task(self, name: str, sha256: str, step_limit: int) -> Task:
        """Return the task."""
        facts, robots = self.facts, self.robots
        ends = [
            sum(
                1 << shift + positions[end]
                for shift, positions in zip(self.shifts, robots.values(), strict=True)
            )
            for end in (0, 1)
        ]
        skills = (
            self._skill(robot, k, action)
            for k, robot in enumerate(robots)
            for action in range(1, self.bench.actions)
            if self.swings[action - 1]
        )
        return Task(
            name=name,
            kind="swarmitfix",
            facts=facts,
            skills=tuple(skills),
            initial=facts.state(ends[0]),
            goal=Condition(facts.state(ends[1]), facts.none),
            metric=SWINGS,
            step_limit=step_limit,
            scene=Scene((), ()),
            sha256=sha256,
            stage="base",
            places=self._places(),
        )

    def _places(self) -> dict[str, Place]:
        return {
            robot_at(robot, name): Place(name, (float(x_m), float(y_m), 0.0))
            for robot in self.robots
            for name, (x_m, y_m) in zip(self.names, self.bench.centroids_m, strict=True)
        }

    def _swings(self, action: int) -> list[tuple[int, int, int, frozenset[str]]]:
        """Return start, end, positions that dock a swept pin, and swept pins of an action."""
        swings = []
        for start, end in enumerate(self.bench.successors[:, action].tolist()):
            if end < 0:
                continue
            swept = self.bench.swept_pins(start, action)
            docking = 0
            for pin in swept:
                docking |= self.docking[pin]
            pins = frozenset(self.bench.pin_name(pin) for pin in swept)
            swings.append((start, end, docking, pins))
        return swings

    def _skill(self, robot: str, k: int, action: int) -> Skill:
        facts, shift = self.facts, self.shifts[k]
        cases, times_s = [], {}
        for start, end, docking, pins in self.swings[action - 1]:
            here, there = facts.state(1 << shift + start), facts.state(1 << shift + end)
            others = sum(docking << other for other in self.shifts if other != shift)
            outcome = Outcome(1.0, there, here)
            cases.append(Case(here, (outcome,), facts.state(others), pins))
            times_s[here.bits] = self.swing_s[int(self.bench.swing_deg[start, action])]
        return Skill(
            name=f"{robot}.B{action}",
            kind="swing",
            agents=(robot,),
            precondition=Condition(facts.none, facts.none),
            outcomes=(),
            cost=ConstantCost(1.0),
            duration_s=CaseCost(times_s),
            parameters={"robot": robot, "action": f"B{action}"},
            cases=tuple(cases),
        )
