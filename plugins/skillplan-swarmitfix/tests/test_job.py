"""The chain of one file: which tasks, in which order, grounded from what."""

from __future__ import annotations

import math
from typing import Any

import pytest

import skillplan_swarmitfix as swarm
from skillplan.pipeline import solve
from skillplan.task import BackEndChoice, Task

TRIANGLE = [[0.40, 0.35], [1.20, 1.60], [2.00, 0.35]]


def job(
    plans: dict[str, tuple[str, ...]] | None = None, refinement: int = 0, **keys: Any
) -> swarm.Job:
    """Return the job of a small file, with some sections replaced."""
    content: dict[str, Any] = {
        "kind": "swarmitfix",
        "name": "triangle",
        "trajectory": {"closed": True, "vertices_m": TRIANGLE},
        "heads": {"max_gap_m": 0.25, "step_m": 0.05},
        "base": {"home": "C66"},
    }
    content |= keys
    content = {key: value for key, value in content.items() if value is not None}
    return swarm.Job(swarm.SwarmitfixConfig.model_validate(content), plans, refinement)


def names(tasks: list[Task]) -> list[str]:
    return [task.name for task in tasks]


def ends(task: Task) -> tuple[str, str]:
    (start,), (goal,) = task.initial, task.goal.requires
    return start, goal


class TestTasks:
    def test_heads_of_every_segment_then_goals_then_a_way_to_every_goal(self):
        tasks = job().tasks("0" * 64)
        count = len(job().goals)
        assert [
            "heads-1",
            "heads-2",
            "heads-3",
            "goals",
            *(f"base-{i}" for i in range(1, count + 1)),
        ] == names(tasks)
        assert ["heads"] * 3 + ["goals"] + ["base"] * count == [task.stage for task in tasks]
        assert {"0" * 64} == {task.sha256 for task in tasks}

    def test_given_subdivisions_leave_no_heads_to_plan(self):
        """3 + 1 + 2 supports."""
        divided = job(heads={"subdivisions": [3, 1, 2]})
        assert names(divided.tasks(""))[0] == "goals"
        assert len(divided.heads) == 6
        assert [head.segment for head in divided.heads] == [0, 0, 0, 1, 2, 2]

    def test_given_goals_leave_only_ways(self):
        """From the home to the first, and from each to the next."""
        tasks = job(trajectory=None, base={"home": "C66", "goals": ["C42", "C42", "C29"]}).tasks("")
        assert names(tasks) == ["base-1", "base-2", "base-3"]
        assert [ends(task) for task in tasks] == [
            ("at(C66)", "at(C42)"),
            ("at(C42)", "at(C42)"),
            ("at(C42)", "at(C29)"),
        ]

    def test_robots_make_one_task_named_like_the_file(self):
        robots = {"one": {"home": "C1", "goal": "C78"}, "two": {"home": "C13", "goal": "C66"}}
        (task,) = job(trajectory=None, robots=robots, step_limit=77).tasks("")
        assert (task.name, task.step_limit) == ("triangle", 77)

    def test_the_file_s_back_ends_go_with_every_task(self):
        chosen = job(physics={"kinematic": None}, collision={"aabb": {"tolerance_m": 0.001}})
        for task in chosen.tasks(""):
            assert BackEndChoice("kinematic", {}) == task.physics
            assert (BackEndChoice("aabb", {"tolerance_m": 0.001}),) == task.collision

    def test_the_file_s_step_limit_is_that_of_the_ways(self):
        assert {7} == {
            task.step_limit for task in job(step_limit=7).tasks("") if task.stage == "base"
        }


class TestLevels:
    def test_a_level_without_plans_stands_in_with_its_optimum(self):
        """So that the chain can be looked at before anything is solved."""
        waiting = job()
        plans = {
            task.name: tuple(step.skill for step in solve(task).steps)
            for task in waiting.tasks("")
            if task.stage == "heads"
        }
        cost = {name: len(plan) for name, plan in plans.items()}
        solved = job(plans)
        assert len(solved.heads) == len(waiting.heads)
        assert cost == {
            f"heads-{i + 1}": sum(head.segment == i for head in waiting.heads) for i in range(3)
        }

    def test_the_goals_that_were_planned_are_where_the_base_goes(self):
        """Not those of the rule: here the last candidate of every set."""
        waiting = job()
        (goals,) = [task for task in waiting.tasks("") if task.stage == "goals"]
        chosen = [goal_set.positions[-1] for goal_set in waiting.goal_sets]
        plan = tuple(
            f"serve({number}:{waiting.bench.name(position)})"
            for number, position in enumerate(chosen, start=1)
        )
        assert set(plan) <= {skill.name for skill in goals.skills}
        planned = job({"goals": plan})
        assert tuple(chosen) == planned.goals != waiting.goals
        last = planned.tasks("")[-1]
        assert f"at({waiting.bench.name(chosen[-1])})" == ends(last)[1]

    def test_the_rule_s_goals_are_the_preset_of_their_task(self):
        waiting = job()
        (goals,) = [task for task in waiting.tasks("") if task.stage == "goals"]
        assert goals.preset is not None
        assert [waiting.bench.name(goal) for goal in waiting.goals] == [
            name.partition(":")[2].rstrip(")") for name in goals.preset
        ]

    @pytest.mark.parametrize("rule", ["fewest-steps", "nearest-centroid"])
    def test_a_greedy_rule_never_beats_the_bound(self, rule):
        greedy = job(base={"home": "C66", "goal_choice": rule})
        assert greedy.choice.total_steps >= greedy.least_steps == job().choice.total_steps

    def test_refined_heads_stand_closer_together(self):
        """Subdivisions are multiplied, and the gap is divided."""
        divided = [job(heads={"subdivisions": [3, 1, 2]}, refinement=n) for n in range(3)]
        assert [len(entry.heads) for entry in divided] == [6, 12, 18]
        planned = [job(refinement=n) for n in range(3)]
        assert [element.head_rules.max_gap_m for element in planned] == [0.25, 0.125, 0.25 / 3]
        counts = [len(item.heads) for item in planned]
        assert sorted(counts) == counts
        assert counts[0] < counts[2]

    def test_a_chain_that_cannot_be_refined_ends(self):
        """No head fits between heads so close; and where there is no trajectory, nothing is."""
        domain = swarm.SwarmitfixDomain()
        fine = job(heads={"max_gap_m": 0.05, "step_m": 0.05}).config
        assert domain.follow(fine, "", {}, 0)
        assert not swarm.Job(fine, refinement=20).supportable
        assert domain.follow(fine, "", {}, 20) == []
        given = job(trajectory=None, base={"goals": ["C1"]}).config
        assert domain.follow(given, "", {}, 1) == []


class TestSide:
    def test_inward_is_the_same_side_in_either_sense_of_travel(self):
        """Left of a counter-clockwise trajectory, right of a clockwise one."""
        clockwise, other = (
            job(trajectory={"closed": True, "vertices_m": vertices}, base={"side": "inward"})
            for vertices in (TRIANGLE, TRIANGLE[::-1])
        )
        assert (clockwise.reach.side, other.reach.side) == (-1, 1)

    @pytest.mark.parametrize(
        ("side", "expected"),
        [("inward", -1), ("outward", 1), ("left", 1), ("right", -1), (None, -1)],
    )
    def test_the_side_is_the_file_s(self, side, expected):
        """Of a clockwise triangle; left out, it is inward."""
        assert expected == job(base={"side": side}).reach.side

    def test_an_open_trajectory_is_held_from_its_left(self):
        opened = job(trajectory={"vertices_m": TRIANGLE})
        assert opened.reach.side == 1

    def test_the_last_support_of_an_open_trajectory_is_held_as_well(self):
        """As in the paper, by the base that serves the path to it."""
        base = {"home": "C66", "reachable": "ignored"}
        opened, closed = job(trajectory={"vertices_m": TRIANGLE}, base=base), job(base=base)
        for item in (opened, closed):
            assert len(item.goal_sets) == len(item.heads)
        before, last = opened.goal_sets[-2:]
        assert last.e1 == last.e2 == before.e2 == tuple(TRIANGLE[-1])
        assert set(last.positions) == set(before.positions)


class TestFigures:
    def test_what_a_file_leaves_out_is_the_real_machine_s(self):
        bare = job().config
        assert swarm.Timings() == swarm.timings_of(bare)
        assert swarm.Mount() == swarm.mount_of(bare)
        assert swarm.PkmLimits() == swarm.limits_of(bare)

    def test_a_file_may_replace_some_times(self):
        """The others stay."""
        timings = swarm.timings_of(job(timings={"swing_s": {"60": 5}, "park_s": 0}).config)
        assert (5, swarm.Timings().swing_s[120]) == (timings.swing_s[60], timings.swing_s[120])
        assert (0, swarm.Timings().retract_s) == (timings.park_s, timings.retract_s)

    def test_a_file_may_replace_limits_of_legs_and_the_sheet_s_height(self):
        config = job(pkm={"leg_limits_m": {"B": [0.25, 0.28]}, "sheet_height_m": 0.9}).config
        assert swarm.limits_of(config).leg_b_m == (0.25, 0.28)
        assert swarm.PkmLimits().leg_a_m == swarm.limits_of(config).leg_a_m
        assert swarm.mount_of(config).sheet_m == 0.9

    def test_the_bench_is_the_file_s(self):
        """A swing of a larger pitch leads farther."""
        larger = job(trajectory=None, base={"goals": ["C1"]}, bench={"rows": 3, "pitch_m": 1.0})
        assert (
            larger.bench.rows,
            larger.bench.cols,
            larger.bench.pitch_m,
            larger.bench.actions,
        ) == (3, 13, 1.0, 11)
        assert math.dist(*larger.bench.pins_m[:2]) == pytest.approx(1.0)
