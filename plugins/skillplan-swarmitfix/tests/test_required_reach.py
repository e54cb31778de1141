"""`base.reachable`: the machine reaches every support of a plan, or the task has none."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import yaml
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.domains import Problem
from skillplan.errors import TaskError
from skillplan.pipeline import load_problem, solve_chain
from skillplan.records import ChainResult, Status
from skillplan_swarmitfix import Bench, HeadGrid, HeadKind, Job, SwarmitfixConfig
from swarm_situations import MAKESPANS

CONFIGS = Path(__file__).parents[3] / "configs"
TRIANGLE = [[0.40, 0.35], [1.20, 1.60], [2.00, 0.35]]
LEGS_M = (0.241, 0.322)
# Near the lower left corner of the bench, and in its inside: no position reaches these points.
CORNER = (0.06, 0.12)
HOLE = (0.235, 0.235)


def planar_legs_m(away_m: float, sheet_m: float = 0.848) -> tuple[float, float]:
    """Return the legs A (equal to C) and B for a level head at a distance from the base [m].

    In the plane of symmetry the machine is a planar linkage; the constants are those of the real
    machine. Shares nothing with `pkm.kinematics`.
    """
    tilt, offset_m, base_m, wrist_m, head_m = 0.762, 0.1464, 0.5, 0.0905, 0.0725
    out_m, up_m = away_m - offset_m, sheet_m - base_m - head_m
    x_m = out_m * math.cos(tilt) - up_m * math.sin(tilt)
    z_m = out_m * math.sin(tilt) + up_m * math.cos(tilt)
    stretch_m = math.hypot(x_m, z_m)
    along = (x_m / stretch_m, z_m / stretch_m)
    leg_a_m = stretch_m - wrist_m
    joint_b = (leg_a_m * along[0] + 0.086 * along[1] - 0.18, leg_a_m * along[1] - 0.086 * along[0])
    return leg_a_m, math.hypot(*joint_b)


def is_held(away_m: float, legs_m: dict[str, tuple[float, float]], slack_m: float = 0.0) -> bool:
    """Return whether legs within limits, widened by a slack, hold a head at a distance."""
    leg_a_m, leg_b_m = planar_legs_m(away_m)
    lengths_m = {"A": leg_a_m, "B": leg_b_m, "C": leg_a_m}
    return all(
        legs_m.get(leg, LEGS_M)[0] - slack_m <= length_m <= legs_m.get(leg, LEGS_M)[1] + slack_m
        for leg, length_m in lengths_m.items()
    )


def away_m(bench: Bench, position: int, support: Any) -> float:
    return math.dist(bench.centroids_m[position], support)


def content_of(vertices: Any, *, closed: bool, **sections: Any) -> dict[str, Any]:
    content: dict[str, Any] = {
        "kind": "swarmitfix",
        "name": "reach",
        "trajectory": {"closed": closed, "vertices_m": [list(point) for point in vertices]},
        "heads": {"max_gap_m": 0.30, "step_m": 0.06},
        "base": {"home": "C66"},
    }
    return content | sections


def problem_of(folder: Path, content: dict[str, Any]) -> Problem:
    path = folder / "bench.yaml"
    path.write_text(yaml.safe_dump(content))
    return load_problem(path)


def config_of(content: dict[str, Any]) -> SwarmitfixConfig:
    return SwarmitfixConfig.model_validate(content)


@cache
def solved_config(stem: str, **base: str) -> ChainResult:
    changes = {f"base.{key}": value for key, value in base.items()}
    return solve_chain(load_problem(CONFIGS / f"swarmitfix_{stem}.yaml", {}, changes), "exact")


LARGER = pytest.mark.slow(reason="plans heads of a larger workpiece; smaller ones in every run")

points = st.tuples(st.floats(0.05, 2.33), st.floats(0.05, 1.72))
limits = st.tuples(st.floats(0.235, 0.29), st.floats(0.01, 0.08)).map(
    lambda pair: (pair[0], pair[0] + pair[1])
)
benches = st.fixed_dictionaries(
    {
        "vertices": st.lists(points, min_size=2, max_size=5, unique=True),
        "closed": st.booleans(),
        "legs": st.dictionaries(st.sampled_from("ABC"), limits, max_size=2),
        "relax": st.sampled_from(["needed", "always"]),
    }
)


def solve_bench(bench: dict[str, Any]) -> tuple[ChainResult, Job]:
    """Return a random bench, solved; benches with other faults are rejected."""
    content = content_of(
        bench["vertices"],
        closed=bench["closed"] and len(bench["vertices"]) > 2,
        base={"home": "C66", "relax": bench["relax"]},
        pkm={"leg_limits_m": {leg: list(given_m) for leg, given_m in bench["legs"].items()}},
    )
    with TemporaryDirectory() as folder:
        try:
            problem = problem_of(Path(folder), content)
        except TaskError:
            reject()
    chain = solve_chain(problem, "exact")
    plans = {p.task.name: tuple(s.skill for s in p.result.steps) for p in chain.parts}
    return chain, Job(config_of(content), plans)


def assert_out_of_reach(chain: ChainResult, job: Job, legs_m: dict[str, Any]) -> None:
    """Try every position for the support that is named, and every row of heads around it."""
    assert "goals: support" in chain.reason
    head = job.heads[chain.account.document["unreachable"]["support"] - 1]

    def reach(point: Any) -> bool:
        tried = range(job.bench.n_positions)
        return any(is_held(away_m(job.bench, p, point), legs_m, -1e-9) for p in tried)

    assert not reach(head.position)
    if head.kind is HeadKind.VERTEX:
        return
    segment = job.workpiece.segments[head.segment]
    grid = HeadGrid(segment, *job.ends(segment), job.head_rules)
    reached = {0}
    for node in sorted(grid.arrows):
        if node in reached:
            reached |= {
                following
                for following in grid.arrows[node]
                if following == grid.last or reach(grid.head(following).position)
            }
    assert grid.last not in reached


@given(benches)
@settings(max_examples=examples(60), deadline=None)
def test_every_support_of_a_random_bench_is_reached_or_proved_out_of_reach(bench):
    """Hold a random bench against planar kinematics and all positions, one by one."""
    chain, job = solve_bench(bench)
    if chain.status is Status.INFEASIBLE:
        assert_out_of_reach(chain, job, bench["legs"])
        return
    assert chain.cost is not None, chain.reason
    document = chain.document()
    assert document["supports_beyond_leg_limits"] == 0
    for part, goal in zip(chain.main, document["goals"], strict=True):
        distance_m = away_m(job.bench, job.bench.position(part.path[-1]), goal["support_m"][0])
        assert is_held(distance_m, bench["legs"], 1e-9)


class TestBothPlans:
    """The plan within reach, and the paper's, of every shipped trajectory."""

    @pytest.mark.parametrize(
        ("stem", "steps", "relaxed_everywhere", "as_in_the_paper", "beyond"),
        [
            pytest.param("triangular", 13, 13, 16, 6, marks=LARGER),
            pytest.param("pentagonal", 21, 15, 23, 7, marks=LARGER),
            ("polygonal", 25, 20, 17, 9),
            ("open_curve", 9, 8, 9, 0),
        ],
    )
    def test_they_take_the_documented_steps(
        self, stem, steps, relaxed_everywhere, as_in_the_paper, beyond
    ):
        required = solved_config(stem, reachable="required")
        relaxed = solved_config(stem, reachable="required", relax="always")
        ignored = solved_config(stem, reachable="ignored")
        assert (steps, relaxed_everywhere) == (required.cost, relaxed.cost)
        assert as_in_the_paper == ignored.cost
        assert [0, 0, beyond] == [
            chain.document()["supports_beyond_leg_limits"] for chain in (required, relaxed, ignored)
        ]

    def test_relaxing_every_support_takes_the_fewest_steps_of_all_positions_in_reach(self):
        """Dynamic programming of the test's own, over planar kinematics, agrees."""
        changes = {"base.reachable": "required", "base.relax": "always"}
        config = load_problem(CONFIGS / "swarmitfix_polygonal.yaml", {}, changes).config
        assert isinstance(config, SwarmitfixConfig)
        job = Job(config)
        entries = {job.home: 0}
        for head in job.heads:
            entries = {
                goal: min(
                    swings + int(job.bench.distances(goal)[p]) for p, swings in entries.items()
                )
                for goal in range(job.bench.n_positions)
                if is_held(away_m(job.bench, goal, head.position), {})
            }
        assert 20 == min(entries.values()) == job.choice.total_steps

    def test_the_polygonal_file_is_the_paper_s(self):
        chain = solved_config("polygonal", reachable="ignored")
        assert list(MAKESPANS) == [part.result.makespan for part in chain.main]
        assert "9 of 16 supports are beyond" in chain.reason
        assert chain.not_checked[0] == (
            "reach: 9 of 16 supports lie beyond the legs, and base.reachable is ignored"
        )


class TestRelaxation:
    def test_the_table_says_which_rules_each_support_drops(self):
        chain = solved_config("pentagonal")
        (listing,) = chain.account.listings
        goals = chain.document()["goals"]
        relaxed = [goal for goal in goals if goal["how"] == "relaxed"]
        assert len(relaxed) == 8
        assert "8 of 17 supports have no position by Eqs 1-4 within reach" in "\n".join(
            listing.notes
        )
        assert "support 4: Eq. 3, side dropped" in listing.notes
        assert {"Eq. 3 dropped", "Eq. 3, side dropped"} == {goal["note"] for goal in relaxed}
        assert not any(goal["note"] for goal in goals if goal["how"] == "eq34")

    @pytest.mark.parametrize("relax", ["needed", "always"])
    def test_a_support_that_drops_nothing_obeys_eqs_3_and_4(self, relax):
        """By coordinates along and across the path to the next support."""
        how = {"relax": relax} if relax == "always" else {}
        chain = solved_config("triangular", reachable="required", **how)
        bench = Bench(6, 13, 0.34)
        for goal in chain.document()["goals"]:
            (x1, y1), (x2, y2) = goal["support_m"]
            x_m, y_m = bench.centroids_m[bench.position(goal["goal"])] - (x1, y1)
            length_m = math.dist((x1, y1), (x2, y2))
            ux, uy = (x2 - x1) / length_m, (y2 - y1) / length_m
            along_m, right_m = x_m * ux + y_m * uy, x_m * uy - y_m * ux
            inside = -1e-9 <= along_m <= length_m + 1e-9 and -1e-9 <= right_m <= 0.472
            safe = math.dist((x_m, y_m), (x2 - x1, y2 - y1)) >= 0.286
            assert (goal["how"] == "eq34") == (inside and safe), goal

    def test_planned_heads_avoid_points_out_of_reach(self, tmp_path):
        """The path leads through a point that no position reaches, and a head could stand there."""
        path = [(HOLE[0] - 0.2, HOLE[1] + 0.2), (HOLE[0] + 0.2, HOLE[1] - 0.2)]
        heads = {"max_gap_m": 0.25, "step_m": math.dist(*path) / 2}
        content = content_of(path, closed=False, heads=heads)
        without = Job(config_of(content | {"base": {"home": "C66", "reachable": "ignored"}}))
        assert pytest.approx(without.heads[1].position) == HOLE
        finer = content | {"heads": {**heads, "step_m": heads["step_m"] / 4}}
        chain = solve_chain(problem_of(tmp_path, finer), "exact")
        assert chain.cost is not None
        stands = [tuple(head["position_m"]) for head in chain.document()["heads"]]
        assert HOLE not in [pytest.approx(stand) for stand in stands]

    def test_the_arm_s_own_range_is_required_as_well_if_it_is_given(self):
        content = content_of(TRIANGLE, closed=True, base={"home": "C66", "reach_m": [0.36, 0.44]})
        job = Job(config_of(content))
        for goal_set in job.goal_sets:
            for position in goal_set.positions:
                assert 0.36 <= away_m(job.bench, position, goal_set.e1) <= 0.44


def test_legs_of_hardly_any_stroke_are_no_fault_of_the_file(tmp_path):
    """They hold a head at some distance, between the millimetres; no position has that distance."""
    pkm = {"leg_limits_m": {"A": [0.3, 0.3003]}}
    chain = solve_chain(problem_of(tmp_path, content_of(TRIANGLE, closed=True, pkm=pkm)), "exact")
    assert chain.status is Status.INFEASIBLE
    assert "support 1 of" in chain.reason


class TestFormerName:
    @pytest.mark.parametrize(
        ("former", "rule"), [(True, "preferred"), (False, "ignored")], ids=["true", "false"]
    )
    def test_it_is_read_and_means_the_same_task(self, former, rule, tmp_path):
        now, before = (
            problem_of(tmp_path, content_of(TRIANGLE, closed=True, base={"home": "C66", **key}))
            for key in ({"reachable": rule}, {"prefer_reachable": former})
        )
        assert now.sha256 == before.sha256
        assert now.tasks == before.tasks
        (warning,) = before.warnings
        assert f"base.prefer_reachable: is read as reachable: {rule}" in warning
        assert not now.warnings

    def test_files_of_older_versions_keep_their_hash_where_reach_is_not_required(self, tmp_path):
        """Of version 0.9, before `reachable`; their results stay verifiable."""
        path = CONFIGS / "swarmitfix_cases.yaml"
        assert (
            load_problem(path).sha256
        ) == "c97760fed783d14bab7f7c4e82a51d9974cd1e34adb2eeedf2ef45816b0bb53c"
        polygonal = (CONFIGS / "swarmitfix_polygonal.yaml").read_text("utf-8")
        old = tmp_path / "old.yaml"
        old.write_text(polygonal.replace("reachable: ignored", "prefer_reachable: false"))
        assert (
            load_problem(old).sha256
        ) == "60eae0826ab70d4a5a8d8311e99efa87aa496db41989c9313ccab762596c9c54"

    def test_both_names_at_once_are_refused(self, tmp_path):
        base = {"home": "C66", "reachable": "required", "prefer_reachable": True}
        with pytest.raises(TaskError, match="Keep reachable"):
            problem_of(tmp_path, content_of(TRIANGLE, closed=True, base=base))


def test_the_reach_of_a_job_whose_goals_have_no_plan_is_not_checked():
    """As of a result that claims that there are none."""
    problem = load_problem(CONFIGS / "swarmitfix_polygonal.yaml")
    (recheck,) = problem.domain.recheck(problem.config, {"goals": ()}, 0)
    assert recheck.holds is None
    assert recheck.detail == "no positions are chosen for the supports"
