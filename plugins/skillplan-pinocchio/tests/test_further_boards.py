"""The boards beyond the paper's, ruled on by swept hulls: the files' charts are right."""

from pathlib import Path

import pytest

from skillplan import Status
from skillplan.chart import derive_chart
from skillplan.pipeline import Setup, load_problem, make_feasibility, preview_problem, solve
from thinned import slow_case

CONFIGS = Path(__file__).parents[3] / "configs"
SWEPT = Setup(collision=("swept",))


@pytest.mark.parametrize(
    "name",
    [
        slow_case("battery_module", reason="another board in every run"),
        slow_case("relay_rail", reason="another board in every run"),
        "inverter_grasps",
    ],
)
def test_swept_derives_the_hand_made_chart(name):
    """Neither more nor less."""
    derived = derive_chart(make_feasibility(load_problem(CONFIGS / f"{name}.yaml").task, SWEPT))
    assert (derived.missing, derived.extra) == ((), ())
    assert not derived.impossible


@pytest.mark.parametrize(
    ("name", "solver"),
    [
        *(
            slow_case(name, "exact", reason="the inverter board in every run")
            for name in ("battery_module", "relay_rail")
        ),
        slow_case("inverter_grasps", "value-iteration", reason="another board in every run"),
    ],
)
def test_swept_gives_the_optimum_of_the_chart(name, solver):
    """Proved under both."""
    task = load_problem(CONFIGS / f"{name}.yaml").task
    by_hulls, by_chart = solve(task, solver, SWEPT), solve(task, solver)
    assert (by_hulls.status, by_chart.status) == ("optimal", "optimal")
    assert by_hulls.cost == pytest.approx(by_chart.cost)


@pytest.mark.parametrize(
    "count",
    [
        slow_case(
            2, reason="solves two more boards by hulls; every run solves the board itself by hulls"
        ),
        slow_case(12, reason="12 boards"),
    ],
)
def test_the_layouts_of_the_inverter_s_family_leave_room_for_the_hand(count):
    """The chart's optimum can be executed on all of them."""
    for task in load_problem(CONFIGS / "inverter_board.yaml").variants(5, count):
        by_hulls = solve(task, setup=SWEPT)
        assert by_hulls.status == "optimal", f"{task.name}: {by_hulls.reason}"
        assert by_hulls.cost == pytest.approx(solve(task).cost)


# The product of the examples, written from the documentation alone, has the plan it declares.


PROBLEM = load_problem(Path(__file__).parents[3] / "examples" / "sensor_box.yaml")


@pytest.mark.slow(reason="one product more; files that ship in every run")
def test_check_has_nothing_to_say_against_it():
    """Nothing that the arm cannot reach, nothing that overlaps or floats."""
    assert preview_problem(PROBLEM).warnings == ()


@pytest.mark.slow(reason="3 s of trajectories; that the arm reaches all is left in every run")
def test_its_quickest_plan_is_proved_by_trajectories():
    """The flange before the board, as the cup is at hand, and the shaft from the side at last."""
    result = solve(PROBLEM.task, setup=Setup(collision=("swept",)))
    expected = PROBLEM.config.expect
    assert result.status is Status.OPTIMAL
    assert result.cost == pytest.approx(expected.optimal_cost, abs=1e-3)
    assert [step.action for step in result.steps] == expected.optimal_actions
