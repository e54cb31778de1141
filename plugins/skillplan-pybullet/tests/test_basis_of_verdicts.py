"""What is in the world of an execution is a function of the facts that its verdict rests on."""

from __future__ import annotations

import copy
import functools
from collections.abc import Iterable

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from board_situations import BOARD, imagined
from example_count import examples
from situations import assembly, config_content
from skillplan.pipeline import load_problem
from skillplan.task import Skill, State, Task
from skillplan_pybullet import PybulletSimulator, SimulationSettings
from skillplan_simulation import Fallen, SupportTrials, Workcell
from thinned import thinned

PRODUCTS = ("inverter_board", "sensor_stack", "motor_drive", "board with a mast")


def made(task: Task) -> Workcell:
    settings = SimulationSettings()
    return Workcell(task, settings, PybulletSimulator(task.scene.robots[0], settings))


@functools.cache
def workcell(product: str) -> Workcell:
    """Return where a product is put together."""
    if product != "board with a mast":
        return made(load_problem(BOARD.parent / f"{product}.yaml").task)
    content = copy.deepcopy(config_content("inverter_board"))
    # Something that reaches up to where the arm travels.
    content["parts"]["mast"] = {
        "tool": "gripper",
        "size_m": [0.03, 0.03, 0.20],
        "start_m": [0.39, -0.23],
        "goal_m": [0.62, 0.16],
    }
    return made(assembly(content))


def handled(skill: Skill) -> set[str]:
    """Return what a skill has to do with."""
    assert skill.motion is not None
    return {visit.subject for route in skill.motion.routes for visit in route.visits}


def situation(task: Task, skill: Skill, done: Iterable[str], place: str, tool: str) -> State:
    """Return a state in which elements are done, the arm is at a place and a tool attached."""
    _, state = imagined(task, skill.name, *(set(done) - handled(skill)))
    (robot,) = task.scene.robots
    if not any(fact in skill.precondition.requires for fact in robot.places):
        state = state - task.facts.of("at(home)") | task.facts.of(place)
    if robot.tool(state) is None:
        state |= task.facts.of(tool)
    return state


def agree(present: State, absent: State, state: State) -> bool:
    """Whether a state agrees on the facts that something rests on."""
    return state & present == present and not state & absent


class Situations:
    """Draws skills, states to begin them in, and other states that agree on some facts."""

    def __init__(self, cell: Workcell, data: st.DataObject) -> None:
        self.cell, self.task, self.data = cell, cell.task, data
        moving = [skill for skill in self.task.skills if skill.motion is not None]
        self.skill = data.draw(st.sampled_from(moving))

    def elements(self) -> set[str]:
        return self.data.draw(st.sets(st.sampled_from(sorted(self.task.operations))))

    def spot(self) -> tuple[str, str]:
        robot = self.cell.robot
        places, tools = sorted(robot.places), sorted(tool.fact for tool in robot.tools)
        return self.data.draw(st.tuples(st.sampled_from(places), st.sampled_from(tools)))

    def first(self) -> State:
        self.done, self.at = self.elements(), self.spot()
        state = situation(self.task, self.skill, self.done, *self.at)
        assume(self.skill.applicable(state))
        return state

    def other(self, present: State, absent: State) -> State:
        named = {*present, *absent}
        fixed = {
            element
            for element, fact in self.task.operations.items()
            if named & {fact, f"at_start({element})"}
        }
        done = (self.elements() - fixed) | (self.done & fixed)
        pairs = zip(self.at, self.spot(), strict=True)
        at = [here if here in named else there for here, there in pairs]
        state = situation(self.task, self.skill, done, *at)
        assume(self.skill.applicable(state))
        return state


@pytest.mark.parametrize(
    "product",
    thinned(PRODUCTS, "inverter_board", "sensor_stack", why="two other boards in every run"),
)
@settings(max_examples=examples(60))
@given(data=st.data())
def test_states_that_agree_have_the_same_bodies_at_the_same_poses(product, data):
    cell = workcell(product)
    situations = Situations(cell, data)
    state = situations.first()
    around = cell.around(situations.skill, state)
    assert agree(around.present, around.absent, state)
    other = situations.other(around.present, around.absent)
    assert agree(around.present, around.absent, other)
    assert cell.around(situations.skill, other) == around


@pytest.mark.parametrize("product", PRODUCTS)
@settings(max_examples=examples(60))
@given(data=st.data())
def test_states_that_agree_on_what_fell_have_the_same_thing_fall(product, data):
    cell = workcell(product)
    situations = Situations(cell, data)

    def fallen(state: State) -> Fallen | None:
        # Of trials that remember nothing.
        trials = SupportTrials(cell.task, cell.surroundings, cell.simulator.world)
        return trials.fallen(cell.around(situations.skill, state), state)

    state = situations.first()
    result = fallen(state)
    if result is None:
        return
    assert agree(result.present, result.absent, state)
    # Besides, it rests on where the way leads, as the execution that would follow does.
    course = cell.around(situations.skill, state).present & cell.task.facts.of(*situations.at)
    other = situations.other(result.present | course, result.absent)
    assert agree(result.present, result.absent, other)
    assert fallen(other) == result
