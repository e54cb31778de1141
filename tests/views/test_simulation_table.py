"""A simulated plan as tables: where bodies ended, how skills went, and that it all fits."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from rich.cells import cell_len

from skillplan.physics import Arrival, Performance, PerformedSkill
from skillplan.records import PlannedTimes, Simulation
from skillplan.task import Pose, Verdict
from skillplan.views import render
from skillplan.views.tables import tabulate_simulation

FIGURES = {
    "sensed": {"held": "transformer", "jaw_width_m": 0.0441},
    "moved_mm": {"switch_1": 1.25, "switch_2": 0.5},
    "pose_m": [0.476, -0.05599, 0.0061],
}


@pytest.fixture
def simulation(board_task):
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
    measured = {"largest_n": 1.5}
    performance = Performance(tuple(done), arrivals, 6.0, 1440, measured, taken_away=("brace",))
    return Simulation(
        board_task, skills, "pybullet", performance, 1.2, files={"video": "/tmp/plan.mp4"}
    )


@pytest.mark.parametrize("width", [60, 80, 120])
def test_no_line_is_wider_than_the_output(simulation, monkeypatch, width):
    """Though every skill comes with all that was measured."""
    monkeypatch.setenv("COLUMNS", str(width))
    text = render(tabulate_simulation(simulation), "table", io.StringIO())
    assert max(map(cell_len, text.splitlines())) <= width


def test_the_failure_is_told_with_its_step(simulation):
    notes = tabulate_simulation(simulation)[-1].notes
    assert [
        "failure    at step 3 (pick(switch_1)): the jaws closed on nothing, at the place where "
        "switch_1 was to be"
    ] == [note for note in notes if note.startswith("failure")]
    assert "taken away brace" in notes


def test_arrivals_have_a_table_of_their_own(simulation):
    """Before that of the skills, which CSV holds."""
    first, last = tabulate_simulation(simulation)
    assert [("pcb", "0.120", "0.057", "0.4890 0.0000 0.0000")] == list(first.rows)
    assert 3 == len(last.rows)


def timed(simulation: Simulation, timed_by: str, *acting_s: float | None) -> Simulation:
    """Return the simulation with planned times, and times that the hand acts."""
    done = [
        replace(skill, acting_s=taken_s)
        for skill, taken_s in zip(simulation.performance.skills, acting_s, strict=False)
    ]
    done += simulation.performance.skills[len(done) :]
    created = replace(simulation.performance, skills=tuple(done), pace="strokes at 0.25 m/s")
    return replace(simulation, performance=created, planned=PlannedTimes([1.5, 1.0, 9.0], timed_by))


def times_note(simulation: Simulation) -> str:
    (note,) = (n for n in tabulate_simulation(simulation)[-1].notes if n.startswith("times"))
    return note


def test_the_difference_from_the_planned_time_is_told_with_its_reasons(simulation):
    """Over the skills that succeeded, whose dwells are 3 s each; shares add up."""
    created = timed(simulation, "swept", 3.0, 3.5)
    assert times_note(created) == (
        "times      4.0 s simulated, 2.5 s planned by swept: +1.5 s; +0.5 s acting beyond the "
        "dwells; +1.0 s travels and strokes (strokes at 0.25 m/s)"
    )
    times = created.document()["times"]
    shares = (times["settling_s"], times["acting_s"], times["moving_s"])
    assert sum(shares) == pytest.approx(times["difference_s"])
    planned = [column.heading for column in tabulate_simulation(created)[-1].columns]
    assert "planned [s]" in planned


def test_without_trajectories_the_note_says_that_strokes_are_left_out(simulation):
    """Travel is by the task's speed then."""
    note = times_note(timed(simulation, "", 3.0, 3.0))
    assert "planned by the task's travel speed" in note
    assert "planned without strokes" in note


def test_an_engine_that_measures_no_acting_is_said_to(simulation):
    """The sum is told all the same."""
    note = times_note(timed(simulation, "swept", None, None))
    assert note.endswith("2.5 s planned by swept: +1.5 s; the engine measures no more")
