"""A simulated plan as tables: where bodies ended, how skills went, and that it all fits."""

from __future__ import annotations

import io

import pytest
from rich.cells import cell_len

from skillplan.physics.performance import Arrival, Performance, PerformedSkill
from skillplan.records.execution.simulation import Simulation
from skillplan.task.scene import Pose
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.views.tables.simulation import simulation_tables
from skillplan.views.text.rendering import render

FIGURES = {
    "sensed": {"held": "transformer", "jaw_width_m": 0.0441},
    "moved_mm": {"switch_1": 1.25, "switch_2": 0.5},
    "pose_m": [0.476, -0.05599, 0.0061],
}


@pytest.fixture
def simulation(board_task: Task) -> Simulation:
    """Three skills of the board, of which the last fails."""
    skills = board_task.parse_sequence("0,1,2")
    none = board_task.facts.none
    done = [
        PerformedSkill(skill.name, Verdict.feasible(none, none, FIGURES), 2.0 * i, 2.0 * i + 2)
        for i, skill in enumerate(skills[:2])
    ]
    reason = "the jaws closed on nothing, at the place where switch_1 was to be"
    jammed = Verdict.infeasible(reason, none, none, FIGURES)
    done.append(PerformedSkill(skills[2].name, jammed, 4.0, 6.0))
    pose = Pose.upright((0.489, 0.0, 0.0), 0.0)
    arrivals = (Arrival("pcb", pose, pose, 0.00012, 0.001),)
    made = Performance(tuple(done), arrivals, 6.0, 1440, {"largest_n": 1.5})
    return Simulation(board_task, skills, "pybullet", made, 1.2, files={"video": "/tmp/plan.mp4"})


@pytest.mark.parametrize("width", [60, 80, 120])
def test_no_line_is_wider_than_the_output(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    """Though every skill comes with all that was measured."""
    monkeypatch.setenv("COLUMNS", str(width))
    text = render(simulation_tables(simulation), "table", io.StringIO())
    assert max(map(cell_len, text.splitlines())) <= width


def test_the_failure_is_told_with_its_step(simulation: Simulation) -> None:
    notes = simulation_tables(simulation)[-1].notes
    assert [
        "failure    at step 3 (pick(switch_1)): the jaws closed on nothing, at the place where "
        "switch_1 was to be"
    ] == [note for note in notes if note.startswith("failure")]


def test_arrivals_have_a_table_of_their_own(simulation: Simulation) -> None:
    """Before that of the skills, which CSV holds."""
    first, last = simulation_tables(simulation)
    assert [("pcb", "0.120", "0.057", "0.4890 0.0000 0.0000")] == list(first.rows)
    assert 3 == len(last.rows)
