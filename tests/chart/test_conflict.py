"""Boards without a plan: the cycle is named, and what would free most."""

from __future__ import annotations

from typing import Any

import pytest

from situations import assembly
from skillplan import Setup, Status, Task, solve
from skillplan.chart import Relation, cycle, explain_conflict, find_orderable
from skillplan.collision import AabbDetector
from skillplan.testing import lid_task, shut_box_task

BY_BOXES = Setup(collision=("aabb",))
LARGE, SMALL = [0.1, 0.1, 0.01], [0.02, 0.02, 0.01]


def part(size_m: list[float], goal_m: list[float], **more: Any) -> dict[str, Any]:
    return {
        "tool": "gripper",
        "size_m": size_m,
        "goal_m": goal_m,
        "grasp": {"type": "suction"},
        **more,
    }


def board(parts: dict[str, Any], **more: Any) -> Task:
    task: Task = assembly(
        {
            "kind": "assembly",
            "name": "board",
            "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.25},
            "tools": {
                "gripper": {"holder_m": [0.6, 0.25]},
                "screwdriver": {"holder_m": [0.6, 0.3]},
            },
            "initial_tool": "gripper",
            "parts": parts,
            "step_limit": 30,
            **more,
        }
    )
    return task


MAINBOARD = part(LARGE, [0.5, 0.0], start_m=[0.4, -0.2])
CPU_ON_IT = part(SMALL, [0.5, 0.0], start_on="mainboard", goal_on="mainboard")


def reason(task: Task, setup: Setup = BY_BOXES) -> list[str]:
    result = solve(task, "exact", setup)
    assert Status.INFEASIBLE == result.status
    return result.reason.splitlines()


class TestReasons:
    def test_a_part_on_what_it_belongs_on_is_named(self):
        """It has to leave the mainboard before that moves, and to come after it."""
        assert reason(board({"mainboard": MAINBOARD, "cpu": CPU_ON_IT})) == [
            "mainboard before cpu before mainboard: "
            "cpu lies on mainboard at the start and belongs on it",
            "with another start for cpu, both components would have an order",
        ]

    def test_what_only_follows_is_not_blamed(self):
        """Neither the cover that waits for the cpu, nor the screws that wait for the cover."""
        parts = {
            "mainboard": MAINBOARD,
            "cpu": CPU_ON_IT,
            "ram": part(SMALL, [0.53, 0.0], start_m=[0.3, 0.2], goal_on="mainboard"),
            "cover": part(LARGE, [0.5, 0.0], start_m=[0.5, -0.35], goal_on="cpu"),
        }
        screws = {
            f"screw_{number}": {"tool": "screwdriver", "hole_m": hole_m, "through": "cover"}
            for number, hole_m in enumerate([[0.46, 0.04], [0.54, 0.04], [0.46, -0.04]])
        }
        first, second = reason(board(parts, screws=screws))
        assert first.startswith("mainboard before cpu before mainboard: cpu lies on mainboard")
        assert "with another start for cpu, all 7 components would have an order" == second

    def test_a_start_in_the_way_of_its_own_support_is_named(self):
        """It lies where the mainboard belongs, on which it belongs."""
        cpu = part(SMALL, [0.5, 0.0], start_m=[0.5, 0.0], goal_on="mainboard")
        first, second = reason(board({"mainboard": MAINBOARD, "cpu": cpu}))
        assert first == (
            "mainboard before cpu before mainboard: cpu belongs on mainboard "
            "and mainboard is in the way of pick(cpu) at its goal"
        )
        assert "with another start for cpu, both components would have an order" == second

    def test_two_that_change_places_are_named(self):
        """Others are not."""
        parts = {
            "a": part(SMALL, [0.5, 0.0], start_m=[0.4, 0.0]),
            "b": part(SMALL, [0.4, 0.0], start_m=[0.5, 0.0]),
            "c": part(SMALL, [0.4, 0.2], start_m=[0.5, 0.2]),
        }
        assert reason(board(parts)) == [
            "a before b before a: b is in the way of place(a) at its start "
            "and of pick(a) at its goal",
            "with another start for b, all 3 components would have an order",
        ]

    def test_of_two_cycles_the_second_is_left(self):
        """Three lines are the most."""
        parts = {
            name: part(SMALL, [0.4 + goal, y_m], start_m=[0.4 + start, y_m])
            for name, start, goal, y_m in (
                ("a", 0.0, 0.1, 0.0),
                ("b", 0.1, 0.0, 0.0),
                ("c", 0.0, 0.1, 0.2),
                ("d", 0.1, 0.0, 0.2),
            )
        }
        lines = reason(board(parts))
        assert lines[0].startswith("a before b before a: b is in the way")
        assert "with another start for b, 2 of 4 components would have an order" == lines[1]
        assert lines[2].startswith("then there is still c before d before c: d is in the way")
        assert 3 == len(lines)

    def test_a_line_of_the_chart_may_be_the_culprit(self):
        """It is offered for removal as a start or goal is."""
        first, second = reason(shut_box_task(), Setup())
        assert first.startswith("fuse before lid before screw before fuse: ")
        assert "the chart puts lid before screw and screw before fuse" in first
        assert second == (
            "without the chart's line lid before screw, all 4 components would have an order"
        )

    def test_a_goal_that_can_never_be_reached_is_one_line(self):
        """There is no cycle to break."""
        cpu = part(SMALL, [0.56, 0.0], start_m=[0.4, 0.2], goal_on="mainboard")
        assert reason(board({"mainboard": MAINBOARD, "cpu": cpu})) == [
            "place(cpu) is never feasible: aabb: cpu has nothing beneath it"
        ]


class TestExpensiveBackEnds:
    """They are not queried again just to say why there is no plan."""

    @pytest.fixture
    def boxes(self, monkeypatch):
        """Make the boxes expensive; return the skills that they check."""
        queried: list[str] = []
        check = AabbDetector.check

        def note(self: AabbDetector, skill: Any, state: Any) -> Any:
            queried.append(skill.name)
            return check(self, skill, state)

        monkeypatch.setattr(AabbDetector, "expensive", True)
        monkeypatch.setattr(AabbDetector, "check", note)
        return queried

    def test_the_cycle_is_read_off_the_verdicts_of_the_search(self, boxes):
        """What can be tried nowhere counts by its precondition."""
        task = board({"mainboard": MAINBOARD, "cpu": CPU_ON_IT})
        assert reason(task) == [
            "cpu before mainboard before cpu: cpu lies on mainboard at the start and belongs on it",
            "with another start for cpu, both components would have an order",
        ]
        assert "place(cpu)" in boxes
        assert not {"pick(mainboard)", "place(mainboard)"} & set(boxes)


def relation(before: str, after: str) -> Relation:
    return Relation(before, after, f"{after} needs {before}", {"skill": "", "facts": []}, after)


class TestLines:
    def test_a_relation_with_an_order_says_nothing(self):
        """There is nothing to explain."""
        assert () == explain_conflict(
            lid_task(), [relation("box", "fuse"), relation("fuse", "lid")]
        )

    def test_without_evidence_the_reason_is_what_was_said(self):
        """And nothing is known to change but a goal."""
        results = [relation("fuse", "lid"), relation("lid", "fuse")]
        first, second = explain_conflict(lid_task(), results)
        assert "fuse before lid before fuse: lid needs fuse and fuse needs lid" == first
        assert "with another goal for lid, all 4 components would have an order" == second


class TestCycles:
    def test_the_shortest_is_found(self):
        """Whichever is met first."""
        pairs = [("a", "b"), ("b", "c"), ("c", "a"), ("c", "d"), ("d", "c")]
        assert ("c", "d", "c") == cycle(pairs)

    def test_of_one_length_the_one_of_the_first_element_counts(self):
        """The same relation always says the same."""
        assert ("a", "b", "a") == cycle([("a", "b"), ("b", "a"), ("c", "d"), ("d", "c")])

    @pytest.mark.parametrize("pairs", [[], [("a", "b"), ("a", "c"), ("b", "c")]])
    def test_an_order_has_none(self, pairs):
        """Nor has what is empty."""
        assert () == cycle(pairs)

    def test_an_element_before_itself_is_one(self):
        """Of length one."""
        assert ("a", "a") == cycle([("a", "a")])

    def test_what_comes_after_a_cycle_has_no_order(self):
        """What comes before it has one."""
        pairs = [("z", "a"), ("a", "b"), ("b", "a"), ("b", "c")]
        assert {"z", "free"} == find_orderable(["z", "a", "b", "c", "free"], pairs)
