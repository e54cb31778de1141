"""Grounding of an assembly file: its scene, skills, costs and goal.

The five skills are listed in Table I of Moller et al.: pick, place, load, offload, fasten. A skill
costs the planar distance from the end of the skill before to its own goal (section 4.2), or its
duration; the file's speeds and dwell times apply if no back end provides times. A failed grasp
leaves the part in place. If the arm then goes to look for the part, the next skill pays for that
path as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from skillplan.domains.assembly import vocabulary
from skillplan.domains.assembly.cost_schema import (
    CostConfig,
    compute_fixed_cost,
    make_metric,
    weigh_cost,
)
from skillplan.domains.assembly.feeding import add_waits, find_supply
from skillplan.domains.assembly.gripping import choose_tool_kind, describe_candidates, list_grasps
from skillplan.domains.assembly.holding import name_direction
from skillplan.domains.assembly.insertion import (
    list_buffer_visits,
    list_directions,
    list_pick_visits,
    list_place_visits,
    turn_place_visit,
)
from skillplan.domains.assembly.layout import get_layout
from skillplan.domains.assembly.part_schema import FitConfig, PartConfig
from skillplan.domains.assembly.resting import find_bearers
from skillplan.domains.assembly.schema import AssemblyConfig, choose_variant
from skillplan.domains.assembly.schema_types import find_dwell_s, list_given_kinds, make_point
from skillplan.domains.assembly.screw_holes import find_driving, find_shank, list_asides_m
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.domains.assembly.vocabulary import CHANGED_TOOL, FIXED, HAND_FREE, HOME, NO_TOOL
from skillplan.domains.assembly.workholding import (
    Orientation,
    build_holders,
    build_workholders,
    list_fixture_placements,
    list_holds,
    list_insertion_orientations,
    list_orientations,
    list_ties,
    list_turn_needs,
    list_turn_origins,
    list_turn_targets,
    name_holding,
    name_open,
    name_turned,
    turn_placements,
    turn_pose,
    turn_visit,
)
from skillplan.domains.assembly.works import find_work_orientation, list_work_points
from skillplan.domains.assembly.zone_faults import list_closed_goals
from skillplan.task.cost import (
    ConstantCost,
    Cost,
    DistanceCost,
    WeightedCost,
    compute_planar_distance,
)
from skillplan.task.motion import Event, Motion, Point, Route, Visit
from skillplan.task.pose import unit
from skillplan.task.reward import Penalty, RewardScheme
from skillplan.task.scene import (
    STANDARD_CUP_M,
    Body,
    Fit,
    Placement,
    Pose,
    Robot,
    Scene,
    Tool,
    ToolKind,
)
from skillplan.task.shape import Box
from skillplan.task.skill import Case, Outcome, Skill, Supply, Way
from skillplan.task.state import Condition, Facts
from skillplan.task.task import BackEndChoice, Literal, Pool, Precedence, Task
from skillplan.task.zone import SlowTravel

MOST_STEPS = 100_000
"""Greatest step limit of a file."""

# Least stretch along the axis of a screw with a shank [m].
_LEAST_STRETCH_M = 0.05
# Mass of a fixture [kg]: no back end moves it.
_FIXTURE_KG = 1.0
# Greatest number of travels across the cell that one operation needs: to a buffer and back, with a
# change of tools and a turn.
_CROSSINGS = 8
# Greatest probability that a part is left behind after all tries that the step limit allows.
_LEFT_BEHIND = 1e-3


def _measure_path(points: Sequence[Point]) -> float:
    return sum(math.dist(begin, end) for begin, end in pairwise(points))


def ground(config: AssemblyConfig, sha256: str) -> Task:
    """Return the task of an assembly without faults."""
    return _Grounding(config).build_task(sha256)


class _Grounding:
    """Data that the skills of one task share."""

    def __init__(self, config: AssemblyConfig) -> None:
        self.config = config
        self.layout = get_layout(config)
        # A list of actions says itself which of them there are.
        self.closed = {} if config.actions else list_closed_goals(config)
        self.facts: Facts = vocabulary.list_facts(config)
        self.beneath = {name: find_bearers(config, name) for name in config.parts}
        self.positions = self._list_positions()
        self.places = {self.facts.bit(f"at({name})"): p for name, p in self.positions.items()}
        self.drivings = {name: find_driving(config, name) for name in config.screws}
        self.stands = self.facts.of(*(f"at({name})" for name in self.positions))
        self.slow = self._build_slow_travel()
        self.behind_m = {
            self.facts.bit(f"at({part}.missed)"): compute_planar_distance(
                self.layout.start(part).pose.position, self.positions[f"{part}.missed"]
            )
            for part in vocabulary.list_missed_parts(config)
        }
        self.slow_behind_m = self._add_slow_travel(self.behind_m)
        # Costs in order weigh a count by what comes last.
        self.most = self._estimate_most(config.cost[-1]) if isinstance(config.cost, list) else 0.0

    def _add_slow_travel(self, behind_m: Mapping[int, float]) -> Mapping[int, float]:
        """Return the paths of failed grasps, longer by what the tip loses in slow zones [m]."""
        if self.slow is None:
            return behind_m
        longer_m = dict(behind_m)
        for part in vocabulary.list_missed_parts(self.config):
            start, look = self.layout.start(part).pose.position, self.positions[f"{part}.missed"]
            lost_s = self.slow.cost_s(start, look)
            bit = self.facts.bit(f"at({part}.missed)")
            longer_m[bit] += lost_s * self.config.robot.travel_speed_m_per_s
        return longer_m

    def _build_slow_travel(self) -> SlowTravel | None:
        """Return the additional time of travels at safe height through zones, or None."""
        robot = self.config.robot
        zones = [zone.build(name) for name, zone in self.config.zones.items()]
        slow = [
            zone
            for zone in zones
            if zone.speed_m_per_s is not None and zone.low_m < robot.safe_height_m < zone.high_m
        ]
        return SlowTravel(slow, 1 / robot.travel_speed_m_per_s) if slow else None

    def _estimate_most(self, last: str) -> float:
        """Return about the most time or path of a plan that does each operation once [s or m].

        The latest part arrives before the first operation. Before each one the arm changes tools,
        turns all workholders, and crosses the cell; then holders close and open.
        """
        config = self.config
        paths_m = {name: list_work_points(config, name) for name in config.works}
        count = len(config.moved_parts) + len(config.screws) + len(config.works)
        lows, highs = (
            [choose(axis) for axis in zip(*self.positions.values(), strict=True)]
            for choose in (min, max)
        )
        travels_m = _CROSSINGS * count * math.dist(lows, highs)
        if last == "distance":
            return travels_m + sum(_measure_path(points) for points in paths_m.values())

        def dwell_s(kind: str, *owners: PartConfig | ScrewConfig) -> float:
            tools = {tool for owner in owners for tool in owner.tools} or config.carriers
            return max(
                find_dwell_s(kind, config.durations_s, *owners, config.tools[t]) for t in tools
            )

        each_s = dwell_s("load") + dwell_s("offload")
        each_s += sum(entry.takes_s for entry in config.workholders.values())
        most_s = max((part.arrives_s or 0.0 for part in config.parts.values()), default=0.0)
        most_s += count * each_s
        for part in config.moved_parts.values():
            waits_s = [fit.wait_s or 0.0 for fit in (part.fits or {}).values()]
            visits = 2 if part.buffers else 1
            most_s += visits * (dwell_s("pick", part) + dwell_s("place", part))
            most_s += max(waits_s, default=0.0)
        for name, screw in config.screws.items():
            variants = [choose_variant(config, name, tool=tool) for tool in screw.tools]
            most_s += max(find_driving(variant, name).takes_s for variant in variants)
            most_s += dwell_s("fetch", screw)
        for name, work in config.works.items():
            most_s += work.dwell_s + _measure_path(paths_m[name]) / work.speed_m_per_s
        for holder in config.holders.values():
            most_s += 2 * len(holder.parts) * holder.takes_s
        speeds = [zone.speed_m_per_s for zone in config.zones.values()]
        slowest = min([config.robot.travel_speed_m_per_s, *filter(None, speeds)])
        return most_s + travels_m / slowest

    def build_task(self, sha256: str) -> Task:
        """Return the task."""
        config, facts = self.config, self.facts
        skills = {skill.name: skill for skill in self._list_skills()}
        if any(feeder.cycle_s for feeder in config.feeders.values()):
            skills = add_waits(config, skills, facts)
        order = config.actions or [n for n in vocabulary.list_actions(config) if n in skills]
        operations = {
            **{name: f"placed({name})" for name in config.moved_parts},
            **{name: f"fastened({name})" for name in config.screws},
        }
        needed = [name for name in operations if not _get_component(config, name).optional]
        works = [vocabulary.name_work(config, name)[1] for name in config.works]
        goal = config.goal or [*(operations[name] for name in needed), *works]
        return Task(
            name=config.name,
            kind=config.kind,
            facts=facts,
            skills=tuple(skills[name] for name in order),
            initial=facts.of(*_list_initial(config)),
            goal=Condition(facts.of(*goal), facts.none),
            metric=make_metric(config.cost, self.most),
            step_limit=choose_step_limit(config),
            scene=_build_scene(config, {f"at({name})": p for name, p in self.positions.items()}),
            reward=self._build_reward(order),
            observation=tuple(
                Literal(*vocabulary.split_literal(text)) for text in config.observation or ()
            ),
            operations=operations,
            chart=tuple(_list_precedences(config)),
            physics=next(
                (BackEndChoice(name, options or {}) for name, options in config.physics.items()),
                None,
            ),
            collision=tuple(
                BackEndChoice(name, options or {}) for name, options in config.collision.items()
            ),
            sha256=sha256,
            dwells_from=self._list_dwell_sources(),
            pools=_list_pools(config),
            covered=None
            if config.product_parts is None
            else (config.component_count, config.product_parts),
            notes=self._list_notes(),
        )

    def _list_notes(self) -> dict[str, tuple[str, ...]]:
        """Return refused grasps, times of arrival and goals in closed zones, by skill."""
        notes: dict[str, tuple[str, ...]] = {}
        for name, part in self.config.moved_parts.items():
            if part.grasp == "auto":
                _, refused = describe_candidates(self.config, name)
                words = tuple(f"grasp: auto refuses {reason}" for reason in refused)
                notes |= {f"{verb}({name})": words for verb in ("pick", "place") if words}
        for name, part in self.config.moved_parts.items():
            if part.arrives_s:
                arrives = f"{name} arrives after {part.arrives_s:g} s: the arm waits until then"
                notes[f"pick({name})"] = (*notes.get(f"pick({name})", ()), arrives)
        for (name, label), reason in self.closed.items():
            left_out = f"place({name}{label}) is left out: {reason}"
            notes[f"pick({name})"] = (*notes.get(f"pick({name})", ()), left_out)
        return notes

    def _list_dwell_sources(self) -> tuple[str, ...]:
        """Return the key paths of all dwell times that apply, the task's own last."""
        sections = {name: getattr(self.config, name) for name in ("parts", "screws", "tools")}
        owners = ((f"{s}.{n}", owner) for s, all_ in sections.items() for n, owner in all_.items())
        paths = [
            f"{path}.durations_s.{kind}"
            for path, owner in owners
            for kind in list_given_kinds(owner)
        ]
        driven = [
            f"screws.{name}: {driving.source}"
            for name, driving in self.drivings.items()
            if driving.is_computed
        ]
        return (*paths, *driven, "durations_s")

    def _list_positions(self) -> dict[str, Point]:
        """Return the position of every place [m], in the order of the vocabulary."""
        config, layout = self.config, self.layout
        home = (config.robot.home_m[0], config.robot.home_m[1], config.robot.safe_height_m)
        positions: dict[str, Point] = {HOME: home}
        for part in config.moved_parts:
            positions[vocabulary.name_start(config, part)] = layout.start(part).pose.position
            for option in vocabulary.list_place_options(config, part):
                if option.done == part:
                    where = choose_variant(config, part, option.label)
                    pose = get_layout(where).goal(part).pose
                    for turn in list_insertion_orientations(config, part):
                        at = turn_pose(pose, turn.motion).position
                        positions[f"{option.place}{turn.label}"] = at
        for part, buffers in vocabulary.list_buffered(config).items():
            start = layout.start(part).pose.position
            there: dict[str | None, Point] = {None: start}
            there |= {buffer: layout.buffered(part, buffer).pose.position for buffer in buffers}
            known = {f"{part}.{buffer}": there[buffer] for buffer in buffers}
            known |= {name: there[at] for name, at, _ in vocabulary.list_picks(config, part)}
            for place in vocabulary.list_pick_places(config, part):
                positions[place] = known[place]
        for name, tool in config.carriers.items():
            positions[f"{name}.holder"] = tool.holder
        for name, screw in config.screws.items():
            for turn in list_insertion_orientations(config, name):
                mouth = turn_pose(Pose(layout.hole(screw)), turn.motion).position
                positions[f"{name}{turn.label}"] = mouth
        for name in config.works:
            positions[name] = list_work_points(config, name)[-1]
        for part in vocabulary.list_missed_parts(config):
            positions[f"{part}.missed"] = config.robot.look
        for name, workholder in config.workholders.items():
            if workholder.stand_m is not None:
                x_m, y_m = workholder.stand_m
                stand = (x_m, y_m, config.robot.safe_height_m)
                positions[vocabulary.name_turn_stand(config, name)] = stand
        return positions

    def _list_skills(self) -> Iterator[Skill]:
        """Yield all skills: picks and places, tool changes, fastenings, turns, and holds."""
        buffered = vocabulary.list_buffered(self.config)
        for name, part in self.config.moved_parts.items():
            if part.made_of:
                yield self._build_join(name, part.made_of)
            if name in buffered:
                yield from self._build_buffered(name, buffered[name])
                continue
            options = vocabulary.list_place_options(self.config, name)
            for label, tool in vocabulary.list_tool_labels(part):
                yield self._build_pick(name, label, tool)
                for option in options:
                    if (name, option.label) in self.closed:
                        continue
                    for turn in list_insertion_orientations(self.config, name):
                        yield self._build_place(name, option, turn, label, tool)
        for tool in self.config.carriers:
            if self.config.tool_change.style == "separate":
                yield self._build_offload(tool)
                yield self._build_load(tool)
            else:
                yield self._build_swap(tool)
        for name, screw in self.config.screws.items():
            for turn in list_insertion_orientations(self.config, name):
                for label, tool in vocabulary.list_tool_labels(screw):
                    yield self._build_fasten(name, turn, label, tool)
        for name in self.config.works:
            yield self._build_work(name)
        for name in self.config.workholders:
            for orientation in list_turn_targets(self.config, name):
                yield self._build_turn(name, orientation)
        for holder, held, label in list_holds(self.config):
            yield from self._build_holds(holder, held, label)

    def _build_skill(
        self,
        kind: str,
        subject: str,
        *,
        requires: Sequence[str],
        add: Sequence[str],
        delete: Sequence[str],
        ends_at: str,
        routes: Mapping[str | None, Sequence[Visit]],
        parameters: Mapping[str, str],
        forbids: Sequence[str] = (),
        ways: Sequence[tuple[str, Visit | tuple[Visit, ...] | Mapping[str | None, Visit]]] = (),
        carries: str | None = None,
        failure: float = 0.0,
        failed_at: str = "",
        supply: Supply | None = None,
    ) -> Skill:
        """Return a skill whose cost is the path or the time from the place before.

        Parameters
        ----------
        routes
            Visits of the arm by the fact that selects them; None for a single route.
        parameters
            Objects of the skill by role, for people and engines.
        ways
            All visits, or sequences of them, with their labels if there are several to choose from,
            preferred first; or one for each fact that selects it.
        supply
            When the part that it takes is there; None if it is there from the start.
        failure
            Probability of a failed grasp, in [0, 1): then the arm is at `failed_at`, and nothing
            else changes.
        """
        config, facts = self.config, self.facts
        robot = config.robot.name
        add = [*add, *self._list_single(add)]
        motion = Motion(
            robot,
            tuple(
                Route(facts.none if fact is None else facts.of(fact), tuple(visits))
                for fact, visits in routes.items()
            ),
            carries,
        )
        added = facts.of(*add, f"at({ends_at})")
        deleted = (facts.of(*delete, CHANGED_TOOL) | self.stands) - added
        outcomes = [Outcome(1.0 - failure, added, deleted)]
        if failure:
            there = facts.of(f"at({failed_at})")
            left = (facts.of(CHANGED_TOOL) | self.stands) - there
            outcomes.append(Outcome(failure, there, left))
        distance_m = DistanceCost(self.places, motion, behind_m=self.behind_m)
        duration_s = DistanceCost(
            self.places,
            motion,
            per_m=1 / config.robot.travel_speed_m_per_s,
            dwells=True,
            behind_m=self.slow_behind_m,
            slow=self.slow,
        )
        name = f"{kind}({subject})"
        return Skill(
            name=name,
            kind=kind,
            agents=(robot,),
            precondition=Condition(facts.of(*requires), facts.of(*forbids)),
            outcomes=tuple(outcomes),
            cost=self._choose_cost(kind, name, parameters, distance_m, duration_s),
            duration_s=duration_s,
            motion=motion,
            parameters=parameters,
            ways=tuple(
                Way(label, Motion(robot, self._list_routes(visits), carries))
                for label, visits in ways
            ),
            supply=supply,
        )

    def _choose_cost(
        self,
        kind: str,
        name: str,
        parameters: Mapping[str, str],
        distance_m: Cost,
        duration_s: Cost,
    ) -> Cost:
        """Return the cost of a skill in the task's metric."""
        weights = weigh_cost(self.config.cost, self.most)
        if isinstance(weights, CostConfig):
            fixed = compute_fixed_cost(weights, kind, name, parameters)
            return WeightedCost(distance_m, weights.per_m, duration_s, weights.per_s, fixed)
        return duration_s if weights == "time" else distance_m

    def _list_single(self, added: Sequence[str]) -> list[str]:
        """Return the facts that members of sub-assemblies are bodies by themselves."""
        joined_in = self.config.joined_in
        done = [fact.partition("(") for fact in added] if joined_in else []
        names = [rest[:-1] for kind, _, rest in done if kind in ("placed", "fastened")]
        return [f"single({name})" for name in names if name in joined_in]

    def _list_routes(
        self, visits: Visit | tuple[Visit, ...] | Mapping[str | None, Visit]
    ) -> tuple[Route, ...]:
        facts = self.facts
        by_fact = visits if isinstance(visits, Mapping) else {None: visits}
        return tuple(
            Route(facts.none if fact is None else facts.of(fact), _make_tuple(at))
            for fact, at in by_fact.items()
        )

    def _build_buffered(self, name: str, buffers: Sequence[str]) -> Iterator[Skill]:
        """Yield the skills of a part with buffers, with a pick for each of its grasps."""
        holds = [
            f"grasp({name}.{hold})" if hold else None
            for hold in vocabulary.name_holds(self.config, name)
        ]
        given = [fact for fact in holds if fact is not None]
        for number, pick in enumerate(vocabulary.list_picks(self.config, name)):
            yield self._build_pick_by_hold(name, pick[0], pick[1], holds, number % len(holds))
        for buffer in buffers:
            yield self._select_by(self._build_put(name, buffer, holds), given)
        for turn in list_insertion_orientations(self.config, name):
            yield self._select_by(self._build_place_by_hold(name, turn, holds), given)

    def _build_pick_by_hold(
        self, name: str, pick: str, buffer: str | None, holds: Sequence[str | None], number: int
    ) -> Skill:
        """Return the pick of a part with one of its grasps, from its start or a buffer."""
        part, hold = self.config.parts[name], holds[number]
        start = f"{name}.{buffer}"
        lies, above, failed_at = f"in_buffer({start})", [], start
        if buffer is None:
            start = failed_at = vocabulary.name_start(self.config, name)
            lies = f"at_start({name})"
            above = [n for n in self.config.moved_parts if name in self.beneath[n]]
            if name in vocabulary.list_missed_parts(self.config):
                failed_at = f"{name}.missed"
        return self._build_skill(
            "pick",
            pick,
            requires=[lies, HAND_FREE, vocabulary.name_attached(self.config, part.tool)],
            forbids=[f"at_start({other})" for other in above],
            add=[f"held({name})", *([] if hold is None else [hold])],
            delete=[lies, HAND_FREE],
            ends_at=start if hold is None else pick,
            routes={None: [list_buffer_visits(self.config, name, buffer, Event.GRASP)[number]]},
            parameters={"part": name, "tool": part.tool},
            failure=part.grasp_failure,
            failed_at=failed_at,
            supply=find_supply(self.config, name) if buffer is None else None,
        )

    def _build_put(self, name: str, buffer: str, holds: Sequence[str | None]) -> Skill:
        """Return the skill that puts a part into a buffer."""
        tool = self.config.parts[name].tool
        others = [
            f"in_buffer({other}.{buffer})"
            for other, named in vocabulary.list_buffered(self.config).items()
            if other != name and buffer in named
        ]
        visits = list_buffer_visits(self.config, name, buffer, Event.RELEASE)
        return self._build_skill(
            "place",
            f"{name}.{buffer}",
            requires=[f"held({name})", vocabulary.name_attached(self.config, tool)],
            forbids=others,
            add=[f"in_buffer({name}.{buffer})", HAND_FREE],
            delete=[f"held({name})", *(fact for fact in holds if fact is not None)],
            ends_at=f"{name}.{buffer}",
            routes={hold: [visit] for hold, visit in zip(holds, visits, strict=True)},
            parameters={"part": name, "tool": tool, "buffer": buffer},
            carries=name,
        )

    def _build_place_by_hold(
        self, name: str, turn: Orientation, holds: Sequence[str | None]
    ) -> Skill:
        """Return the placing of a part in an orientation, with a route for each grasp."""
        config, tool = self.config, self.config.parts[name].tool
        placed = [
            turn_place_visit(config, visit, turn.motion)
            for _, visit in list_place_visits(config, name)
        ]
        count = len(placed) // len(holds)
        by_way = [dict(zip(holds, placed[number::count], strict=True)) for number in range(count)]
        labels = [
            f"along {name_direction(direction)}" for direction in list_directions(config, name)
        ]
        return self._build_skill(
            "place",
            f"{name}{turn.label}",
            requires=[
                f"held({name})",
                vocabulary.name_attached(config, tool),
                *self._list_works_before(name),
                *_list_fact(turn),
            ],
            add=[f"placed({name})", HAND_FREE],
            delete=[f"held({name})", *(fact for fact in holds if fact is not None)],
            ends_at=f"{name}.goal{turn.label}",
            routes={hold: [visit] for hold, visit in by_way[0].items()},
            ways=list(zip(labels, by_way, strict=True)) if count > 1 else (),
            parameters={"part": name, "tool": tool},
            carries=name,
        )

    def _select_by(self, skill: Skill, holds: Sequence[str]) -> Skill:
        """Return a skill that is applicable only with one of several grasps, if there are some."""
        none = self.facts.none
        cases = tuple(Case(self.facts.of(hold), skill.outcomes, none) for hold in holds)
        return replace(skill, outcomes=(), cases=cases) if cases else skill

    def _build_pick(self, name: str, label: str, tool: str) -> Skill:
        part = self.config.parts[name]
        start = vocabulary.name_start(self.config, name)
        looks = name in vocabulary.list_missed_parts(self.config)
        above = [n for n in self.config.moved_parts if name in self.beneath[n]]
        visits = self._list_visits(list_pick_visits, name, name, label, tool)
        return self._build_skill(
            "pick",
            f"{name}{label}",
            requires=[f"at_start({name})", HAND_FREE, self._name_attached(tool)],
            forbids=[f"at_start({other})" for other in above],
            add=[f"held({name})"],
            delete=[f"at_start({name})", HAND_FREE],
            ends_at=start,
            routes={None: [visits[0][1]]},
            ways=visits if len(visits) > 1 else (),
            parameters={"part": name, "tool": tool},
            failure=part.grasp_failure,
            failed_at=f"{name}.missed" if looks else start,
            supply=find_supply(self.config, name),
        )

    def _build_place(
        self, name: str, option: vocabulary.PlaceOption, turn: Orientation, label: str, tool: str
    ) -> Skill:
        other = option.done if option.done != name else name
        is_only = len(vocabulary.list_place_options(self.config, name)) == 1
        visits = [
            (words, turn_place_visit(self.config, visit, turn.motion))
            for words, visit in self._list_visits(
                list_place_visits, name, other, f"{option.label}{label}", tool
            )
        ]
        located = [] if is_only else [f"at_goal({name}{option.label})"]
        # The component that is completed comes first; the part that fills its place may be another.
        place = {} if other == name else {"place": other}
        return self._build_skill(
            "place",
            f"{name}{option.label}{turn.label}{label}",
            requires=[
                f"held({name})",
                self._name_attached(tool),
                *self._list_works_before(name),
                *_list_fact(turn),
            ],
            forbids=[] if is_only else [f"placed({option.done})"],
            add=[f"placed({option.done})", *located, HAND_FREE],
            delete=[f"held({name})"],
            ends_at=f"{option.place}{turn.label}",
            routes={None: [visits[0][1]]},
            ways=visits if len(visits) > 1 else (),
            parameters={**place, "part": name, "tool": tool},
            carries=name,
        )

    def _list_visits(
        self,
        list_visits: Callable[[AssemblyConfig, str], list[tuple[str, Visit]]],
        name: str,
        like: str,
        label: str,
        tool: str,
    ) -> list[tuple[str, Visit]]:
        """Return the visits of a part that another goal or tool, or a part like it, determines."""
        config = choose_variant(self.config, like, label, tool)
        visits = list_visits(config, like)
        if config is not self.config:
            # The body holds the grasp of its first tool.
            grasp = list_grasps(config, like)[0]
            visits = [
                (words, visit if visit.grasp else replace(visit, grasp=grasp))
                for words, visit in visits
            ]
        return [(words, replace(visit, subject=name)) for words, visit in visits]

    def _build_fasten(self, name: str, turn: Orientation, label: str, tool: str) -> Skill:
        config, screw = self.config, self.config.screws[name]
        owners = screw, config.tools[tool]
        chosen = choose_variant(config, name, tool=tool)
        driving = find_driving(chosen, name) if label else self.drivings[name]
        hole = self.layout.hole_pose(screw)
        # The shank leaves its hole on the straight stretch.
        stretch_m = screw.insert_m
        if stretch_m is None and screw.length_m is not None:
            stretch_m = max(screw.length_m, _LEAST_STRETCH_M)
        drive = Visit(
            hole,
            Event.DRIVE,
            name,
            along=screw.direction,
            insert_m=stretch_m,
            dwell_s=driving.takes_s,
            torque_nm=screw.torque_nm,
        )
        drives = [
            replace(turn_visit(drive, turn.motion), aside_m=aside_m)
            for aside_m in list_asides_m(chosen, name, turn.motion)
        ]
        fetch: tuple[Visit, ...] = ()
        place = self.layout.fetch(screw)
        if place is not None:
            fetch_s = find_dwell_s("fetch", config.durations_s, *owners)
            fetch = (Visit(Pose(place), Event.FETCH, name, dwell_s=fetch_s),)
        start = [] if screw.start_m is None else [f"at_start({name})"]
        ways = [(_label_aside(drive), (*fetch, drive)) for drive in drives]
        return self._build_skill(
            "fasten",
            f"{name}{turn.label}{label}",
            requires=[
                HAND_FREE,
                self._name_attached(tool),
                *start,
                *self._list_threads(screw),
                *self._list_works_before(name),
                *_list_fact(turn),
            ],
            forbids=[f"fastened({name})"],
            add=[f"fastened({name})"],
            delete=start,
            ends_at=f"{name}{turn.label}",
            routes={None: ways[0][1]},
            ways=ways if len(ways) > 1 else (),
            parameters={"screw": name, "tool": tool, "part": screw.through},
        )

    def _build_work(self, name: str) -> Skill:
        config, work = self.config, self.config.works[name]
        *path, last = list_work_points(config, name)
        action, fact = vocabulary.name_work(config, name)
        visit = Visit(
            Pose(last),
            Event.WORK,
            name,
            dwell_s=0.0 if path else work.dwell_s,
            path=tuple(path),
            path_speed_m_per_s=work.speed_m_per_s if path else None,
            press_n=work.force_n or 0.0,
        )
        return self._build_skill(
            action.partition("(")[0],
            name,
            requires=[
                HAND_FREE,
                self._name_attached(work.tool),
                f"{'single' if work.part in config.joined_in else 'placed'}({work.part})",
                *_list_fact(find_work_orientation(config, name)),
            ],
            forbids=[fact],
            add=[fact],
            delete=[],
            ends_at=name,
            routes={None: [visit]},
            parameters={"work": name, "tool": work.tool, "part": work.part},
        )

    def _build_turn(self, name: str, orientation: str) -> Skill:
        config, entry = self.config, self.config.workholders[name]
        subject, done = f"{name}.{orientation}", name_turned(name, orientation)
        others = list_turn_origins(config, name, orientation)
        place = vocabulary.name_turn_stand(config, name)
        stand = Pose(self.positions[place])
        visit = Visit(stand, Event.TURN, subject, dwell_s=entry.takes_s)
        return self._build_skill(
            "turn",
            subject,
            requires=[HAND_FREE, *list_turn_needs(config, name, orientation)],
            forbids=[done, *list_ties(config, name)],
            add=[done],
            delete=others,
            ends_at=place,
            routes={other: [visit] for other in others},
            parameters={"workholder": name, "orientation": orientation},
        )

    def _build_holds(self, holder: str, part: str, label: str) -> Iterator[Skill]:
        """Yield the skills that close a holder on a part and open it, while the arm stands."""
        facts, entry = self.facts, self.config.holders[holder]
        holds, is_open = name_holding(holder, part), name_open(holder)
        first = list_orientations(self.config, part)[0]
        in_first = [] if entry.turns else _list_fact(first)
        needed = [f"placed({part})"] if entry.kind == "clamp" else []
        for kind, requires, add, delete in (
            (entry.kind, [is_open, *needed, *in_first], holds, is_open),
            ("release", [holds], is_open, holds),
        ):
            name, parameters = f"{kind}({part}{label})", {"part": part, "holder": holder}
            duration_s = ConstantCost(entry.takes_s)
            yield Skill(
                name=name,
                kind=kind,
                agents=(self.config.robot.name,),
                precondition=Condition(facts.of(*requires), facts.none),
                outcomes=(Outcome(1.0, facts.of(add), facts.of(delete, CHANGED_TOOL)),),
                cost=self._choose_cost(kind, name, parameters, ConstantCost(0.0), duration_s),
                duration_s=duration_s,
                parameters=parameters,
            )

    def _build_join(self, name: str, members: Sequence[str]) -> Skill:
        """Return the skill that makes one part of a sub-assembly, in no time."""
        config, facts = self.config, self.facts
        done = [f"placed({m})" if m in config.parts else f"fastened({m})" for m in members]
        works = [
            vocabulary.name_work(config, work)[1]
            for work, given in config.works.items()
            if given.part in members
        ]
        single = facts.of(*(f"single({member})" for member in members))
        held = [name_holding(holder, p) for holder, p, _ in list_holds(config) if p in members]
        requires = facts.of(*done, *works, f"apart({name})") | single
        return Skill(
            name=f"join({name})",
            kind="join",
            agents=(config.robot.name,),
            precondition=Condition(requires, facts.of(*held)),
            outcomes=(
                Outcome(1.0, facts.of(f"at_start({name})"), facts.of(f"apart({name})") | single),
            ),
            cost=ConstantCost(0.0),
            duration_s=ConstantCost(0.0),
            parameters={"part": name, "members": ", ".join(members)},
        )

    def _name_attached(self, tool: str) -> str:
        return vocabulary.name_attached(self.config, tool)

    def _list_works_before(self, name: str) -> list[str]:
        """Return the facts of the works that come before a part or screw."""
        config = self.config
        return [
            vocabulary.name_work(config, work)[1]
            for work, given in config.works.items()
            if name in (given.before or ())
        ]

    def _list_threads(self, screw: ScrewConfig) -> list[str]:
        """Return the facts that the parts with a screw's thread are in place."""
        parts = self.config.parts
        return [f"placed({name})" for name in screw.into_names if name in parts]

    def _build_swap(self, tool: str) -> Skill:
        """Return the action that offloads the attached tool and loads `tool`."""
        config = self.config
        load = self._visit_holder(Event.LOAD, tool)
        routes: dict[str | None, list[Visit]] = {}
        for other in config.carriers:
            if other != tool or config.tool_change.reload:
                routes[f"tool({other})"] = [self._visit_holder(Event.OFFLOAD, other), load]
        bare_hand = vocabulary.allows_bare_hand(config)
        if bare_hand:
            routes[NO_TOOL] = [load]
        others = [f"tool({other})" for other in config.carriers if other != tool]
        return self._build_skill(
            "load",
            tool,
            requires=[HAND_FREE],
            forbids=[] if config.tool_change.reload else [f"tool({tool})"],
            add=[f"tool({tool})", CHANGED_TOOL],
            delete=others + ([NO_TOOL] if bare_hand else []),
            ends_at=f"{tool}.holder",
            routes=routes or {None: [load]},
            parameters={"tool": tool},
        )

    def _build_offload(self, tool: str) -> Skill:
        return self._build_skill(
            "offload",
            tool,
            requires=[HAND_FREE, f"tool({tool})"],
            add=[NO_TOOL],
            delete=[f"tool({tool})"],
            ends_at=f"{tool}.holder",
            routes={None: [self._visit_holder(Event.OFFLOAD, tool)]},
            parameters={"tool": tool},
        )

    def _build_load(self, tool: str) -> Skill:
        return self._build_skill(
            "load",
            tool,
            requires=[HAND_FREE, NO_TOOL],
            add=[f"tool({tool})", CHANGED_TOOL],
            delete=[NO_TOOL],
            ends_at=f"{tool}.holder",
            routes={None: [self._visit_holder(Event.LOAD, tool)]},
            parameters={"tool": tool},
        )

    def _visit_holder(self, event: Event, name: str) -> Visit:
        tool = self.config.tools[name]
        takes_s = find_dwell_s(event.value, self.config.durations_s, tool)
        return Visit(Pose(tool.holder), event, name, dwell_s=takes_s)

    def _build_reward(self, actions: list[str]) -> RewardScheme | None:
        given = self.config.reward
        if given is None:
            return None
        penalties: tuple[Penalty, ...] = ()
        if given.repeated_tool_change is not None:
            # A separate change is offload, then load: an offload right after a load repeats it.
            separate = self.config.tool_change.style == "separate"
            prefix = "offload(" if separate else "load("
            skills = frozenset(name for name in actions if name.startswith(prefix))
            when = Condition(self.facts.of(CHANGED_TOOL), self.facts.none)
            penalties = (Penalty("repeated_tool_change", given.repeated_tool_change, skills, when),)
        return RewardScheme(
            given.infeasible, given.complete, given.per_cost, given.out_of_time, penalties
        )


def _list_fact(orientation: Orientation) -> list[str]:
    """Return the fact of an orientation, if a workholder has it."""
    return [] if orientation.fact is None else [orientation.fact]


def _make_tuple(visits: Visit | tuple[Visit, ...]) -> tuple[Visit, ...]:
    return visits if isinstance(visits, tuple) else (visits,)


def _label_aside(visit: Visit) -> str:
    """Return the side from which a hand comes to a screw from below."""
    return "" if visit.aside_m is None else f"from {name_direction(unit(visit.aside_m))}"


def choose_step_limit(config: AssemblyConfig) -> int:
    """Return the given step limit, or a limit that allows every order.

    That is a pick and a place for every part, and for each of its buffers, a fastening for every
    screw, and a tool change before each of them and at the end if there are several tools. A part
    whose grasp may fail is left behind with a probability of 1/1,000 at most.
    """
    if config.step_limit is not None:
        return config.step_limit
    skills_per_change = 2 if config.tool_change.style == "separate" else 1
    components = len(config.moved_parts) + len(config.screws) + len(config.works)
    joins = sum(part.made_of is not None for part in config.moved_parts.values())
    changes = components + 1 if len(config.carriers) > 1 else 1
    failures = [part.grasp_failure for part in config.moved_parts.values()]
    tries = [
        max(1, math.ceil(math.log(_LEFT_BEHIND) / math.log(failure) - 1e-9)) if failure else 1
        for failure in failures
    ]
    # One visit to each buffer, with tool changes.
    visits = sum(map(len, vocabulary.list_buffered(config).values()))
    changes += 2 * visits if len(config.carriers) > 1 else 0
    # A turn before each part and screw, and two holds of each part with its releases.
    turns = (components + 1) * len(config.workholders)
    turns += 4 * sum(len(holder.parts) for holder in config.holders.values())
    most = sum(tries) + components + joins + 2 * visits + changes * skills_per_change + turns
    return min(most, MOST_STEPS)


def _locate_buffers(config: AssemblyConfig) -> dict[str, Point]:
    """Return the places of buffers, for pictures."""
    return {
        buffer: get_layout(config).buffered(part, buffer).pose.position
        for part, buffers in vocabulary.list_buffered(config).items()
        for buffer in buffers
    }


def _build_scene(config: AssemblyConfig, places: Mapping[str, Point]) -> Scene:
    """Return the constant geometry: parts, screws, fixtures, tools and the arm.

    Parameters
    ----------
    places
        Positions of the arm's tip by fact [m].
    """
    robot = config.robot
    base = make_point(robot.base_m)
    return Scene(
        bodies=(
            *(_build_part(config, name) for name in config.parts),
            *(_build_screw(config, name) for name in config.screws),
            *(_build_fixture(config, name) for name in config.fixtures),
        ),
        robots=(
            Robot(
                robot.name,
                base,
                robot.reaches_m,
                robot.safe_height_m,
                places,
                # The tool on the flange comes first on its hand.
                tuple(
                    _build_tool(config, name)
                    for name in sorted(config.tools, key=lambda n: n not in config.carriers)
                ),
                robot.arm,
                robot.base_orientation,
                robot.hand,
                robot.payload_kg,
            ),
        ),
        stations={
            **{f"{name}.holder": tool.holder for name, tool in config.carriers.items()},
            **{name: feeder.position for name, feeder in config.feeders.items()},
            **_locate_buffers(config),
        },
        frames={"world": Pose((0.0, 0.0, 0.0)), robot.name: Pose(base, robot.base_orientation)},
        zones=tuple(zone.build(name) for name, zone in config.zones.items()),
        workholders=build_workholders(config),
        holders=build_holders(config),
    )


def _build_part(config: AssemblyConfig, name: str) -> Body:
    part, layout = config.parts[name], get_layout(config)
    convex, shapes = part.convex_shapes, part.shapes
    placed = turn_placements(_list_goal_placements(config, name), list_orientations(config, name))
    return Body(
        name,
        convex,
        placed
        if part.fixed
        else (
            Placement(f"at_start({name})", layout.start(name).pose, solid=part.feeder is None),
            Placement(f"held({name})", Pose((0.0, 0.0, 0.0)), frame=config.robot.name),
            *(
                Placement(f"in_buffer({name}.{buffer})", layout.buffered(name, buffer).pose)
                for buffer in part.buffers or ()
            ),
            *placed,
        ),
        part.mass_kg,
        list_grasps(config, name),
        () if convex == shapes else shapes,
        tuple(_build_fit(into, fit) for into, fit in (part.fits or {}).items()),
        fixed=part.fixed,
        part_of=config.joined_in.get(name, ""),
        release_m=part.release_m or 0.0,
    )


def _build_fit(into: str, fit: FitConfig) -> Fit:
    play_m = max(fit.drawn_m, 0.0) if fit.play_m is None else fit.play_m
    return Fit(
        into,
        fit.drawn_m,
        play_m,
        fit.kind or "",
        fit.force_n,
        fit.lead_in_m,
        fit.kind is not None and fit.stop == "part",
        fit.outside_m,
    )


def _list_goal_placements(config: AssemblyConfig, name: str) -> tuple[Placement, ...]:
    """Return the poses of a part at its goal, or at each place where it may go."""
    if config.parts[name].fixed:
        return (Placement(f"placed({name})", get_layout(config).goal(name).pose),)
    options = vocabulary.list_place_options(config, name)
    fact = "placed" if len(options) == 1 else "at_goal"
    if name in config.joined_in:
        fact = "single"
    placements = []
    for option in options:
        where = choose_variant(config, option.done, option.label)
        pose = get_layout(where).goal(option.done).pose
        placements.append(Placement(f"{fact}({name}{option.label})", pose))
    return tuple(placements)


def _list_initial(config: AssemblyConfig) -> Iterator[str]:
    """Yield the facts that hold at the start."""
    for name, part in config.parts.items():
        state = "placed" if part.fixed else "apart" if part.made_of else "at_start"
        yield f"{state}({name})"
    yield from (f"at_start({n})" for n, s in config.screws.items() if s.start_m is not None)
    tool = config.initial_tool
    yield NO_TOOL if tool is None else vocabulary.name_attached(config, tool)
    yield HAND_FREE
    yield f"at({HOME})"
    if config.fixtures:
        yield FIXED
    for name, entry in config.workholders.items():
        yield name_turned(name, next(iter(entry.orientations)))
    for name, holder in config.holders.items():
        yield name_holding(name, holder.parts[0]) if holder.stays else name_open(name)


def _list_precedences(config: AssemblyConfig) -> Iterator[Precedence]:
    for line in config.chart:
        firsts = [line.before] if line.before else line.any_of or []
        yield from (Precedence(firsts[0], after, tuple(firsts[1:])) for after in line.after)


def _list_pools(config: AssemblyConfig) -> tuple[Pool, ...]:
    """Return the interchangeable parts whose assignment is symmetric.

    It is not if the file names where a single part goes, leaves out some of the actions, or gives
    a single skill a cost of its own.
    """
    if config.workholders or config.holders:
        # Turns and holds name single parts.
        return ()
    cost = config.cost
    weighed = [*cost.wear, *cost.energy_j] if isinstance(cost, CostConfig) else []
    if config.actions is not None or any("(" in name for name in weighed):
        return ()
    named = {fact.partition("(")[0] for fact in config.goal or ()}
    if named - {"placed", "fastened"}:
        return ()
    pools = []
    for name in config.moved_parts:
        members = vocabulary.list_interchangeable(config, name)
        if len(members) > 1 and members[0] == name:
            options = {m: vocabulary.list_place_options(config, m) for m in members}
            located = {
                m: {option.done: f"at_goal({m}{option.label})" for option in options[m]}
                for m in members
            }
            pools.append(
                Pool(
                    tuple(members),
                    tuple(f"at_start({m})" for m in members),
                    tuple(f"held({m})" for m in members),
                    tuple(tuple(located[m][place] for place in members) for m in members),
                )
            )
    return tuple(pools)


def _get_component(config: AssemblyConfig, name: str) -> PartConfig | ScrewConfig:
    return config.parts.get(name) or config.screws[name]


def _build_screw(config: AssemblyConfig, name: str) -> Body:
    screw = config.screws[name]
    fact = "single" if name in config.joined_in else "fastened"
    layout = get_layout(config)
    driven = Placement(f"{fact}({name})", layout.hole_pose(screw))
    place = None if screw.start_m is None else layout.fetch(screw)
    stands = () if place is None else (Placement(f"at_start({name})", Pose(place)),)
    return Body(
        name,
        screw.shapes,
        (*stands, *turn_placements((driven,), list_orientations(config, name))),
        screw.mass_kg,
        shank=find_shank(config, name),
        joins=(screw.through, *screw.into_names),
        part_of=config.joined_in.get(name, ""),
    )


def _build_fixture(config: AssemblyConfig, name: str) -> Body:
    fixture = config.fixtures[name]
    convex, shapes = fixture.convex_shapes, fixture.shapes
    pose = get_layout(config).fixture(name).pose
    places = list_fixture_placements(config, name, pose) or (Placement(FIXED, pose),)
    surfaces = () if convex == shapes else shapes
    stays = places[0].fact == FIXED
    return Body(name, convex, places, _FIXTURE_KG, (), surfaces, fixed=stays)


def _build_tool(config: AssemblyConfig, name: str) -> Tool:
    entry, hand = config.tools[name], config.robot.hand
    kind = choose_tool_kind(config, name)
    size = entry.envelope_m
    return Tool(
        name,
        vocabulary.name_attached(config, name),
        entry.holder,
        None if size is None else Box(make_point(size), (0.0, 0.0, size[2] / 2)),
        kind,
        entry.opening_m,
        entry.force_n,
        entry.hand_on(hand) if kind is ToolKind.GRIPPER else None,
        entry.mass_kg,
        STANDARD_CUP_M if entry.cup_diameter_m is None else entry.cup_diameter_m,
        beyond_m=entry.measure_beyond_m(kind, hand),
        bit_m=entry.bit_m,
        shapes=entry.list_shapes(kind, hand),
        cups=entry.cups,
        outer_m=entry.outer_m,
        mount=entry.find_mount(kind, hand),
        is_socket=entry.socket_m is not None,
        clearance_m=entry.clearance_m,
    )
