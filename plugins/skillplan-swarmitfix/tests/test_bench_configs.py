"""Every shipped bench file has the figures that its expect block declares."""

from __future__ import annotations

import itertools
import math
from collections import Counter, deque
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from skillplan.benchmark import load_instances
from skillplan.domains import Problem
from skillplan.pipeline import Setup, load_problem, registry, solve, solve_chain
from skillplan.records import ChainResult, Status
from skillplan_swarmitfix import Bench, Job, SupportedStretch, SwarmitfixConfig, simulate
from swarm_situations import GOALS, HOME, MAKESPANS
from yaml_data import yaml_data

FOLDER = Path(__file__).parents[3] / "configs"
BENCHES = sorted(FOLDER.glob("swarmitfix_*.yaml"))


LARGE = ["swarmitfix_open_curve", "swarmitfix_pentagonal", "swarmitfix_triangular"]
LARGER = pytest.mark.slow(reason="a larger workpiece; smaller ones in every run")


def expect_of(path: Path) -> dict[str, Any]:
    expect: dict[str, Any] = yaml_data(path)["expect"]
    return expect


def benches_expecting(key: str) -> pytest.MarkDecorator:
    """Run on every file that declares this; on some with the whole suite only."""
    having = [path for path in BENCHES if key in expect_of(path)]
    rows = [
        pytest.param(path, marks=LARGER if path.stem in LARGE else (), id=path.stem)
        for path in having
    ]
    assert any(not row.marks for row in rows), key
    return pytest.mark.parametrize("path", rows)


@cache
def problem_of(path: Path) -> Problem:
    return load_problem(path)


@cache
def solved(path: Path, solver: str = "exact") -> ChainResult:
    return solve_chain(problem_of(path), solver)


def job_of(path: Path) -> Job:
    """Return the job on the plans that exact search found."""
    config = problem_of(path).config
    assert isinstance(config, SwarmitfixConfig)
    parts = solved(path).parts
    return Job(config, {p.task.name: [step.skill for step in p.result.steps] for p in parts})


@cache
def swings_to(bench: Bench, goal: int) -> dict[int, int]:
    """Return the fewest swings from everywhere, by a breadth-first search of plain Python."""
    after = bench.successors.tolist()
    before: dict[int, set[int]] = {position: set() for position in range(bench.n_positions)}
    for position, ends in enumerate(after):
        for end in ends:
            if end >= 0:
                before[end].add(position)
    results, queue = {goal: 0}, deque([goal])
    while queue:
        here = queue.popleft()
        for position in before[here] - results.keys():
            results[position] = results[here] + 1
            queue.append(position)
    return results


class TestGoals:
    @benches_expecting("goals")
    def test_the_goals_are_those_declared(self, path):
        assert expect_of(path)["goals"] == [part.ends[1] for part in solved(path).main]

    @benches_expecting("makespans")
    def test_every_sequence_is_as_short_as_declared(self, path):
        """Breadth-first search of the test's own says the same."""
        chain, bench = solved(path), job_of(path).bench
        assert expect_of(path)["makespans"] == [part.result.makespan for part in chain.main]
        for part, makespan in zip(chain.main, expect_of(path)["makespans"], strict=True):
            start, goal = (bench.position(name or "") for name in part.ends)
            assert makespan == swings_to(bench, goal)[start]

    @benches_expecting("makespans")
    def test_every_sequence_starts_where_the_one_before_ended(self, path):
        paths = [part.path for part in solved(path).main]
        home = problem_of(path).config.base.home  # type: ignore[attr-defined]
        assert [home, *(way[-1] for way in paths[:-1])] == [way[0] for way in paths]

    @benches_expecting("steps")
    def test_no_choice_of_goals_takes_fewer_steps(self, path):
        """Layer by layer over all positions of all goal sets, without arrays or ties.

        Where the heads are planned as well, that is proved for these heads only.
        """
        job = job_of(path)
        if job.config.trajectory is None:
            sets = [(goal,) for goal in job.goals]
        else:
            sets = [goal_set.positions for goal_set in job.goal_sets]
        entries = {job.home: 0}
        for positions in sets:
            entries = {
                goal: min(n + swings_to(job.bench, goal)[here] for here, n in entries.items())
                for goal in positions
            }
        chain = solved(path)
        assert expect_of(path)["steps"] == min(entries.values()) == chain.cost == chain.makespan
        assert chain.bound_given == chain.cost
        assert chain.proved_by_level
        planned = any(part.task.stage == "heads" for part in chain.parts)
        assert chain.status is (Status.SOLVED if planned else Status.OPTIMAL)

    def test_brute_force_over_the_polygonal_trajectory_agrees(self):
        """Every way to choose from the candidates, one by one."""
        job = job_of(FOLDER / "swarmitfix_polygonal.yaml")
        sets = [goal_set.positions for goal_set in job.goal_sets]
        assert 1 < math.prod(map(len, sets)) < 500_000
        best = min(
            sum(swings_to(job.bench, goal)[here] for here, goal in itertools.pairwise(way))
            for way in itertools.product((job.home,), *sets)
        )
        assert expect_of(FOLDER / "swarmitfix_polygonal.yaml")["steps"] == best

    def test_the_polygonal_trajectory_is_that_of_table_3(self):
        """Its home, its sixteen goals and their makespans are the paper's."""
        path = FOLDER / "swarmitfix_polygonal.yaml"
        assert f"C{HOME}" == solved(path).main[0].ends[0]
        assert [f"C{goal}" for goal in GOALS] == expect_of(path)["goals"]
        assert list(MAKESPANS) == expect_of(path)["makespans"]


@pytest.mark.slow(reason="plans a bench; its goals in every run")
class TestSupports:
    @benches_expecting("supports")
    def test_there_are_as_many_heads_as_declared(self, path):
        document = solved(path).document()
        assert expect_of(path)["supports"] == len(document["heads"])
        assert len(document["goals"]) == len(document["heads"])

    @pytest.mark.parametrize(
        "stem",
        [
            pytest.param("triangular", marks=LARGER),
            pytest.param("pentagonal", marks=LARGER),
            "open_curve",
        ],
    )
    def test_no_stretch_is_left_bare_for_longer_than_the_rule(self, stem):
        """By the stretches that the planned heads bear."""
        job = job_of(FOLDER / f"swarmitfix_{stem}.yaml")
        for segment in job.workpiece.segments:
            borne = SupportedStretch(segment, job.head_rules)
            first, last = job.ends(segment)
            between = sorted(
                (head.distance_m, head.yaw_rad)
                for head in job.heads
                if head.segment == segment.index and head.kind == "intermediate"
            )
            row = [(0.0, first.yaw_rad), *between, (segment.length_m, last.yaw_rad)]
            stretches = [borne.at(distance_m, yaw_rad) for distance_m, yaw_rad in row]
            for (_, begin_m), (end_m, _) in itertools.pairwise(stretches):
                assert end_m - begin_m <= job.head_rules.max_gap_m + 1e-9

    @benches_expecting("relaxed")
    def test_as_many_goal_sets_are_relaxed_or_split_as_declared(self, path):
        """And each of those says in words what was done."""
        goals = solved(path).document()["goals"]
        counted = Counter(goal["how"] for goal in goals)
        expect = expect_of(path)
        assert (expect["relaxed"], expect["split"]) == (counted["relaxed"], counted["split"])
        assert [goal["how"] != "eq34" for goal in goals] == [bool(goal["note"]) for goal in goals]

    @benches_expecting("supports")
    def test_every_position_of_a_goal_set_is_within_the_arm_s_or_the_paper_s_reach(self, path):
        """Measured from the centroids: nothing is nearer than the rule that found it allows."""
        job = job_of(path)
        for goal_set in job.goal_sets:
            least_m = job.reach.reach_m[0] if goal_set.note else job.reach.safe_distance_m
            for position in goal_set.positions:
                for support in (goal_set.e1, goal_set.e2):
                    distance_m = math.dist(job.bench.centroids_m[position], support)
                    assert distance_m >= min(least_m, job.reach.safe_distance_m) - 1e-9


@pytest.mark.slow(reason="plans a bench; its goals in every run")
class TestCsp:
    @benches_expecting("csp")
    def test_the_paper_s_csp_does_what_is_declared(self, path):
        chain = solved(path, "csp")
        result = chain.cost is not None
        assert expect_of(path)["csp"] == ("solved" if result else "unsolved")

    @benches_expecting("csp")
    def test_its_goals_share_a_pin_where_it_finds_some(self, path):
        """The rule it goes by; where it gives up, the next goal set leaves it no such position."""
        chain = solved(path, "csp")
        if chain.cost is None:
            assert "nothing that" in chain.reason
            return
        bench = job_of(path).bench
        goals = [bench.position(part.ends[1] or "") for part in chain.main]
        for first, other in itertools.pairwise(goals):
            assert set(bench.legs[first].tolist()) & set(bench.legs[other].tolist())

    @benches_expecting("csp")
    def test_it_never_beats_the_optimum(self, path):
        chain = solved(path, "csp")
        assert chain.cost is None or chain.cost >= expect_of(path)["steps"]


class TestFleet:
    @benches_expecting("swings")
    def test_the_fleet_needs_as_many_swings_as_declared(self, path):
        """No robot can do with fewer than it needs alone: the sum is a lower bound."""
        chain, expect = solved(path, "fleet"), expect_of(path)
        document = chain.document()
        assert expect["swings"] == chain.cost == sum(r["swings"] for r in document["robots"])
        assert document["independent_bound_sum"] <= expect["swings"]

    @benches_expecting("parallel_makespan")
    def test_the_fleet_needs_as_many_steps_side_by_side_as_declared(self, path):
        """No fewer than its farthest robot needs alone, by the test's own search."""
        document = solved(path, "fleet").document()
        declared = expect_of(path)["parallel_makespan"]
        assert declared == document["parallel_makespan"] == len(document["schedule"])
        bench = job_of_fleet(path).bench
        alone = [
            swings_to(bench, bench.position(r["goal"]))[bench.position(r["start"])]
            for r in document["robots"]
        ]
        assert alone == [r["swings_alone"] for r in document["robots"]]
        assert max(alone) <= declared
        swings_s = document["swings_s"]
        assert [len(moves) for moves in document["schedule"]] == list(map(len, swings_s))
        assert [max(times_s) for times_s in swings_s] == document["steps_s"]
        assert document["parallel_s"] == sum(document["steps_s"])

    @benches_expecting("parallel_makespan")
    def test_the_simulator_finds_no_pin_held_twice(self, path):
        """It shares nothing with the task; and it does find fault where a step is missing."""
        document = solved(path, "fleet").document()
        assert document["simulated"] == "valid"
        bench = job_of_fleet(path).bench
        ends = {
            r["robot"]: (bench.position(r["start"]), bench.position(r["goal"]))
            for r in document["robots"]
        }
        steps = [
            [
                (robot, int(action[1:]), bench.position(before), bench.position(after))
                for robot, action, before, after in step
            ]
            for step in document["schedule"]
        ]
        assert simulate(bench, ends, steps) is None
        assert simulate(bench, ends, steps[1:]) is not None


def job_of_fleet(path: Path) -> Job:
    config = problem_of(path).config
    assert isinstance(config, SwarmitfixConfig)
    return Job(config)


# The bench in `skillplan benchmark`: its instances appear, and their optima are proved again.


WALKS = {each.name: each for each in load_instances() if each.suite == "swarmitfix"}


def test_the_bench_adds_its_walks():
    """They come from the data of this distribution, and name who proved them."""
    text = registry.load("domain", "swarmitfix")().benchmark()
    assert text is not None
    assert all(f'"{name}"' in text for name in WALKS)
    assert {"swarmitfix"} == {each.kind for each in WALKS.values()}
    proofs = {name: walk.proof_text for name, walk in WALKS.items()}
    assert proofs["walk-C20-C1"] == "auto and fast-downward"
    assert proofs["swarmitfix_fleet"] == "one proof: auto"


@pytest.mark.parametrize("name", [name for name in WALKS if name.startswith("walk-")])
def test_a_walk_has_the_optimum_of_the_data(name):
    """A third solver agrees with the two codes."""
    task = WALKS[name].load()
    result = solve(task, "exact", Setup("kinematic"))
    assert ("optimal", WALKS[name].optimum) == (result.status, result.cost)
