"""From the content of an assembly file to its task.

The five skills of Table I of Moller et al.: pick, place, load, offload, fasten. An action's
cost is the planar distance from where the action before it ended to its own goal (section 4.2), or
the time that it takes: then the task's own figures stand in where no back end tells times.
A grasp may fail, which leaves the part where it lies; where the arm then goes to look for it
again, the skill after counts that path, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from skillplan.domains.assembly import vocabulary
from skillplan.domains.assembly.gripping import grasps_of_part, tool_kind
from skillplan.domains.assembly.insertion import pick_visits, place_visits
from skillplan.domains.assembly.layout import (
    feeder_of,
    goal_of,
    goal_pose,
    holder_of,
    hole_of,
    hole_pose,
    look_of,
    pieces_of,
    point,
    shapes_of,
    start_of,
    start_pose,
)
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.resting import bearers_at_start
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import dwell_s, given_kinds, unit_of
from skillplan.domains.assembly.vocabulary import CHANGED_TOOL, HAND_FREE, HOME, NO_TOOL, at
from skillplan.task.cost import DistanceCost, planar_distance
from skillplan.task.motion import Event, Motion, Point, Route, Visit
from skillplan.task.reward import Penalty, RewardScheme
from skillplan.task.scene import Body, Placement, Pose, Robot, Scene, Tool
from skillplan.task.shape import Box, Cylinder
from skillplan.task.skill import Outcome, Skill, Way
from skillplan.task.state import Condition, Facts, State
from skillplan.task.task import BackEndChoice, Literal, Metric, Precedence, Task


@dataclass(frozen=True, kw_only=True)
class SkillDraft:
    """What a skill needs, does and visits.

    Parameters
    ----------
    kind, subject
        The name's two parts, as in ``pick(pcb)``.
    requires, forbids
        Facts that have to hold, and that must not.
    add, delete
        Facts that it brings about, and that it ends.
    ends_at
        The place where the arm stands then.
    routes
        What the arm visits, by the fact that selects the route; None for a single one. The path
        along them is what the skill costs.
    ways
        Where there are several visits to choose from, all of them, each with the way in words; the
        preferred one first, which is that of the only route.
    parameters
        What it is about, for people and engines.
    carries
        The part in the hand, or None.
    failure
        Probability that nothing comes of it but that the arm stands at `failed_at`, below 1.
    failed_at
        A place.
    """

    kind: str
    subject: str
    requires: Sequence[str]
    add: Sequence[str]
    delete: Sequence[str]
    ends_at: str
    routes: Mapping[str | None, Sequence[Visit]]
    parameters: Mapping[str, str]
    forbids: Sequence[str] = ()
    ways: Sequence[tuple[str, Visit]] = ()
    carries: str | None = None
    failure: float = 0.0
    failed_at: str = ""

    @property
    def name(self) -> str:
        """The skill's name."""
        return f"{self.kind}({self.subject})"


def tool_changes(config: AssemblyConfig) -> Iterator[SkillDraft]:
    """Yield the tool changes of an assembly in the style that its file says."""
    for tool in config.tools:
        if config.tool_change.style == "separate":
            yield _offload(config, tool)
            yield _load(config, tool)
        else:
            yield _swap(config, tool)


def _swap(config: AssemblyConfig, tool: str) -> SkillDraft:
    """Return the action that offloads whatever is attached and loads `tool`."""
    load = _visit(config, Event.LOAD, tool)
    routes: dict[str | None, list[Visit]] = {}
    for other in config.tools:
        if other != tool or config.tool_change.reload:
            offload = _visit(config, Event.OFFLOAD, other)
            routes[f"tool({other})"] = [offload, load]
    if vocabulary.bare_hand(config):
        routes[NO_TOOL] = [load]
    others = [f"tool({other})" for other in config.tools if other != tool]
    return SkillDraft(
        kind="load",
        subject=tool,
        requires=[HAND_FREE],
        forbids=[] if config.tool_change.reload else [f"tool({tool})"],
        add=[f"tool({tool})", CHANGED_TOOL],
        delete=others + ([NO_TOOL] if vocabulary.bare_hand(config) else []),
        ends_at=vocabulary.holder_place(tool),
        routes=routes or {None: [load]},
        parameters={"tool": tool},
    )


def _offload(config: AssemblyConfig, tool: str) -> SkillDraft:
    """Return the action that puts `tool` back."""
    return SkillDraft(
        kind="offload",
        subject=tool,
        requires=[HAND_FREE, f"tool({tool})"],
        add=[NO_TOOL],
        delete=[f"tool({tool})"],
        ends_at=vocabulary.holder_place(tool),
        routes={None: [_visit(config, Event.OFFLOAD, tool)]},
        parameters={"tool": tool},
    )


def _load(config: AssemblyConfig, tool: str) -> SkillDraft:
    """Return the action that attaches `tool` where there is none."""
    return SkillDraft(
        kind="load",
        subject=tool,
        requires=[HAND_FREE, NO_TOOL],
        add=[f"tool({tool})", CHANGED_TOOL],
        delete=[NO_TOOL],
        ends_at=vocabulary.holder_place(tool),
        routes={None: [_visit(config, Event.LOAD, tool)]},
        parameters={"tool": tool},
    )


def _visit(config: AssemblyConfig, event: Event, tool: str) -> Visit:
    """Return the visit of a tool's holder."""
    takes_s = dwell_s(event.value, config.durations_s, config.tools[tool])
    return Visit(Pose(holder_of(config, tool)), event, tool, dwell_s=takes_s)


MOST_STEPS = 100_000
"""The greatest step limit that a file may give."""

# A part may stay where it lies, however often it is tried, this rarely.
_LEFT_LYING = 1e-3


def step_limit_of(config: AssemblyConfig) -> int:
    """Return the most skills that a sequence may have, as given or else enough for every order.

    That is a pick and a place for every part, a fastening for every screw, and a tool change
    before each of them and at the end, where there is more than one tool. A part whose grasp may
    fail is tried so often that it is left lying once in 1,000 times.
    """
    if config.step_limit is not None:
        return config.step_limit
    skills_of_a_change = 2 if config.tool_change.style == "separate" else 1
    components = len(config.parts) + len(config.screws)
    changes = components + 1 if len(config.tools) > 1 else 1
    picks = sum(_tries(part.grasp_failure) for part in config.parts.values())
    count = picks + components + changes * skills_of_a_change
    return min(count, MOST_STEPS)


def _tries(failure: float) -> int:
    """Return how many grasps leave a part lying once in 1,000 times at most."""
    return 1 if not failure else max(1, math.ceil(math.log(_LEFT_LYING) / math.log(failure) - 1e-9))


def scene_of(config: AssemblyConfig, places: Mapping[str, Point]) -> Scene:
    """Return the scene of a faultless assembly.

    Parameters
    ----------
    config
        The assembly.
    places
        Where the tip of the arm stands [m], by fact.
    """
    robot = config.robot
    base = point(robot.base_m)
    return Scene(
        bodies=(
            *(_part_body(config, name) for name in config.parts),
            *(_screw_body(config, name) for name in config.screws),
        ),
        robots=(
            Robot(
                robot.name,
                base,
                robot.reaches_m,
                robot.safe_height_m,
                places,
                tuple(_tool(config, name) for name in config.tools),
                robot.arm,
                robot.base_orientation,
                robot.hand,
                robot.payload_kg,
            ),
        ),
        stations={
            **{vocabulary.holder_place(tool): holder_of(config, tool) for tool in config.tools},
            **{feeder: feeder_of(config, feeder) for feeder in config.feeders},
        },
        frames={"world": Pose((0.0, 0.0, 0.0)), robot.name: Pose(base, robot.base_orientation)},
    )


def _part_body(config: AssemblyConfig, name: str) -> Body:
    part = config.parts[name]
    start, goal = start_pose(config, name), goal_pose(config, name)
    pieces, shapes = pieces_of(part), shapes_of(part)
    in_hand = Pose((0.0, 0.0, 0.0))
    return Body(
        name,
        pieces,
        (
            Placement(f"at_start({name})", start, solid=part.feeder is None),
            Placement(f"held({name})", in_hand, frame=config.robot.name),
            Placement(f"placed({name})", goal),
        ),
        part.mass_kg,
        grasps_of_part(config, name),
        () if pieces == shapes else shapes,
    )


def _screw_body(config: AssemblyConfig, name: str) -> Body:
    screw = config.screws[name]
    height_m = screw.head_height_m
    head = Cylinder(screw.head_diameter_m, height_m, (0.0, 0.0, height_m / 2))
    driven = Placement(f"fastened({name})", hole_pose(config, screw))
    return Body(name, (head,), (driven,), screw.mass_kg)


def _tool(config: AssemblyConfig, name: str) -> Tool:
    entry = config.tools[name]
    size = entry.envelope_m
    return Tool(
        name,
        f"tool({name})",
        holder_of(config, name),
        None if size is None else Box(point(size), (0.0, 0.0, size[2] / 2)),
        tool_kind(config, name),
        entry.opening_m,
        entry.force_n,
        entry.hand_on(config.robot.hand),
        entry.mass_kg,
    )


_METRICS = {
    "distance": Metric("distance", "m"),
    "time": Metric("time", "s", decimals=3, is_duration=True),
}


def ground(config: AssemblyConfig, sha256: str) -> Task:
    """Return the task of a faultless assembly."""
    return _Grounding(config).task(sha256)


class _Grounding:
    """What the parts of one grounding share."""

    def __init__(self, config: AssemblyConfig) -> None:
        self.config = config
        self.facts: Facts = vocabulary.facts_of(config)
        self.beneath = {name: bearers_at_start(config, name) for name in config.parts}
        self.positions = self._positions()
        self.places = {self.facts.bit(at(name)): p for name, p in self.positions.items()}
        self.stands = self.facts.of(*(at(name) for name in self.positions))
        self.behind_m = {
            self.facts.bit(at(vocabulary.missed_place(part))): planar_distance(
                start_of(config, part), self.positions[vocabulary.missed_place(part)]
            )
            for part in vocabulary.missed_parts(config)
        }

    def task(self, sha256: str) -> Task:
        """Return the whole task."""
        config, facts = self.config, self.facts
        skills = {draft.name: self._skill(draft) for draft in self._drafts()}
        order = config.actions or vocabulary.action_names(config)
        operations = {
            **{name: f"placed({name})" for name in config.parts},
            **{name: f"fastened({name})" for name in config.screws},
        }
        goal = config.goal or list(operations.values())
        return Task(
            name=config.name,
            kind=config.kind,
            facts=facts,
            skills=tuple(skills[name] for name in order),
            initial=self._initial(),
            goal=Condition(facts.of(*goal), facts.none),
            metric=_METRICS[config.cost],
            step_limit=step_limit_of(config),
            scene=scene_of(config, {at(name): p for name, p in self.positions.items()}),
            reward=self._reward(order),
            observation=tuple(
                Literal(*vocabulary.literal_parts(text)) for text in config.observation or ()
            ),
            operations=operations,
            chart=tuple(
                Precedence(line.before, after) for line in config.chart for after in line.after
            ),
            physics=next(
                (BackEndChoice(name, options or {}) for name, options in config.physics.items()),
                None,
            ),
            collision=tuple(
                BackEndChoice(name, options or {}) for name, options in config.collision.items()
            ),
            sha256=sha256,
            dwells_from=self._dwells_from(),
        )

    def _dwells_from(self) -> tuple[str, ...]:
        """Return the key paths of all dwell times that count, the task's own last."""
        sections = {name: getattr(self.config, name) for name in ("parts", "screws", "tools")}
        owners = ((f"{s}.{n}", owner) for s, all_ in sections.items() for n, owner in all_.items())
        paths = [
            f"{path}.durations_s.{kind}" for path, owner in owners for kind in given_kinds(owner)
        ]
        return (*paths, "durations_s")

    def _positions(self) -> dict[str, Point]:
        """Return where every place is, in the order of the vocabulary."""
        config = self.config
        home = (config.robot.home_m[0], config.robot.home_m[1], config.robot.safe_height_m)
        found: dict[str, Point] = {HOME: home}
        for part in config.parts:
            found[vocabulary.start_place(config, part)] = start_of(config, part)
            found[vocabulary.goal_place(part)] = goal_of(config, part)
        for tool in config.tools:
            found[vocabulary.holder_place(tool)] = holder_of(config, tool)
        for name, screw in config.screws.items():
            found[name] = hole_of(config, screw)
        for part in vocabulary.missed_parts(config):
            found[vocabulary.missed_place(part)] = look_of(config)
        return found

    def _initial(self) -> State:
        tool = self.config.initial_tool
        return self.facts.of(
            *(f"at_start({part})" for part in self.config.parts),
            NO_TOOL if tool is None else f"tool({tool})",
            HAND_FREE,
            at(HOME),
        )

    def _skill(self, draft: SkillDraft) -> Skill:
        """Return a skill that ends at a place and costs the path to it."""
        config, facts = self.config, self.facts
        motion = Motion(
            config.robot.name,
            tuple(
                Route(facts.none if fact is None else facts.of(fact), tuple(visits))
                for fact, visits in draft.routes.items()
            ),
            draft.carries,
        )
        added = facts.of(*draft.add, at(draft.ends_at))
        deleted = (facts.of(*draft.delete, CHANGED_TOOL) | self.stands) - added
        outcomes = [Outcome(1.0 - draft.failure, added, deleted)]
        if draft.failure:
            there = facts.of(at(draft.failed_at))
            left = (facts.of(CHANGED_TOOL) | self.stands) - there
            outcomes.append(Outcome(draft.failure, there, left))
        distance_m = DistanceCost(self.places, motion, behind_m=self.behind_m)
        duration_s = DistanceCost(
            self.places,
            motion,
            per_m=1 / config.robot.travel_speed_m_per_s,
            dwells=True,
            behind_m=self.behind_m,
        )
        return Skill(
            name=draft.name,
            kind=draft.kind,
            agents=(config.robot.name,),
            precondition=Condition(facts.of(*draft.requires), facts.of(*draft.forbids)),
            outcomes=tuple(outcomes),
            cost=duration_s if config.cost == "time" else distance_m,
            duration_s=duration_s,
            motion=motion,
            parameters=draft.parameters,
            ways=tuple(
                Way(label, Motion(motion.robot, (Route(facts.none, (visit,)),), draft.carries))
                for label, visit in draft.ways
            ),
        )

    def _drafts(self) -> Iterator[SkillDraft]:
        """Yield all skills of the assembly."""
        for name, part in self.config.parts.items():
            yield self._pick(name, part)
            yield self._place(name, part)
        yield from tool_changes(self.config)
        for name in self.config.screws:
            yield self._fasten(name)

    def _pick(self, name: str, part: PartConfig) -> SkillDraft:
        start = vocabulary.start_place(self.config, name)
        looks = name in vocabulary.missed_parts(self.config)
        above = [n for n in self.config.parts if name in self.beneath[n]]
        visits = pick_visits(self.config, name)
        return SkillDraft(
            kind="pick",
            subject=name,
            requires=[f"at_start({name})", HAND_FREE, f"tool({part.tool})"],
            forbids=[f"at_start({other})" for other in above],
            add=[f"held({name})"],
            delete=[f"at_start({name})", HAND_FREE],
            ends_at=start,
            routes={None: [visits[0][1]]},
            ways=visits if len(visits) > 1 else (),
            parameters={"part": name, "tool": part.tool},
            failure=part.grasp_failure,
            failed_at=vocabulary.missed_place(name) if looks else start,
        )

    def _place(self, name: str, part: PartConfig) -> SkillDraft:
        visits = place_visits(self.config, name)
        return SkillDraft(
            kind="place",
            subject=name,
            requires=[f"held({name})", f"tool({part.tool})"],
            add=[f"placed({name})", HAND_FREE],
            delete=[f"held({name})"],
            ends_at=vocabulary.goal_place(name),
            routes={None: [visits[0][1]]},
            ways=visits if len(visits) > 1 else (),
            parameters={"part": name, "tool": part.tool},
            carries=name,
        )

    def _fasten(self, name: str) -> SkillDraft:
        config, screw = self.config, self.config.screws[name]
        owners = screw, config.tools[screw.tool]
        drive_s = dwell_s("fasten", config.durations_s, *owners)
        hole, along = hole_pose(config, screw), unit_of(screw.axis)
        visits = [Visit(hole, Event.DRIVE, name, along=along, dwell_s=drive_s)]
        if screw.feeder is not None:
            fetch_s = dwell_s("fetch", config.durations_s, *owners)
            feeder = Pose(feeder_of(config, screw.feeder))
            visits.insert(0, Visit(feeder, Event.FETCH, name, dwell_s=fetch_s))
        return SkillDraft(
            kind="fasten",
            subject=name,
            requires=[HAND_FREE, f"tool({screw.tool})"],
            forbids=[f"fastened({name})"],
            add=[f"fastened({name})"],
            delete=[],
            ends_at=name,
            routes={None: visits},
            parameters={"screw": name, "tool": screw.tool, "part": screw.through},
        )

    def _reward(self, actions: list[str]) -> RewardScheme | None:
        given = self.config.reward
        if given is None:
            return None
        penalties: tuple[Penalty, ...] = ()
        if given.repeated_tool_change is not None:
            # With separate actions a change is offload, then load: repeated is what takes a
            # tool off again right after it was attached.
            separate = self.config.tool_change.style == "separate"
            prefix = "offload(" if separate else "load("
            skills = frozenset(name for name in actions if name.startswith(prefix))
            when = Condition(self.facts.of(CHANGED_TOOL), self.facts.none)
            penalties = (Penalty("repeated_tool_change", given.repeated_tool_change, skills, when),)
        return RewardScheme(
            given.infeasible, given.complete, given.per_cost, given.out_of_time, penalties
        )
