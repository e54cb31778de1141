"""What is left out of a simulated world changes no verdict: held against worlds with everything."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest

import skillplan_simulation as simulation
from board_situations import BOARD
from skillplan.checks import introduce
from skillplan.collision import world_boxes
from skillplan.model import SkillModel
from skillplan.pipeline import Setup, load_problem, make_model
from skillplan.task import WORLD, Skill, State, Task, Verdict
from skillplan_pybullet import PybulletEngine
from thinned import release_case, slow_case


def everything(
    self: simulation.Surroundings,
    skill: Skill,
    planned: Sequence[simulation.ArmMotion],
    state: State,
    turn: None,
) -> simulation.Neighbourhood:
    """Return all bodies that a state has on the table, however far off."""
    there = tuple(
        simulation.Located(body, placement, world_boxes(body, placement.pose))
        for body in self.task.scene.bodies
        for placement in body.placements
        if placement.solid and placement.frame == WORLD and placement.fact in state
    )
    present = self.task.facts.of(*(item.placement.fact for item in there))
    return simulation.Neighbourhood(there, present, self.task.facts.none, there)


def questions(task: Task, seed: int, sample: int) -> list[tuple[Skill, State]]:
    """Draw applicable skills in states that random walks reach.

    As many as `sample` are feasible by swept hulls, and as many are not.
    """
    rng = random.Random(seed)
    model: SkillModel = make_model(task, Setup(physics="kinematic", collision=("swept",)))
    drawn: dict[bool, dict[tuple[str, int], tuple[Skill, State]]] = {True: {}, False: {}}
    while min(map(len, drawn.values())) < sample:
        state = model.initial
        while not model.is_goal(state):
            applicable = model.applicable(state)
            feasible = [skill for skill in applicable if model.verdict(state, skill).is_feasible]
            for skill in rng.sample(applicable, min(3, len(applicable))):
                drawn[skill in feasible].setdefault((skill.name, state.bits), (skill, state))
            if not feasible:
                break
            state = rng.choice(feasible).prediction.apply(state)
    return [
        question
        for result in drawn.values()
        for question in rng.sample(list(result.values()), sample)
    ]


def verdicts(task: Task, queries: Sequence[tuple[Skill, State]]) -> list[tuple[Verdict, Verdict]]:
    """Return what engine and detector say, each question of a fresh simulation."""
    engine, pairs = PybulletEngine(task), simulation.ContactPairsDetector(task)
    introduce([engine, pairs])
    return [(engine.check(*query), pairs.check(*query)) for query in queries]


@pytest.mark.parametrize(
    "sample",
    [
        slow_case(5, reason="a sample executed twice, in whole worlds, too"),
        release_case(20, reason="80 simulated worlds a product"),
    ],
)
@pytest.mark.parametrize(
    "product",
    [
        "sensor_stack",
        *(
            release_case(name, reason="another in the whole suite")
            for name in ("inverter_board", "motor_drive")
        ),
    ],
)
def test_a_world_with_everything_gives_the_same_answer(product, sample, monkeypatch):
    pytest.importorskip("pinocchio", reason="the sample is drawn by swept hulls")
    task = load_problem(BOARD.parent / f"{product}.yaml").task
    queries = questions(task, 4, sample)
    reduced = verdicts(task, queries)
    monkeypatch.setattr(simulation.Surroundings, "around", everything)
    whole = verdicts(task, queries)
    # The chart forbids some skills that the engine grants.
    assert sum(all(value.is_feasible for value in result) for result in reduced) >= sample
    differing = [
        (skill.name, list(state), [item.reason for item in (*here, *there)])
        for (skill, state), here, there in zip(queries, reduced, whole, strict=True)
        if [entry.status for entry in here] != [element.status for element in there]
    ]
    assert differing == []
