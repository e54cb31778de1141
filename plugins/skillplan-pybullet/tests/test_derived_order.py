"""The order of a product comes from executing its skills: change the product, and it changes.

Nothing here is told a chart. What back ends derive is held against the chart of the file where
there is one, and what the search finds against brute force under the derived relation.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import pytest

from board_situations import BOARD, OPTIMAL, changed_product
from situations import config_content
from skillplan.chart import DerivedChart, closure, derive_chart, reduction
from skillplan.checks import VerdictCache
from skillplan.pipeline import Setup, load_problem, make_feasibility, solve
from skillplan.records import Result, Status
from skillplan.task import Precedence, Task
from thinned import release_case, slow_case, thinned

SETUPS = {
    "swept": Setup(collision=("swept",)),
    "physics": Setup(physics="pybullet", collision=("contact-pairs",)),
}
ALL = list(SETUPS)
# An execution takes half a second: most changed products are executed in the whole suite only.
SLOW_BY_PHYSICS = ["swept", slow_case("physics", reason="by swept hulls in every run")]
# Of those, some are executed before a release only.
RELEASED_BY_PHYSICS = ["swept", release_case("physics", reason="other products in the whole suite")]


@dataclass(frozen=True)
class Answer:
    """What back ends make of a product that comes without a chart."""

    task: Task
    optimum: Result
    chart: DerivedChart

    @property
    def pairs(self) -> set[tuple[str, str]]:
        """The derived relation, with all that follows from it."""
        return closure((relation.before, relation.after) for relation in self.chart.relations)

    @property
    def order(self) -> list[str]:
        """The elements in the order in which the best plan puts them in place."""
        of = {fact: element for element, fact in self.task.operations.items()}
        skills = [self.task.skill(step.skill) for step in self.optimum.steps]
        return [of[fact] for skill in skills for fact in skill.prediction.add if fact in of]

    def reason(self, before: str, after: str) -> str:
        """Return why one element has to come before another."""
        (results,) = [
            relation.reason
            for relation in self.chart.relations
            if (relation.before, relation.after) == (before, after)
        ]
        return results


def answer(task: Task, back_end: str) -> Answer:
    """Search and chart a product without the chart of its file; the search comes first, cold."""
    if back_end == "swept":
        pytest.importorskip("pinocchio", reason="pinocchio is optional here")
    bare = task.replace(chart=(), collision=())
    cache = VerdictCache()
    setup = SETUPS[back_end]
    optimum = solve(bare, "exact", setup, cache=cache)
    return Answer(bare, optimum, derive_chart(make_feasibility(bare, setup, cache)))


def least_cost_under(expected: Answer) -> float | None:
    """Return what the best plan costs by brute force, where only the derived relation counts."""
    lines = tuple(
        Precedence(relation.before, relation.after) for relation in expected.chart.relations
    )
    charted = expected.task.replace(chart=lines)
    return solve(charted, "exhaustive", Setup(collision=("precedence",))).cost


def assert_settled(expected: Answer) -> None:
    """Assert that the relation says all there is to say, and that the search agrees with it."""
    assert expected.chart.impossible == {}
    assert expected.chart.cycle == ()
    assert expected.chart.conditional == {}
    assert expected.chart.undecided == ()
    assert expected.optimum.status is Status.OPTIMAL
    assert expected.optimum.cost == pytest.approx(least_cost_under(expected), abs=1e-9)


def assert_equals_the_chart_of(task: Task, expected: Answer) -> None:
    """Assert that nothing of the hand-made chart is missing, and that there is nothing extra."""
    by_hand = closure((line.before, line.after) for line in task.chart)
    assert by_hand
    assert by_hand - expected.pairs == set()
    assert expected.pairs - by_hand == set()


@functools.cache
def board(back_end: str) -> Answer:
    """Return what a back end makes of the paper's board."""
    return answer(load_problem(BOARD).task, back_end)


class TestThePapersBoard:
    @pytest.mark.slow(reason="derives the whole relation; CI does so by a command")
    @pytest.mark.parametrize("back_end", RELEASED_BY_PHYSICS)
    def test_the_derived_relation_is_the_hand_made_chart(self, back_end):
        result = board(back_end)
        assert_settled(result)
        assert_equals_the_chart_of(load_problem(BOARD).task, result)

    @pytest.mark.parametrize("back_end", RELEASED_BY_PHYSICS)
    def test_the_optimum_needs_no_chart(self, back_end):
        optimum = board(back_end).optimum
        assert optimum.cost == pytest.approx(1.86709, abs=5e-6)
        assert tuple(step.action for step in optimum.steps) == OPTIMAL
        assert optimum.checks <= 60


class TestTheSensorStack:
    @pytest.mark.slow(reason="derives a second order; that of the board in every run")
    @pytest.mark.parametrize("back_end", RELEASED_BY_PHYSICS)
    def test_a_product_of_another_order_has_another_relation(self, back_end):
        task = load_problem(BOARD.parent / "sensor_stack.yaml").task
        result = answer(task, back_end)
        assert_settled(result)
        assert_equals_the_chart_of(task, result)
        assert result.optimum.cost == pytest.approx(2.82515, abs=5e-6)


@pytest.mark.slow(reason="derives an order without a part; that of the board in every run")
@pytest.mark.parametrize("back_end", RELEASED_BY_PHYSICS)
class TestAPartTakenAway:
    def test_its_relations_go_with_it_and_the_rest_stays(self, tmp_path, back_end):
        content = config_content("inverter_board")
        del content["parts"]["transformer"]
        result = answer(changed_product(tmp_path, content), back_end)
        assert_settled(result)
        assert reduction(result.pairs) == {
            ("pcb", "switch_1"),
            ("pcb", "switch_2"),
            ("pcb", "clock"),
            ("pcb", "brace"),
            ("brace", "screw_1"),
            ("brace", "screw_2"),
        }
        # Now that nothing has to go under the brace, the clock is better put before it.
        assert result.order == [
            *("pcb", "switch_1", "switch_2", "clock", "brace", "screw_1", "screw_2")
        ]
        assert result.optimum.cost == pytest.approx(1.494696, abs=1e-6)


@pytest.mark.parametrize("back_end", RELEASED_BY_PHYSICS)
class TestAStackSwapped:
    """A column of the sensor stack: spacer and sensor on a base, under a cover."""

    def column(self, folder, back_end, below, above):
        content = config_content("sensor_stack")
        content["parts"][below]["goal_on"] = "base"
        content["parts"][above]["goal_on"] = below
        result = answer(
            changed_product(folder, content, "base", "spacer", "sensor", "cover"), back_end
        )
        assert_settled(result)
        return result

    @pytest.mark.parametrize(
        ("below", "above", "cost"),
        thinned(
            [("spacer", "sensor", 1.611661), ("sensor", "spacer", 1.596377)],
            ("sensor", "spacer", 1.596377),
            why="the other stack in every run",
        ),
    )
    def test_what_lies_below_comes_first(self, tmp_path, back_end, below, above, cost):
        result = self.column(tmp_path, back_end, below, above)
        assert reduction(result.pairs) == {("base", below), (below, above), (above, "cover")}
        assert result.order == ["base", below, above, "cover"]
        assert result.optimum.cost == pytest.approx(cost, abs=1e-6)


class TestAPartNextToAFinger:
    def beside_a_switch(self, folder, back_end, height_m):
        """Put the clock 37 mm beside a switch, on the side where a finger goes down."""
        content = config_content("inverter_board")
        content["parts"]["clock"] |= {"goal_m": [0.476, 0.040], "size_m": [0.02, 0.02, height_m]}
        content["parts"]["switch_2"]["start_m"] = [0.504, 0.134]
        result = answer(changed_product(folder, content, "pcb", "switch_2", "clock"), back_end)
        assert_settled(result)
        return result

    @pytest.mark.parametrize("back_end", SLOW_BY_PHYSICS)
    def test_a_low_one_may_come_before_or_after(self, tmp_path, back_end):
        result = self.beside_a_switch(tmp_path, back_end, 0.015)
        assert result.pairs == {("pcb", "switch_2"), ("pcb", "clock")}
        assert result.order == ["pcb", "clock", "switch_2"]
        assert result.optimum.cost == pytest.approx(0.755367, abs=1e-6)

    @pytest.mark.parametrize("back_end", RELEASED_BY_PHYSICS)
    def test_a_tall_one_has_to_come_after_at_a_cost(self, tmp_path, back_end):
        result = self.beside_a_switch(tmp_path, back_end, 0.060)
        assert result.pairs == {("pcb", "switch_2"), ("pcb", "clock"), ("switch_2", "clock")}
        reason = result.reason("switch_2", "clock")
        assert "finger" in reason
        assert "clock" in reason
        assert result.order == ["pcb", "switch_2", "clock"]
        assert result.optimum.cost == pytest.approx(0.800953, abs=1e-6)


@pytest.mark.parametrize("back_end", SLOW_BY_PHYSICS)
class TestFingersOnOtherSides:
    def gripped(self, folder, back_end, closing_axis):
        content = config_content("inverter_board")
        content["parts"]["transformer"]["grasp"] = {"closing_axis": closing_axis}
        result = answer(
            changed_product(folder, content, "pcb", "switch_2", "transformer"), back_end
        )
        assert_settled(result)
        return result

    def test_where_they_meet_nothing_the_way_decides(self, tmp_path, back_end):
        result = self.gripped(tmp_path, back_end, "y")
        assert result.pairs == {("pcb", "switch_2"), ("pcb", "transformer")}
        assert result.order == ["pcb", "switch_2", "transformer"]

    def test_where_they_meet_a_switch_it_has_to_come_after(self, tmp_path, back_end):
        result = self.gripped(tmp_path, back_end, "x")
        assert result.pairs == {
            *(("pcb", "switch_2"), ("pcb", "transformer"), ("transformer", "switch_2"))
        }
        reason = result.reason("transformer", "switch_2")
        assert "finger" in reason
        assert "switch_2" in reason
        assert result.order == ["pcb", "transformer", "switch_2"]
