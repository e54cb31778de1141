"""Keep the verdicts on a task, and reuse those that hold for a changed task, too.

What a motion meets does not change by bodies that are gone. So a verdict on a motion still holds
in a task whose bodies all stood at the same places before, if the facts that it rests on exist.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from skillplan.checks import Checked, Feasibility, list_queried_skills
from skillplan.task import Skill, State, Task, Verdict
from skillplan.task.scene import Body, Robot, Scene, Tool
from skillplan.task.state import AND


class VerdictMemory:
    """Verdicts on the skills of one task, by the names of back end and skill."""

    def __init__(self) -> None:
        self._task: Task | None = None
        self._skills: dict[str, Skill] = {}
        self._verdicts: dict[tuple[str, str], list[tuple[Verdict, State]]] = {}

    def keep(self, feasibility: Feasibility) -> None:
        """Keep the verdicts on a task instead of those on the one before."""
        self._task = feasibility.task
        self._skills = {skill.name: skill for skill in list_queried_skills(feasibility.task)}
        self._verdicts = {
            (back_end.name, name): [*feasibility.cache.made(back_end, skill)]
            for back_end in feasibility.back_ends
            for name, skill in self._skills.items()
        }

    def recall(self, feasibility: Feasibility, *, boldly: bool = False) -> bool:
        """Give a task the kept verdicts that hold for it; return whether all of them surely do.

        Parameters
        ----------
        boldly
            True to take over verdicts although bodies came or changed, unless they rest on those:
            an order that was found with them needs a check.
        """
        task, before = feasibility.task, self._task
        if before is None:
            return True
        changed = _list_changed(task.scene, before.scene)
        (robot,), (known,) = task.scene.robots, before.scene.robots
        is_same_cell = _describe_cell(task.scene, task) == _describe_cell(before.scene, task)
        if (changed and not boldly) or not is_same_cell or not _is_same_arm(robot, known):
            return True
        usable_bits = _list_usable(task, robot, known, changed).bits
        is_held_alike = task.scene.holders == before.scene.holders
        grasps, known_grasps = map(_list_single_grasps, (task.scene, before.scene))
        for skill in list_queried_skills(task):
            known_skill = self._skills.get(skill.name)
            if (
                known_skill is None
                # A turn moves all bodies on its workholder.
                or (skill.kind == "turn" and task.scene.workholders != before.scene.workholders)
                or changed.intersection(skill.parameters.values())
                or any(grasps.get(n) != known_grasps.get(n) for n in skill.parameters.values())
                or describe_motion(skill) != describe_motion(known_skill)
            ):
                continue
            for back_end in feasibility.back_ends:
                for verdict, state in self._verdicts.get((back_end.name, skill.name), ()):
                    moved = _translate(verdict, task, usable_bits)
                    # A support that came or changed may bear what fell before.
                    stays = verdict.is_feasible or (
                        is_held_alike and (not changed or "moving" in verdict.evidence)
                    )
                    if moved is not None and stays:
                        there = [name for name in state if name in task.facts]
                        checked = Checked(moved, 0.0)
                        feasibility.cache.keep(back_end, skill, checked, task.facts.of(*there))
        return not changed


def describe_motion(skill: Skill) -> tuple[object, ...]:
    """Return the motions of a skill by their names, without the facts of its task."""
    motions = [("", skill.motion), *((way.label, way.motion) for way in skill.ways)]
    return tuple(
        (label, motion.carries, tuple((tuple(route.when), route.visits) for route in motion.routes))
        for label, motion in motions
        if motion is not None
    )


def _translate(verdict: Verdict, task: Task, usable_bits: int) -> Verdict | None:
    """Return a verdict with the facts of another task; None if it rests on lost ones."""
    if verdict.present is None or verdict.absent is None:
        return None
    facts = task.facts
    if any(name not in facts or not facts.bit(name) & usable_bits for name in verdict.present):
        return None
    absent = [name for name in verdict.absent if name in facts]
    return replace(verdict, present=facts.of(*verdict.present), absent=facts.of(*absent))


def _list_usable(task: Task, robot: Robot, before: Robot, changed: Collection[str]) -> State:
    """Return the facts of a task that mean the same as before."""
    tools = {tool.fact: _drop_force(tool) for tool in before.tools}
    other = {fact for fact in robot.places if robot.places[fact] != before.places.get(fact)}
    other |= {tool.fact for tool in robot.tools if tools.get(tool.fact) != _drop_force(tool)}
    placements = (
        placement
        for body in task.scene.bodies
        if body.name in changed
        for placement in body.placements
    )
    other |= {fact for placement in placements for fact in placement.fact.split(AND)}
    return task.facts.of(*(name for name in task.facts.names if name not in other))


def _describe_cell(scene: Scene, task: Task) -> tuple[object, ...]:
    """Return a scene without its bodies, whose placements tell what turns with workholders.

    Orientations count only if a task has them.
    """
    workholders = [
        replace(
            workholder,
            carries=(),
            orientations={
                f: pose for f, pose in workholder.orientations.items() if f in task.facts
            },
        )
        for workholder in scene.workholders
    ]
    return scene.frames, scene.zones, workholders


def _list_single_grasps(scene: Scene) -> dict[str, object]:
    """Return the grasps of bodies with one each, which their motions do not name."""
    return {body.name: body.grasps for body in scene.bodies if len(body.grasps) == 1}


def _list_changed(scene: Scene, before: Scene) -> set[str]:
    """Return the bodies of a scene that did not stand at the same places before."""
    names = {body.name for body in scene.bodies}
    known = {body.name: body for body in before.bodies}
    return {
        body.name
        for body in scene.bodies
        if body.name not in known or not _is_same_body(body, known[body.name], names)
    }


def _is_same_body(body: Body, before: Body, names: Collection[str]) -> bool:
    """Return whether a body is the same, apart from its grasps and ties to bodies that are gone."""
    fits = tuple(fit for fit in before.fits if fit.into in names)
    joins = tuple(name for name in before.joins if name in names)
    as_now = replace(before, placements=body.placements, grasps=body.grasps, fits=fits, joins=joins)
    return as_now == body and {*body.placements} <= {*before.placements}


def _is_same_arm(robot: Robot, before: Robot) -> bool:
    """Return whether an arm is the same, apart from its tools and places."""
    return replace(robot, places={}, tools=()) == replace(before, places={}, tools=())


def _drop_force(tool: Tool) -> Tool:
    """Return a tool without its force, which suffices for the parts of its task."""
    return replace(tool, force_n=None)
