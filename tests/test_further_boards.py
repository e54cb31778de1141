"""What the boards beyond the paper's are for: tools that must be changed, many parts, chance."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillplan import Setup, Status, Task, load_problem, make_model, solve
from skillplan.chart import derive_chart
from skillplan.pipeline import make_feasibility
from skillplan.task import ToolKind
from skillplan.testing import reachable_states

FOLDER = Path(__file__).parents[1] / "configs"
BY_BOXES = Setup(collision=("aabb",), with_chart=False)


def task_of(name: str) -> Task:
    return load_problem(FOLDER / f"{name}.yaml").task


@pytest.fixture(scope="module")
def battery():
    return task_of("battery_module")


@pytest.fixture(scope="module")
def rail():
    return task_of("relay_rail")


@pytest.fixture(scope="module")
def grasps():
    return task_of("inverter_grasps")


class TestTheBatteryModule:
    """Five tool changes are necessary, and one rash placement costs two more."""

    def test_it_has_three_kinds_of_tools(self, battery):
        """Jaws, suction and a bit, changed by one action each."""
        tools = battery.scene.robots[0].tools
        assert {ToolKind.GRIPPER, ToolKind.SUCTION, ToolKind.SCREWDRIVER} == {t.kind for t in tools}
        assert 3 == sum(skill.kind == "load" for skill in battery.skills)
        assert not any(skill.kind == "offload" for skill in battery.skills)

    def test_five_tool_changes_are_necessary(self, battery):
        """Parts and screws take 19 skills; there are plans of 24, and none is shorter."""
        assert 19 == sum(skill.kind != "load" for skill in battery.skills)
        assert solve(battery.replace(step_limit=24)).status is Status.OPTIMAL
        assert solve(battery.replace(step_limit=23)).status is Status.INFEASIBLE

    def test_its_step_limit_leaves_a_little_slack(self, battery):
        """As much as the paper's 20 for 15: a third."""
        assert 24 * 20 / 15 == battery.step_limit

    def test_a_terminal_put_down_too_late_costs_two_changes(self, battery):
        """Its screw cannot be driven with those of the cover any more."""
        late = battery.skill("place(terminal)")
        order = [step.skill for step in solve(battery).steps]
        assert order.index(late.name) < order.index("place(cell_cover)")
        state, before = battery.initial, [s for s in order if "terminal" not in s]
        for name in before:
            state = battery.skill(name).prediction.apply(state)
        rest = solve(battery.replace(initial=state))
        tools = [step.skill for step in rest.steps if step.skill.startswith("load")]
        assert ["load(screwdriver)"] == tools
        changes = sum(name.startswith("load") for name in before) + len(tools)
        assert 6 == changes

    def test_its_chart_follows_from_boxes(self, battery):
        """No line is drawn that geometry does not give, and none is missing."""
        derived = derive_chart(make_feasibility(battery, BY_BOXES))
        assert ((), ()) == (derived.missing, derived.extra)
        assert solve(battery, setup=BY_BOXES).cost == pytest.approx(solve(battery).cost)

    def test_it_observes_parts_screws_tool_and_hand(self, battery):
        """Two bits a part, one a screw, two for three tools, hand and last action."""
        assert 2 * 8 + 3 + 2 + 2 == len(battery.observation)
        facts = {literal.fact for literal in battery.observation}
        assert not any(fact.startswith("at(") for fact in facts)


class TestTheRelayRail:
    """Twelve parts, few rules, many orders."""

    def test_it_has_twelve_parts_and_thousands_of_states(self, rail):
        """In many of which a part is held that has no place yet."""
        model = make_model(rail)
        states = reachable_states(model, 100_000)
        stuck = [s for s in states if not model.is_goal(s) and not model.transitions(s)]
        assert (12, 2474, 627) == (len(rail.operations), len(states), len(stuck))

    def test_its_chart_but_for_the_fingers_follows_from_boxes(self, rail):
        """Boxes do not know why a terminal block comes before its relay."""
        derived = derive_chart(make_feasibility(rail, BY_BOXES))
        columns = tuple((f"terminal_{i}", f"relay_{i}") for i in range(1, 6))
        assert (columns, ()) == (derived.missing, derived.extra)

    @pytest.mark.slow(reason="solves the rail by boxes; by its chart in every run")
    def test_the_fingers_cost_two_centimetres(self, rail):
        """By boxes alone, a relay would come before its terminal block."""
        by_boxes, by_chart = solve(rail, setup=BY_BOXES), solve(rail)
        assert ("4.64289", "4.66386") == (f"{by_boxes.cost:.5f}", f"{by_chart.cost:.5f}")

    def test_hardly_two_moves_cost_the_same(self, rail):
        """Of the ways between two places: 250 and more of different length."""
        lengths = set()
        for skill in rail.skills:
            for fact in rail.scene.robots[0].places:
                lengths.add(round(skill.cost.at(rail.facts.of(fact)), 6))
        assert 250 < len(lengths)


class TestTheInverterWhoseGraspsFail:
    """The paper's board but for chance."""

    def test_it_is_the_board_but_for_chance(self, grasps):
        """The same parts, places, actions, observation, chart and reward."""
        board = task_of("inverter_board")
        assert [s.name for s in board.skills] == [s.name for s in grasps.skills]
        assert (board.observation, board.chart) == (grasps.observation, grasps.chart)
        assert board.scene.bodies == grasps.scene.bodies
        failing = {s.name for s in grasps.skills if not s.deterministic}
        parts = ("switch_1", "switch_2", "clock", "transformer")
        assert {f"pick({part})" for part in parts} == failing

    def test_without_chance_it_costs_what_the_board_does(self):
        """Every probability set to 0."""
        parts = ("switch_1", "switch_2", "clock", "transformer")
        changes = {f"parts.{part}.grasp_failure": "0" for part in parts}
        problem = load_problem(FOLDER / "inverter_grasps.yaml", changes=changes)
        assert "auto" == problem.domain.default_solver(problem.config)
        assert "1.86709" == f"{solve(problem.task).cost:.5f}"

    def test_if_misses_cost_no_way_it_costs_what_the_board_does(self):
        """Then only time is lost."""
        changes = {"robot.look_m": "null"}
        problem = load_problem(FOLDER / "inverter_grasps.yaml", changes=changes)
        result = solve(problem.task, "value-iteration")
        assert (Status.OPTIMAL, "1.86709") == (result.status, f"{result.cost:.5f}")
