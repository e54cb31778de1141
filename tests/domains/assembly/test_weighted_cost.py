"""A cost that is a weighted sum: path, time, wear and energy, each stated in the file."""

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import assembly, crowded_assemblies, imagined_state, model_of
from skillplan.checks import Feasibility
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain, find_issues
from skillplan.judge import find_least_cost_of_states
from skillplan.model import SkillModel, replay
from skillplan.pipeline import solve
from skillplan.task import ConstantCost, Metric, WeightedCost
from timed_back_end import clock
from yaml_data import yaml_data

BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"

WEIGHTS = {
    "unit": "ct",
    "per_m": 2.0,
    "per_s": 0.5,
    "wear": {"screwdriver": 1.5, "load": 0.8, "fasten(screw_1)": 0.1},
    "energy_j": {"fasten": 60.0, "fasten(screw_2)": 100.0},
    "per_kj": 5.0,
}


def board_content(cost):
    """Return the content of the board of the paper with another cost."""
    return {**yaml_data(BOARD), "cost": cost}


def board(cost):
    """Return the task of the board with another cost."""
    return assembly(board_content(cost))


def steps_by(cost, skills):
    """Return the steps of a plan of the board under a cost."""
    task = board(cost)
    return replay(SkillModel(Feasibility(task)), [task.skill(name) for name in skills]).steps


def test_a_sum_has_the_weights_of_the_file():
    """Every term on its own, and a single skill's energy before that of its kind."""
    result = solve(board(WEIGHTS))
    skills = [step.skill for step in result.steps]
    path_m = sum(step.cost for step in steps_by("distance", skills))
    time_s = sum(step.cost for step in steps_by("time", skills))
    wear, energy_j = 2 * 1.5 + 0.8 + 0.1, 60.0 + 100.0
    assert result.cost == pytest.approx(2 * path_m + 0.5 * time_s + wear + 5 * energy_j / 1000)
    assert result.cost_unit == "ct"


@pytest.mark.parametrize(
    ("weights", "alone"), [({"per_m": 1.0}, "distance"), ({"per_s": 1.0}, "time")]
)
def test_a_sum_of_one_term_is_that_term(weights, alone):
    """The optimum is the same, to rounding."""
    assert solve(board(weights)).cost == pytest.approx(solve(board(alone)).cost)


@pytest.mark.parametrize("seed", range(3))
def test_times_of_back_ends_count_in_a_sum(seed):
    """The lazy search, which sees only bounds of them at first, proves what exhaustion proves."""
    task = board({"unit": "ct", "per_m": 3.0, "per_s": 0.2, "wear": {"load": 1.0}})
    exact = solve(task, "exact", back_ends=[clock(task, seed=seed)])
    least = find_least_cost_of_states(model_of(task, clock(task, 0.0, seed)))
    assert exact.status == "optimal"
    assert exact.cost == pytest.approx(least.cost)
    timed = 0.2 * sum(step.duration_s for step in exact.steps)
    path = 3.0 * sum(step.cost for step in steps_by("distance", [s.skill for s in exact.steps]))
    assert exact.cost == pytest.approx(timed + path + 1.0)


@given(crowded_assemblies(), st.integers(0, 2**32))
def test_the_bound_of_a_sum_is_below_it_in_every_state(content, seed):
    """As the bounds of the path and of the time are."""
    task = assembly({**content, "cost": {"per_m": 1.0, "per_s": 0.3, "wear": {"pick": 0.5}}})
    rng = random.Random(seed)
    skill = rng.choice(task.skills)
    state = imagined_state(task, skill, rng)
    if state is not None:
        known = rng.getrandbits(len(task.facts))
        least = skill.cost.least(state.bits & known, task.facts.all_bits & ~state.bits & known)
        assert least <= skill.cost.at(state) + 1e-12


@pytest.mark.parametrize(
    ("cost", "path", "words"),
    [
        ({"per_m": 1, "wear": {"griper": 1}}, ("cost", "wear", "griper"), "Did you mean 'gripper'"),
        ({"per_m": 1, "energy_j": {"gripper": 1}, "per_kj": 1}, None, "unknown skill 'gripper'"),
        ({"per_m": 1, "energy_j": {"fasten": 1}}, ("cost", "energy_j"), "Give 'per_kj'"),
        ({"per_m": 1, "per_kj": 1}, ("cost", "per_kj"), "Give 'energy_j'"),
        ({"unit": "ct"}, ("cost",), "all weights are 0"),
    ],
)
def test_a_key_of_the_sum_without_effect_is_a_fault(cost, path, words):
    """It has its place in the file."""
    (issue,) = find_issues(AssemblyConfig.model_validate(board_content(cost)))
    assert words in issue.message
    assert path is None or issue.path == path


def test_weights_are_finite_and_not_negative():
    """A metric is a duration or a sum, not both."""
    one = ConstantCost(1.0)
    with pytest.raises(ValueError, match="per_s must be finite and >= 0"):
        WeightedCost(one, 1.0, one, -1.0)
    with pytest.raises(ValueError, match="per_s must be finite and >= 0"):
        Metric("cost", "ct", per_s=-1.0)
    with pytest.raises(ValueError, match="a duration is none"):
        Metric("time", "s", is_duration=True, per_s=1.0)


# The table slides to the parts: faster for both, but a turn.
SLIDING = {
    "kind": "assembly",
    "name": "sliding",
    "robot": {"name": "panda", "home_m": [0.1, 0.0], "travel_speed_m_per_s": 0.1},
    "tools": {"gripper": {"holder_m": [0.1, 0.3]}},
    "initial_tool": "gripper",
    "parts": {
        name: {
            "tool": "gripper",
            "size_m": [0.04, 0.04, 0.04],
            "start_m": [0.1, y_m],
            "goal_m": [0.5, y_m],
        }
        for name, y_m in (("left", 0.1), ("right", -0.1))
    },
    "collision": {"aabb": {}},
    "workholders": {
        "slide": {
            "pivot_m": [0.5, 0.0, 0.0],
            "orientations": {"far": {}, "near": {"shift_m": [-0.3, 0.0, 0.0]}},
            "takes_s": 0.1,
        }
    },
}


@pytest.mark.parametrize(("cost", "turns"), [("time", 1), (["turns", "time"], 0)])
def test_costs_in_order_have_the_fewest_turns_first(cost, turns):
    result = solve(assembly({**SLIDING, "cost": cost}))
    assert sum(step.skill.startswith("turn(") for step in result.steps) == turns
    assert result.cost < 100


@pytest.mark.parametrize("cost", [["turns", "distance"], "turns"])
def test_a_tool_with_the_name_of_a_kind_of_skill_does_not_count(cost):
    tool = {"turn": {"holder_m": [0.1, 0.3]}}
    parts = {name: {**part, "tool": "turn"} for name, part in SLIDING["parts"].items()}
    content = {**SLIDING, "tools": tool, "initial_tool": "turn", "parts": parts}
    config = AssemblyConfig.model_validate({**content, "cost": ["turns", "distance"]})
    domain = AssemblyDomain()
    chosen = config if isinstance(cost, list) else domain.with_cost(config, cost)
    (task,) = domain.ground(chosen, "")
    costs = [skill.cost.at(task.initial) for skill in task.skills if skill.kind == "pick"]
    assert max(costs) < 1


def test_a_cost_in_order_is_shown_as_counts():
    metric = assembly({**SLIDING, "cost": ["turns", "distance"]}).metric
    assert metric.text(20000.75) == "2 turns, 0.75000 m"
    assert metric.text(10000.0 - 1e-9) == "1 turn, -0.00000 m".replace("-", "")


def with_part(**keys):
    """Return keys of the sliding table with some of a part."""
    return {"parts": {**SLIDING["parts"], "left": {**SLIDING["parts"]["left"], **keys}}}


@pytest.mark.parametrize(
    "slow",
    [with_part(arrives_s=20_000.0), with_part(durations_s={"place": 15_000.0})],
    ids=["late", "long"],
)
def test_a_count_outweighs_late_parts_and_long_waits(slow):
    task = assembly({**SLIDING, **slow, "cost": ["turns", "time"]})
    result = solve(task, "exact")
    assert result.status == "optimal"
    assert result.makespan_s > 10_000
    assert task.metric.text(result.cost).startswith("0 turns, ")


def test_an_order_names_counts_that_the_task_has():
    """A support that is set from the start is not counted."""
    support = {"fork": {"kind": "hold", "parts": "left", "stays": True}}
    for keys, reason in (
        ({}, "the task has no 'holders'"),
        ({"holders": support}, "from the start"),
    ):
        config = AssemblyConfig.model_validate({**SLIDING, **keys, "cost": ["holds", "time"]})
        (issue,) = find_issues(config)
        assert issue.path == ("cost", 0)
        assert issue.message.startswith("'holds' has no effect, as ")
        assert reason in issue.message
