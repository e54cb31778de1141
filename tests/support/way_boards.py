"""A small board whose drawer goes in from two sides, and a detector of what closes them."""

from __future__ import annotations

from situations import assembly, fake_back_end
from skillplan.task import Verdict


def drawer_content(*, stops=("left", "right"), cost="distance", **drawer):
    """Return two stops and a drawer between them that may be pushed in from either side."""
    block = {"tool": "hand", "size_m": [0.02, 0.04, 0.03]}
    places = {"left": ([0.3, 0.2], [0.4, 0.0]), "right": ([0.35, 0.2], [0.6, 0.0])}
    return {
        "kind": "assembly",
        "name": "drawer",
        "cost": cost,
        "robot": {"home_m": [0.3, 0.0]},
        "tools": {"hand": {"holder_m": [0.5, 0.3]}},
        "initial_tool": "hand",
        "parts": {
            **{
                name: {**block, "start_m": places[name][0], "goal_m": places[name][1]}
                for name in stops
            },
            "drawer": {
                "tool": "hand",
                "size_m": [0.1, 0.04, 0.03],
                "start_m": [0.3, -0.2],
                "goal_m": [0.5, 0.0],
                "insert_along": [[1, 0, 0], [-1, 0, 0]],
                **drawer,
            },
        },
    }


def drawer_task(**changes):
    """Return the task of the stops and the drawer."""
    return assembly(drawer_content(**changes))


CLOSED = {"place(drawer) along +x": ("placed(left)",), "place(drawer) along -x": ("placed(right)",)}
"""What closes which direction: the stop that the drawer would have to go through."""


def closing(task, closed=CLOSED, **attributes):
    """Return a detector that refuses skills, by name, while one of some facts holds.

    A fact that begins with ``?`` makes the answer unknown.
    """

    def answer(skill, state):
        absent = task.facts.none
        for word in closed.get(skill.name, ()):
            name = word.removeprefix("?")
            fact = task.facts.of(name)
            if name in state and word != name:
                return Verdict.unknown(f"nobody knows whether {name} is in the way")
            if name in state:
                return Verdict.infeasible(f"runs into {name}", fact, absent)
            absent |= fact
        return Verdict.feasible(task.facts.none, absent)

    return fake_back_end(task, answer, name="closing", **attributes)


def rails_content(**drawer):
    """Return two rails, a drawer between them, and a plate that closes each end."""
    plate = {"tool": "gripper", "size_m": [0.01, 0.06, 0.06]}
    rail = {"size_m": [0.12, 0.012, 0.02]}
    return {
        "kind": "assembly",
        "name": "drawer",
        "robot": {"home_m": [0.4, 0.0]},
        "tools": {"gripper": {"holder_m": [0.3, 0.4], "opening_m": 0.08}},
        "initial_tool": "gripper",
        "parts": {
            "rails": {
                "tool": "gripper",
                "boxes": [{**rail, "centre_m": [0.0, y_m, 0.01]} for y_m in (0.037, -0.037)],
                "grasp": {"type": "suction", "at_m": [0.0, 0.037]},
                "start_m": [0.35, 0.2],
                "goal_m": [0.5, 0.0],
            },
            "drawer": {
                "tool": "gripper",
                "size_m": [0.1, 0.05, 0.05],
                "start_m": [0.35, -0.2],
                "goal_m": [0.5, 0.0],
                "insert_along": [[1, 0, 0], [-1, 0, 0]],
                **drawer,
            },
            "front": {**plate, "start_m": [0.55, -0.2], "goal_m": [0.425, 0.0]},
            "back": {**plate, "start_m": [0.45, -0.2], "goal_m": [0.575, 0.0]},
        },
    }


def pin_content():
    """Return a wall and a pin beside it, which is held across or along the wall."""
    return {
        "kind": "assembly",
        "name": "pin-at-wall",
        "robot": {"home_m": [0.4, 0.0]},
        "tools": {"gripper": {"holder_m": [0.3, 0.4], "opening_m": 0.08}},
        "initial_tool": "gripper",
        "parts": {
            "wall": {
                "tool": "gripper",
                "size_m": [0.06, 0.01, 0.06],
                "start_m": [0.35, 0.2],
                "goal_m": [0.5, 0.035],
            },
            "pin": {
                "tool": "gripper",
                "size_m": [0.03, 0.03, 0.05],
                "start_m": [0.35, -0.2],
                "goal_m": [0.5, 0.0],
                "grasp": [{"closing_axis": "y"}, {"closing_axis": "x"}],
            },
        },
    }
