"""Small tasks of the conformance suites."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pydantic import BaseModel

from skillplan.domains.assembly.grounding import ground
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.model.skill_model import SkillModel
from skillplan.task.state import State
from skillplan.task.task import Task


def lid_task() -> Task:
    """Return the lid task: a box, a fuse inside it, and a lid with a screw; two tools."""
    return ground(AssemblyConfig.model_validate(lid_content()), "")


def shut_box_task() -> Task:
    """Return the lid task with a chart that puts the fuse into the box after the lid: no plan."""
    content = lid_content()
    content["chart"] = [
        {"before": "box", "after": ["fuse", "lid"]},
        {"before": "lid", "after": ["screw"]},
        {"before": "screw", "after": ["fuse"]},
    ]
    content["collision"] = {"precedence": {}, "aabb": {}}
    return ground(AssemblyConfig.model_validate(content), "")


def chance_task() -> Task:
    """Return the lid task with a fuse that sometimes slips from the jaws."""
    content = lid_content()
    content["parts"]["fuse"]["grasp_failure"] = 0.25
    return ground(AssemblyConfig.model_validate(content), "")


def hostile_task() -> Task:
    """Return the lid task with names that are not identifiers in any format.

    Only tasks from code have such names; task files allow letters, digits and hyphens.
    """
    task = lid_task()
    names = ["pick(a-b)", "pick(A_B)", "$'N", "END_IF; -- (*", "*) ) ]]> </root>", "=1+1\n,'\""]
    names += ["pick(a b)", "\x1b[31m", "\u202e", "define", "&lt;&amp;"]
    skills = [
        replace(skill, name=names[i] if i < len(names) else f"{names[0]} {i}")
        for i, skill in enumerate(task.skills)
    ]
    return task.replace(name="END_FUNCTION_BLOCK *) \n=<&'\"", skills=tuple(skills))


def reachable_states(model: SkillModel, most: int = 5_000) -> list[State]:
    """Return the states that feasible skills reach, breadth first, up to a limit."""
    states = {model.initial: None}
    for state in (queue := [model.initial]):
        if model.is_goal(state):
            continue
        for step in model.transitions(state):
            for _, following in step.outcomes:
                if following not in states and len(states) < most:
                    states[following] = None
                    queue.append(following)
    return list(states)


def lid_content() -> dict[str, Any]:
    """Return the content of the lid task, for variants."""
    return {
        "kind": "assembly",
        "name": "lid",
        "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.15},
        "tools": {"gripper": {"holder_m": [0.6, 0.2]}, "screwdriver": {"holder_m": [0.6, 0.2]}},
        "initial_tool": "gripper",
        "parts": {
            "box": {
                "tool": "gripper",
                "size_m": [0.1, 0.1, 0.01],
                "grasp": {"type": "suction"},
                "start_m": [0.4, -0.2],
                "goal_m": [0.5, 0.0],
            },
            "fuse": {
                "tool": "gripper",
                "size_m": [0.02, 0.02, 0.02],
                "start_m": [0.4, 0.2],
                "goal_m": [0.5, 0.0],
                "goal_on": "box",
            },
            "lid": {
                "tool": "gripper",
                "boxes": [
                    {"size_m": [0.1, 0.1, 0.005], "centre_m": [0.0, 0.0, 0.0325]},
                    {"size_m": [0.01, 0.1, 0.03], "centre_m": [0.045, 0.0, 0.015]},
                    {"size_m": [0.01, 0.1, 0.03], "centre_m": [-0.045, 0.0, 0.015]},
                ],
                "grasp": {"type": "suction"},
                "start_m": [0.5, -0.3],
                "goal_m": [0.5, 0.0],
                "goal_on": "box",
            },
        },
        "screws": {"screw": {"tool": "screwdriver", "hole_m": [0.545, 0.0], "through": "lid"}},
        "chart": [
            {"before": "box", "after": ["fuse", "lid"]},
            {"before": "fuse", "after": ["lid"]},
            {"before": "lid", "after": ["screw"]},
        ],
        # Fixed back ends, which need no geometry.
        "collision": {"precedence": {}},
        "step_limit": 12,
    }


def assert_options_described(plugin: type[Any]) -> None:
    """Assert that every option has a description for the command line.

    Raises
    ------
    AssertionError
        If a field has no description.
    """
    model: type[BaseModel] = plugin.Options
    for name, field in model.model_fields.items():
        assert field.description, f"option {name!r} of {plugin.name!r} has no description"
