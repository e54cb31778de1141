"""The boards beyond the paper's, ruled on by swept hulls: the files' charts are right."""

from pathlib import Path

import pytest

from skillplan.chart import derive_chart
from skillplan.pipeline import Setup, load_problem, make_feasibility, solve
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
