"""Dwell times in trajectories: the task's, in times, bounds, planned motions and exports."""

from __future__ import annotations

import csv
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import assembly
from skillplan.cli import main
from skillplan.pipeline import Setup, solve
from skillplan.testing import lid_content
from skillplan_pinocchio import SweptDetector

SWEPT = Setup(collision=("swept",))
SECONDS = st.floats(0, 600).map(lambda value: round(value, 3))


def starter(tmp_path, capsys):
    """Write the board that `init` writes, and return it."""
    path = tmp_path / "board.yaml"
    command(capsys, "init", "assembly", "--out", str(path))
    return path


def command(capsys, *words):
    """Return the exit code of a command, and what it prints on both streams."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main(words)
    printed = capsys.readouterr()
    return ended.value.code, printed.out, printed.err


def solved(capsys, path, *words):
    """Return the document of a search."""
    code, out, err = command(capsys, "search-optimal", str(path), *words, "--format", "json")
    assert code == 0, err
    return json.loads(out)


@pytest.mark.parametrize("detector", ["swept", "aabb"])
@pytest.mark.parametrize("cost", ["distance", "time"])
def test_a_dwell_of_the_task_counts_under_every_detector(tmp_path, capsys, detector, cost):
    """A screw that takes 60 s instead of 8 s takes 52 s more."""
    board = starter(tmp_path, capsys)
    words = ("--collision", detector, "--set", f"cost={cost}")
    usual = solved(capsys, board, *words)
    longer = solved(capsys, board, *words, "--set", "durations_s.fasten=60")
    assert longer["makespan_s"] - usual["makespan_s"] == pytest.approx(52.0, abs=1e-6)
    assert longer["actions"] == usual["actions"]


def test_dwells_of_single_bodies_and_tools_are_in_every_figure(tmp_path, capsys, monkeypatch):
    """Of the table, the document, the rows of plan.csv, and those of an export."""
    monkeypatch.setenv("COLUMNS", "200")
    board = starter(tmp_path, capsys)
    own = ("screws.screw.durations_s={fasten: 12}", "tools.gripper.durations_s={offload: 9}")
    changes = [word for record in own for word in ("--set", record)]
    usual, own = solved(capsys, board), solved(capsys, board, *changes)
    assert own["makespan_s"] - usual["makespan_s"] == pytest.approx(4.0 + 4.0, abs=1e-6)
    assert own["dwells_from"][:-1] == [
        "screws.screw.durations_s.fasten",
        "tools.gripper.durations_s.offload",
    ]
    out = tmp_path / "run"
    code, table, _ = command(capsys, "search-optimal", str(board), *changes, "--out", str(out))
    assert code == 0
    message = (
        "dwells     of screws.screw, tools.gripper by their own durations_s, others by the task"
    )
    assert message in table
    exported = tmp_path / "plan.csv"
    code, _, err = command(capsys, "export", str(out), "--to", "csv", "--out", str(exported))
    assert code == 0, err
    rows = list(csv.DictReader(exported.read_text("utf-8").splitlines()))
    assert sum(float(row["duration_s"]) for row in rows) == pytest.approx(own["makespan_s"])
    assert command(capsys, "verify", str(out))[0] == 0


def test_a_planned_motion_lasts_as_long_as_the_plan():
    """To the dwell: it is what reports play."""
    content = lid_content()
    content["tools"]["gripper"]["durations_s"] = {"pick": 1.25, "place": 0.75}
    content["parts"]["fuse"]["durations_s"] = {"place": 4.0}
    task = assembly(content)
    result = solve(task, "exact", SWEPT)
    motion = SweptDetector(task).planned_motion([task.skill(s.skill) for s in result.steps], 60)
    taken_s = [skill.end_s - skill.begin_s for skill in motion.skills]
    assert taken_s == pytest.approx([step.duration_s for step in result.steps], abs=1e-6)


def test_a_plan_of_more_than_an_hour_is_not_played():
    """In words: its frames would fill the memory. It is planned all the same."""
    content = lid_content() | {"durations_s": {"fasten": 86_400}}
    task = assembly(content)
    result = solve(task, "exact", SWEPT)
    assert result.makespan_s > 86_400
    skills = [task.skill(step.skill) for step in result.steps]
    with pytest.raises(ValueError, match="takes more than 3,600 s, and no more are played"):
        SweptDetector(task).planned_motion(skills, 60)


@pytest.fixture(scope="module")
def still():
    """A detector on a task without any dwell."""
    kinds = ("pick", "place", "load", "offload", "fasten")
    return SweptDetector(assembly(lid_content() | {"durations_s": dict.fromkeys(kinds, 0.0)}))


@settings(max_examples=examples(20), deadline=None)
@given(data=st.data())
def test_dwells_are_in_the_bound_as_in_the_time(still, data):
    """Bound <= time for any dwells, from any place, and both rise by the dwells of the skill."""
    content = lid_content()
    for name in content["parts"]:
        content["parts"][name]["durations_s"] = {"pick": data.draw(SECONDS), "place": 0.25}
    content["screws"]["screw"]["durations_s"] = {"fasten": data.draw(SECONDS)}
    for tool in content["tools"].values():
        tool["durations_s"] = {"load": data.draw(SECONDS), "offload": data.draw(SECONDS)}
    task = assembly(content)
    detector, facts = SweptDetector(task), task.facts
    for skill in task.skills:
        fact = data.draw(st.sampled_from(sorted(task.scene.robots[0].places)))
        needs = skill.precondition.requires | facts.of(fact)
        tools = [route.when for route in skill.motion.routes if len(route.when)] or [facts.none]
        state = needs | data.draw(st.sampled_from(tools))
        dwell_s = sum(visit.dwell_s for visit in skill.motion.visits(state))
        taken_s, unknown = detector.duration_s(skill, state), facts.all_bits & ~state.bits
        least_s = detector.least_duration_s(skill, state.bits, unknown)
        assert detector.least_duration_s(skill, 0, 0) <= least_s <= taken_s
        twin = still.task.skill(skill.name)
        assert taken_s - still.duration_s(twin, state) == pytest.approx(dwell_s, abs=1e-6)
        bare_s = still.least_duration_s(twin, state.bits, unknown)
        assert least_s - bare_s == pytest.approx(dwell_s, abs=1e-6)


@settings(max_examples=examples(10), deadline=None)
@given(one_s=SECONDS)
def test_doubling_a_dwell_adds_exactly_that_to_the_least_cycle_time(one_s):
    """By trajectories, with a proof; of the only screw, so that the order stays the best."""
    costs = []
    for dwell_s in (one_s, 2 * one_s):
        content = lid_content() | {"cost": "time"}
        content["screws"]["screw"]["durations_s"] = {"fasten": dwell_s}
        result = solve(assembly(content), "exact", SWEPT)
        assert result.status == "optimal"
        costs.append(result.cost)
    assert costs[1] - costs[0] == pytest.approx(one_s, abs=1e-6)
