"""From the content of an assembly file to its task.

The five skills of Table I of Moller et al.: pick, place, load, offload, fasten. An action's
cost is the planar distance from where the action before it ended to its own goal (section 4.2), or
the time that it takes: then the task's own figures stand in where no back end tells times.
A grasp may fail, which leaves the part where it lies; where the arm then goes to look for it
again, the skill after counts that path, too.
"""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.domains.assembly import vocabulary
from skillplan.domains.assembly.handling.durations import dwell_s, given_kinds
from skillplan.domains.assembly.handling.insertion import pick_visits, place_visits
from skillplan.domains.assembly.handling.schema import unit_of
from skillplan.domains.assembly.layout import (
    feeder_of,
    goal_of,
    holder_of,
    hole_of,
    hole_pose,
    look_of,
    start_of,
)
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.resting import bearers_at_start
from skillplan.domains.assembly.scenery import scene_of
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.skill_draft import SkillDraft
from skillplan.domains.assembly.step_limit import step_limit_of
from skillplan.domains.assembly.tool_changes import tool_changes
from skillplan.domains.assembly.vocabulary import CHANGED_TOOL, HAND_FREE, HOME, NO_TOOL, at
from skillplan.task.condition import Condition
from skillplan.task.cost import DistanceCost, planar_distance
from skillplan.task.motion import Event, Motion, Point, Route, Visit
from skillplan.task.pose import Pose
from skillplan.task.reward import Penalty, RewardScheme
from skillplan.task.skill import Outcome, Skill, Way
from skillplan.task.state import Facts, State
from skillplan.task.task import BackEndChoice, Literal, Metric, Precedence, Task

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
