"""The hierarchy of one trajectory: heads, goals of the base, paths of the base.

Veeramani and Muthuswamy, Fig. 3. Each level is grounded from the plan of the one above; a level
without a solution is represented by its proved optimum, so that the whole chain can be
looked at before anything is solved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache

from skillplan.task.task import BackEndChoice, Task
from skillplan_swarmitfix.base.goal_choice import Choice, GoalRule, choose
from skillplan_swarmitfix.base.goals import (
    GoalSet,
    MachineReach,
    PathBetween,
    ReachRules,
    UnreachableSupport,
    goal_sets,
    inward_side,
    last_goal_set,
    preferring,
    unreachable,
)
from skillplan_swarmitfix.base.goals_task import goal_of, goals_task
from skillplan_swarmitfix.base.locomotion import BaseGrounding
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.fleet.task import fleet_task
from skillplan_swarmitfix.heads.heads import Head, HeadRules, even_heads, path_between, vertex_heads
from skillplan_swarmitfix.heads.task import (
    Holdable,
    fewest,
    has_holdable_heads,
    head_task,
    heads_of,
    segment_fault,
)
from skillplan_swarmitfix.machine_settings import bench_of, limits_of, mount_of, timings_of
from skillplan_swarmitfix.pkm.kinematics import PkmGeometry
from skillplan_swarmitfix.pkm.reach import (
    Mount,
    PkmLimits,
    Range,
    ReachableCentres,
    horizontal_reach_m,
)
from skillplan_swarmitfix.schema import PLANNED_REACH_M, SwarmitfixConfig
from skillplan_swarmitfix.trajectory.faults import find_meetings
from skillplan_swarmitfix.trajectory.path_elements import (
    Line,
    Point2,
    sample,
    sampling_error_m,
    shown,
)
from skillplan_swarmitfix.trajectory.schema import elements_of
from skillplan_swarmitfix.trajectory.workpiece import CORNER_RAD, Segment, Workpiece

Plans = Mapping[str, Sequence[str]]
GOALS = "goals"
MOST_SHOWN = 3
"""So many crossings are listed in a note."""


class Job:
    """The job of a valid file, given the plans found so far.

    Parameters
    ----------
    config
        The file's content, without issues.
    plans
        Names of skills by task; a level without plans stands in with its optimum.
    refinement
        Number of times the heads moved closer together, >= 0: every segment is divided that
        many times more, or the permitted gap divided by it.

    Attributes
    ----------
    bench, timings
        The lattice, and how long the steps take.
    """

    def __init__(
        self, config: SwarmitfixConfig, plans: Plans | None = None, refinement: int = 0
    ) -> None:
        self.config = config
        self.parts = 1 + refinement
        self.plans: Plans = plans or {}
        self.bench = bench_of(config)
        self.timings = timings_of(config)

    @cached_property
    def workpiece(self) -> Workpiece:
        """The trajectory, split into segments."""
        assert self.config.trajectory is not None
        trajectory = self.config.trajectory
        start, elements = elements_of(trajectory)
        # The elements of `path` are segments as the user writes them; subdivisions count segments.
        is_resampled = trajectory.file is not None or trajectory.vertices_m is not None
        planned = self.config.heads.subdivisions is None
        return Workpiece.from_elements(
            start,
            elements,
            closed=trajectory.closed,
            chord_tolerance_m=trajectory.chord_tolerance_m,
            corner_rad=CORNER_RAD if is_resampled and planned else None,
        )

    @cached_property
    def sampling(self) -> tuple[int, float]:
        """Number of chords that stand for curves, and their greatest distance from these [m]."""
        trajectory = self.config.trajectory
        assert trajectory is not None
        start, elements = elements_of(trajectory)
        starts = [start, *(element.end for element in elements)]
        tolerance_m = trajectory.chord_tolerance_m
        chords = sum(
            len(sample(begin, element, tolerance_m))
            for begin, element in zip(starts, elements, strict=False)
            if not isinstance(element, Line)
        )
        off_m = [
            sampling_error_m(*pair, tolerance_m) for pair in zip(starts, elements, strict=False)
        ]
        most_m = max(off_m, default=0.0)
        if chords and (trajectory.file or "").lower().endswith(".dxf"):
            # The reader puts its own curves through points of the drawing's.
            from skillplan_swarmitfix.trajectory.dxf_entities import CURVE_TOLERANCE_M

            most_m += CURVE_TOLERANCE_M
        return chords, most_m

    @property
    def sampling_text(self) -> str:
        """The same in words; empty for a trajectory without curves."""
        chords, off_m = self.sampling
        return (
            f"curves sampled to {chords} chords, at most {off_m * 1e3:.2g} mm off" if chords else ""
        )

    @cached_property
    def meetings(self) -> list[Point2]:
        """Points at which the trajectory crosses or touches itself [m]."""
        trajectory = self.config.trajectory
        assert trajectory is not None
        start, elements = elements_of(trajectory)
        return find_meetings(
            start, elements, trajectory.chord_tolerance_m, closed=trajectory.closed
        )

    @property
    def trajectory_notes(self) -> list[str]:
        """Everything that was assumed or left out of the trajectory's file, and crossings."""
        assert self.config.trajectory is not None
        notes = list(self.config.trajectory.notes)
        if self.meetings:
            places = ", ".join(map(shown, self.meetings[:MOST_SHOWN]))
            more = len(self.meetings) - MOST_SHOWN
            notes.append(
                f"crosses or touches itself at {places}" + (f" and {more} more" if more > 0 else "")
            )
        return notes

    @cached_property
    def head_rules(self) -> HeadRules:
        """Rules for placing heads."""
        heads = self.config.heads
        return HeadRules(
            side_m=heads.side_m,
            max_gap_m=heads.max_gap_m / self.parts,
            step_m=heads.step_m,
            orientations=heads.orientations,
            reorientation_cost=heads.reorientation_cost,
        )

    @cached_property
    def vertex_heads(self) -> tuple[Head, ...]:
        """The heads at the vertices."""
        return vertex_heads(self.workpiece, self.head_rules)

    def ends(self, segment: Segment) -> tuple[Head, Head]:
        """Return the vertex heads between which a segment lies."""
        heads = self.vertex_heads
        return heads[segment.index], heads[(segment.index + 1) % len(heads)]

    @cached_property
    def heads(self) -> tuple[Head, ...]:
        """All heads in order along the trajectory; a closed one does not repeat the first."""
        subdivisions = self.config.heads.subdivisions
        placed: list[Head] = []
        for segment in self.workpiece.segments:
            first, last = self.ends(segment)
            placed.append(first)
            if subdivisions is not None:
                placed += even_heads(segment, subdivisions[segment.index] * self.parts)
                continue
            plan = self.plans.get(head_task_name(segment))
            if plan is None:
                plan = fewest(segment, first, last, self.head_rules, self._holdable(segment))
            placed += heads_of(segment, first, last, self.head_rules, plan)
        if not self.workpiece.closed:
            placed.append(self.vertex_heads[-1])
        return tuple(placed)

    @property
    def supportable(self) -> bool:
        """Return whether every segment can be supported under the head rules and held by a base."""
        if self.config.trajectory is None:
            return False
        if self.config.heads.subdivisions is None:
            for segment in self.workpiece.segments:
                if segment_fault(segment, *self.ends(segment), self.head_rules) is not None:
                    return False
        return not self.infeasible and not self.unreachable()

    @cached_property
    def reach(self) -> ReachRules:
        """Rules for the position of a base at a support."""
        base = self.config.base
        least_m, most_m = base.reach_m or PLANNED_REACH_M
        return ReachRules(
            arm_length_m=base.arm_length_m,
            safe_distance_m=base.safe_distance_m,
            reach_m=(least_m, most_m),
            side=self._side(),
        )

    @property
    def centres(self) -> ReachableCentres:
        """Reach of the machine from every position."""
        limits, mount = limits_of(self.config), mount_of(self.config)
        return _centres(self.bench, limits, mount, tuple(self.distances_m.items()))

    @property
    def distances_m(self) -> dict[str, Range]:
        """Distances of base and head that the file allows if it requires reach [m], by key."""
        base = self.config.base
        if base.reach_rule != "required":
            return {}
        distances_m = {"base.safe_distance_m": (base.safe_distance_m, math.inf)}
        if base.reach_m is not None:
            distances_m["base.reach_m"] = (base.reach_m[0], base.reach_m[1])
        return distances_m

    @property
    def machine(self) -> MachineReach | None:
        """The reach that every position must have; None unless the file requires it."""
        base = self.config.base
        if self.config.trajectory is None or base.reach_rule != "required":
            return None
        return MachineReach(self.centres, base.relax == "always")

    def _holdable(self, segment: Segment) -> Holdable | None:
        """Return whether a base can hold a head at a point; None if heads may lie anywhere.

        They may if reach is not required, or if no row of holdable heads supports the segment.
        """
        if self.machine is None:
            return None
        reach = self.centres.reach
        possible = has_holdable_heads(segment, *self.ends(segment), self.head_rules, reach)
        return reach if possible else None

    @cached_property
    def unheld(self) -> int | None:
        """The first head that must be held and cannot be, from 0; None if there is none."""
        if self.machine is None:
            return None
        reach = self.centres.reach
        return next((i for i, head in enumerate(self.heads) if not reach(head.position)), None)

    @property
    def infeasible(self) -> str:
        """Why no plan exists: the first support out of reach; empty if there is none.

        An intermediate head is out of reach only if no row of heads in reach supports its segment.
        """
        if self.unheld is None:
            return ""
        head = self.heads[self.unheld]
        position, verdict = self.centres.nearest(head.position)
        return (
            f"support {self.unheld + 1} of {len(self.heads)}, at {shown(head.position)}, is beyond "
            f"the legs from every position: {self.bench.name(position)} comes nearest, and there "
            f"{verdict.reason}"
        )

    def _side(self) -> int:
        """Return +1 for bases to the left of the direction of travel, -1 for the right."""
        side = self.config.base.side
        if side in ("left", "right"):
            return 1 if side == "left" else -1
        inward = inward_side(self.workpiece.clockwise or False)
        return -inward if side == "outward" else inward

    @cached_property
    def goal_sets(self) -> tuple[GoalSet, ...]:
        """The positions that can hold each support."""
        closed, machine = self.workpiece.closed, self.machine
        sets = goal_sets(self.bench, self._supports, self.reach, closed, self._path, machine)
        if not closed:
            last = len(self.heads) - 1
            sets = (*sets, last_goal_set(self.bench, self.reach, sets[-1], last, machine))
        if self.config.base.reach_rule == "preferred":
            sets = tuple(preferring(goal_set, self.centres) for goal_set in sets)
        return sets

    @cached_property
    def pkm_reach_m(self) -> tuple[float, float]:
        """Horizontal distances of base and head that the limits of the legs allow [m].

        Raises
        ------
        ValueError
            If they allow none.
        """
        return _reach_m(limits_of(self.config), mount_of(self.config))

    def unreachable(self) -> tuple[UnreachableSupport, ...]:
        """Return every pair of supports that no position serves; none if reach is required."""
        if self.machine is not None:
            return ()
        closed = self.workpiece.closed
        return unreachable(self.bench, self._supports, self.reach, closed, self._path)

    @property
    def _supports(self) -> list[Point2]:
        return [head.position for head in self.heads]

    @property
    def _path(self) -> PathBetween:
        return path_between(self.workpiece, self.heads)

    @cached_property
    def choice(self) -> Choice:
        """The goals of the base by the file's rule."""
        return self._choose(self.config.base.goal_choice)

    def _choose(self, rule: str) -> Choice:
        return choose(self.bench, self.home, self.goal_sets, rule, self.timings.swing_s)

    @cached_property
    def least_steps(self) -> int:
        """No choice of goals takes fewer swings in all."""
        if self.choice.rule is GoalRule.WHOLE_TRAJECTORY:
            return self.choice.total_steps
        return self._choose(GoalRule.WHOLE_TRAJECTORY).total_steps

    @cached_property
    def goals(self) -> tuple[int, ...]:
        """The goals of the base: as given, as planned, or by the file's rule."""
        if self.config.base.goals is not None:
            return tuple(self.bench.position(name) for name in self.config.base.goals)
        plan = self.plans.get(GOALS)
        if plan is None:
            return self.choice.goals
        return tuple(self.bench.position(goal_of(name)) for name in plan)

    @property
    def robots(self) -> dict[str, tuple[int, int]]:
        """First and last position of every robot; empty where there is one base only."""
        position = self.bench.position
        robots = self.config.robots or {}
        return {name: (position(ends.home), position(ends.goal)) for name, ends in robots.items()}

    @property
    def home(self) -> int:
        """Initial position of the base."""
        return self.bench.position(self.config.base.home)

    def tasks(self, sha256: str) -> list[Task]:
        """Return the chain: heads of every segment, goals, and a path to every goal."""
        config = self.config
        if config.robots is not None:
            tasks = [
                fleet_task(
                    self.bench,
                    self.robots,
                    self.timings.swing_s,
                    name=config.name,
                    sha256=sha256,
                    step_limit=config.step_limit,
                )
            ]
        else:
            tasks = [] if config.trajectory is None else self._upper_tasks(sha256)
            base = BaseGrounding(self.bench, self.timings.swing_s, config.step_limit)
            goals = () if self.infeasible else self.goals
            tasks += [
                base.task(f"base-{number}", start, goal, sha256)
                for number, (start, goal) in enumerate(
                    zip((self.home, *goals), goals, strict=False), start=1
                )
            ]
        physics = [BackEndChoice(name, options or {}) for name, options in config.physics.items()]
        collision = [
            BackEndChoice(name, options or {}) for name, options in config.collision.items()
        ]
        return [
            task.replace(
                physics=physics[0] if physics else None, collision=tuple(collision), sha256=sha256
            )
            for task in tasks
        ]

    def _upper_tasks(self, sha256: str) -> list[Task]:
        tasks = []
        if self.config.heads.subdivisions is None:
            for segment in self.workpiece.segments:
                first, last = self.ends(segment)
                name = head_task_name(segment)
                tasks.append(
                    head_task(
                        segment,
                        first,
                        last,
                        self.head_rules,
                        name=name,
                        sha256=sha256,
                        holdable=self._holdable(segment),
                    )
                )
        tasks.append(
            goals_task(
                self.bench,
                self.home,
                () if self.infeasible else self.goal_sets,
                self.timings.swing_s,
                None if self.infeasible else self.choice.goals,
                name=GOALS,
                sha256=sha256,
                infeasible=self.infeasible,
            )
        )
        return tasks


@lru_cache(maxsize=16)
def _centres(
    bench: Bench, limits: PkmLimits, mount: Mount, distances_m: tuple[tuple[str, Range], ...]
) -> ReachableCentres:
    """Return the reach of every position; the jobs of a chain share it."""
    return ReachableCentres(PkmGeometry(), limits, mount, bench.centroids_m, dict(distances_m))


@lru_cache(maxsize=64)
def _reach_m(limits: PkmLimits, mount: Mount) -> Range:
    """Return the reach of the machine, which takes a quarter of a second to find."""
    return horizontal_reach_m(PkmGeometry(), limits, mount)


def head_task_name(segment: Segment) -> str:
    """Return the name of the task of placing the heads of a segment."""
    return f"heads-{segment.index + 1}"
