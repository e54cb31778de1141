"""Many of a kind: counts, grids, trays, and parts that may take each other's places."""

from __future__ import annotations

from itertools import permutations

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from skillplan import Setup, SkillModel, Status, load_problem, make_model, solve
from skillplan.errors import TaskError
from skillplan.model import SequencingProblem
from skillplan.pipeline import make_feasibility
from skillplan.solvers import ExactSolver
from skillplan.task import WORLD

BOXES = Setup(collision=("aabb",))
BOARD = {"tool": "cup", "size_m": [0.24, 0.16, 0.01], "start_m": [0.5, 0.35], "goal_m": [0.5, 0.05]}
CLIP = {
    "count": 6,
    "tool": "cup",
    "size_m": [0.02, 0.02, 0.02],
    "start_in": "pallet",
    "goal_m": [0.42, 0.03],
    "goal_pattern": {"grid": [3, 2], "pitch_m": [0.06, 0.05]},
    "goal_on": "board",
}
PALLET = {
    "at_m": [0.4, -0.35],
    "height_m": 0.01,
    "pattern": {"grid": [3, 2], "pitch_m": [0.06, 0.05]},
}
CELL = {
    "kind": "assembly",
    "name": "cell",
    "robot": {"home_m": [0.35, 0.0], "safe_height_m": 0.2},
    "tools": {
        "cup": {"type": "suction", "holder_m": [0.25, 0.4]},
        "driver": {"type": "screwdriver", "holder_m": [0.33, 0.4]},
    },
    "initial_tool": "cup",
    "trays": {"pallet": PALLET},
    "parts": {"board": BOARD, "clip": CLIP},
}


@pytest.fixture
def load(tmp_path):
    """Return the problem of the cell with some sections changed."""

    def of(**sections):
        path = tmp_path / "cell.yaml"
        path.write_text(yaml.safe_dump({**CELL, **sections}, sort_keys=False))
        return load_problem(path)

    return of


@pytest.fixture
def faults(load):
    """Return the messages about the cell with some sections changed, without their positions."""

    def of(**sections):
        with pytest.raises(TaskError) as raised:
            load(**sections)
        return [issue.message for issue in raised.value.issues]

    return of


def with_clip(**changes):
    return {"board": BOARD, "clip": {**CLIP, **changes}}


def test_a_count_is_numbered_parts_from_pockets_to_places(load):
    task = load().task
    poses = {f: p.pose.position for f, p in placements(task, "clip_5").items()}
    assert poses["at_start(clip_5)"] == pytest.approx((0.46, -0.30, 0.01))
    assert poses["at_goal(clip_5)"] == pytest.approx((0.48, 0.08, 0.01))
    assert poses["at_goal(clip_5@clip_1)"] == pytest.approx((0.42, 0.03, 0.01))
    assert [body.name for body in task.scene.bodies if body.fixed] == ["pallet"]


def placements(task, name):
    return {p.fact: p for p in task.scene.body(name).placements if p.frame == WORLD}


def test_a_file_that_is_written_out_is_the_same_task(load):
    clip = {k: v for k, v in CLIP.items() if k not in ("count", "start_in", "goal_pattern")}
    written = {
        f"clip_{i + 1}": {
            **clip,
            "start_m": [0.4 + 0.06 * (i % 3), -0.35 + 0.05 * (i // 3), 0.01],
            "start_on": "pallet",
            "goal_m": [0.42 + 0.06 * (i % 3), 0.03 + 0.05 * (i // 3)],
            "interchangeable": "clip",
        }
        for i in range(6)
    }
    by_hand = load(parts={"board": BOARD, **written})
    assert load().task.skills == by_hand.task.skills
    assert load().sha256 == by_hand.sha256


def test_a_rack_has_levels_that_step_back(load):
    pattern = {"grid": [3, 1, 2], "pitch_m": [0.06, 0.05, 0.04], "step_m": [0.0, 0.06]}
    task = load(trays={"pallet": {**PALLET, "pattern": pattern}}).task
    assert placements(task, "clip_4")["at_start(clip_4)"].pose.position == pytest.approx(
        (0.4, -0.29, 0.05)
    )
    assert len(task.scene.body("pallet").shapes) == 2


def test_screws_and_charts_and_goals_name_a_count_as_a_whole(load):
    screw = {
        "count": 2,
        "tool": "driver",
        "hole_m": [0.42, 0.055],
        "hole_pattern": {"grid": [2, 1], "pitch_m": [0.06, 0.1]},
        "through": "board",
    }
    chart = [{"before": "clip", "after": ["screw"]}]
    task = load(screws={"screw": screw}, chart=chart, goal=["placed(clip)"]).task
    assert {s.name for s in task.skills} >= {"fasten(screw_1)", "fasten(screw_2)"}
    assert len(task.chart) == 12
    assert len(task.goal.requires) == 6


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": 7}, "'pallet' has 6 pockets, 0 of them taken: too few for 7. Enlarge its grid."),
        ({"start_in": "palet"}, "unknown tray 'palet'. Did you mean 'pallet'?"),
        ({"start_m": [0.3, 0.3]}, "give one of 'start_in' and 'start_m', not both."),
        (
            {"goal_pattern": {"grid": [2, 2], "pitch_m": [0.06, 0.05]}},
            "2 x 2 places are too few for 6. Enlarge the grid.",
        ),
    ],
)
def test_faults_are_told_where_the_count_stands(faults, changes, message):
    assert message in faults(parts=with_clip(**changes))


def test_a_fault_of_a_count_is_told_once(faults):
    assert faults(parts=with_clip(mass_kg=0.0)) == ["must be >= 1e-06, not 0.0 (mass [kg])."]


def test_a_count_needs_places_and_parts_of_one_class_are_the_same(faults):
    clip = {k: v for k, v in CLIP.items() if k not in ("start_in", "goal_pattern")}
    told = faults(parts={"board": BOARD, "clip": {**clip, "start_m": [0.4, -0.3]}})
    assert "6 parts need 'start_in', 'start_pattern' or 'feeder'." in told
    assert "6 parts need 'goal_pattern'." in told
    single = {k: v for k, v in clip.items() if k != "count"}
    a = {**single, "start_m": [0.4, -0.2], "interchangeable": "k"}
    b = {**a, "start_m": [0.5, -0.2], "goal_m": [0.5, 0.05], "mass_kg": 0.3}
    (message,) = faults(trays={}, parts={"board": BOARD, "a": a, "b": b})
    assert message.startswith("is the class of 'a', which has another 'mass_kg'.")


places = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 1)), min_size=3, max_size=3, unique=True
)


@settings(max_examples=5, deadline=None)
@given(starts=places, goals=places)
def test_an_assignment_costs_no_more_than_the_best_pairing(tmp_path_factory, starts, goals):
    """With and without symmetry, by orders of jobs, and by one task for every pairing."""
    at = [[0.38 + 0.045 * x, -0.35 + 0.06 * y] for x, y in starts]
    to = [[0.42 + 0.03 * x, 0.03 + 0.03 * y] for x, y in goals]
    part = {"tool": "cup", "size_m": [0.02, 0.02, 0.02], "goal_on": "board"}
    path = tmp_path_factory.mktemp("pairs") / "cell.yaml"

    def task_of(order, shared):
        parts = {
            f"p{i}": {
                **part,
                "start_m": at[i],
                "goal_m": to[order[i]],
                **({"interchangeable": "p"} if shared else {}),
            }
            for i in range(3)
        }
        path.write_text(yaml.safe_dump({**CELL, "trays": {}, "parts": {"board": BOARD, **parts}}))
        return load_problem(path).task

    task = task_of((0, 1, 2), shared=True)
    with_symmetry, without = (
        ExactSolver(ExactSolver.Options(symmetry=on)).solve(model_of(task)) for on in (True, False)
    )
    pairings = [
        ExactSolver().solve(model_of(task_of(order, shared=False))).plan.cost
        for order in permutations(range(3))
    ]
    assert with_symmetry.proved
    assert without.proved
    assert with_symmetry.plan.cost == pytest.approx(min(pairings), abs=1e-9)
    assert without.plan.cost == pytest.approx(min(pairings), abs=1e-9)
    assert with_symmetry.trace["states"] <= without.trace["states"]
    by_orders = solve(task, "branch-and-cut", setup=BOXES)
    assert by_orders.status is Status.OPTIMAL
    assert by_orders.cost == pytest.approx(min(pairings), abs=1e-9)


def model_of(task):
    return SkillModel(make_feasibility(task, BOXES))


@pytest.mark.slow
def test_twenty_four_parts_from_pockets_are_proved_without_an_assignment(load):
    grid = {"grid": [6, 4], "pitch_m": [0.03, 0.03]}
    parts = with_clip(count=24, goal_m=[0.425, 0.005], goal_pattern=grid, size_m=[0.01, 0.01, 0.02])
    task = load(trays={"pallet": {**PALLET, "pattern": grid}}, parts=parts).task
    problem = SequencingProblem.from_model(model_of(task))
    assert len(problem.jobs) == 49
    result = solve(task, "branch-and-cut", setup=BOXES)
    assert result.status is Status.OPTIMAL
    assert len(result.steps) == 50


def test_a_goal_of_some_places_and_named_whereabouts_are_solved_by_exact(load):
    some = load(parts=with_clip(count=3), goal=["placed(board)", "placed(clip_2)"]).task
    result = solve(some, setup=BOXES)
    assert result.status is Status.OPTIMAL
    assert len(result.steps) == 4
    named = load(parts=with_clip(count=3), goal=["placed(board)", "at_goal(clip_1@clip_3)"]).task
    assert named.pools == ()
    assert [s.skill for s in solve(named, setup=BOXES).steps][-1] == "place(clip_1@clip_3)"


def test_a_shank_needs_to_know_the_part_that_it_goes_through(faults):
    screw = {"tool": "driver", "hole_m": [0.42, 0.03], "through": "clip_1", "size": "M3"}
    (message,) = faults(screws={"screw": {**screw, "length_m": 0.01}})
    assert message.startswith("'clip_1' may be at another place, as it is interchangeable.")


SCREW_TRAY = {
    "kind": "assembly",
    "name": "cell",
    "robot": {"model": "panda", "home_m": [0.35, 0.0], "safe_height_m": 0.2},
    "tools": {
        "driver": {
            "type": "screwdriver",
            "length_m": 0.17,
            "bit_length_m": 0.03,
            "holder_m": [0.25, 0.4],
            "envelope_m": [0.04, 0.04, 0.1],
        }
    },
    "initial_tool": "driver",
    "trays": {"rack": {"at_m": [0.42, -0.3], "pattern": {"grid": [2, 1], "pitch_m": [0.02, 0.02]}}},
    "parts": {"plate": {"fixed": True, "size_m": [0.1, 0.1, 0.02], "goal_m": [0.5, 0.1]}},
    "screws": {
        "screw": {
            "count": 2,
            "tool": "driver",
            "start_in": "rack",
            "through": "plate",
            "hole_m": [0.48, 0.1],
            "hole_pattern": {"grid": [2, 1], "pitch_m": [0.05, 0.05]},
        },
        "tall": {
            "tool": "driver",
            "start_m": [0.46, -0.3, 0.01],
            "head_height_m": 0.05,
            "through": "plate",
            "hole_m": [0.5, 0.14],
        },
    },
}


def test_a_screw_is_an_obstacle_at_its_start_until_it_is_fetched(tmp_path):
    """A tall head meets the driver that takes the screw in the pocket next to it."""
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(SCREW_TRAY))
    task = load_problem(path).task
    fasten, tall = task.skill("fasten(screw_2)"), task.skill("fasten(tall)")
    assert fasten.motion.visits(task.initial)[0].position == pytest.approx((0.44, -0.3, 0.01))
    model = make_model(task, BOXES)
    blocked = model.verdict(task.initial, fasten)
    assert not blocked.is_feasible
    assert "tall" in blocked.reason
    assert model.verdict(task.initial, task.skill("fasten(screw_1)")).is_feasible
    after = model.transition(task.initial, tall).next_state
    assert model.verdict(after, fasten).is_feasible


def test_screws_of_a_tray_with_narrow_pockets_meet(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(SCREW_TRAY))
    with pytest.raises(TaskError, match="meets that of 'screw_1'"):
        load_problem(path, changes={"screws.screw.head_diameter_m": "0.03"})
