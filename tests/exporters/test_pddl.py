"""PDDL: what the texts say, what is refused, and what planners of others make of it."""

from __future__ import annotations

import re
from typing import Any

import pytest
import yaml

from handovers import BY_CHART, CONFIGS, best, solved
from skillplan.domains.assembly.board_generator import BoardGenerator
from skillplan.domains.assembly.grounding import ground
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import OptionError
from skillplan.exporters.handover import Handover
from skillplan.exporters.pddl.action_costs import NoActionCosts, scale_of
from skillplan.exporters.pddl.exporter import PddlExporter
from skillplan.exporters.pddl.planning_task import PlanningTask
from skillplan.judge import fast_downward
from skillplan.pipeline.exchange.export import exported, handed_over
from skillplan.pipeline.run import make_model
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.task.task import Task

CHARTED = ["battery_module", "inverter_ur5e", "relay_rail", "sensor_stack", "motor_drive"]
SEEDS = [(parts, seed) for seed, parts in enumerate((6, 7, 8, 9, 10, 12, 14, 16, 18, 20))]


@pytest.fixture(scope="session")
def planner() -> None:
    """Fast Downward, where it is installed."""
    try:
        fast_downward.driver()
    except OptionError as missing:
        pytest.skip(str(missing))


def handed(name: str, setup: Setup = BY_CHART, *, derived: bool = False) -> Handover:
    """Return a config without a plan."""
    model = make_model(load_problem(CONFIGS / f"{name}.yaml").task, setup)
    return handed_over(model, setup, None, derived=derived)


def generated(parts: int, seed: int) -> Task:
    """Return a board made at random, with six tenths of all pairs in order."""
    content = yaml.safe_load(BoardGenerator(parts, 0.6, 1, seed, "").text())
    return ground(AssemblyConfig.model_validate(content), "")


def agrees(handover: Handover) -> None:
    """Hold Fast Downward's optimum against ours, which may differ by rounding alone."""
    assert handover.plan is not None
    made = PlanningTask(handover)
    answer = fast_downward.asked(made, 140.0)
    assert answer.cost is not None, answer.silence
    least_m = answer.cost / made.scale.per_unit
    rounding_m = len(handover.skills) / 2 * 1e-6
    assert abs(least_m - handover.plan.cost) <= rounding_m
    assert sorted(answer.skills) == sorted(one.skill.name for one in handover.skills)


class TestTheTexts:
    def test_there_is_an_action_a_skill_with_where_the_robot_stands_alone(
        self, board: Handover
    ) -> None:
        """The chart is written out, and no list of a type is empty."""
        domain = PlanningTask(board).domain()
        assert 16 == domain.count("(:action ")
        assert {"(?from - location)"} == set(re.findall(r":parameters (\(.*\))", domain))
        brace = domain.partition("(:action place_brace")[2].partition("(:action")[0]
        assert {"(held part_brace)", "(placed part_transformer)"} <= set(
            re.findall(r"\(\w+ \w+\)", brace)
        )
        assert not re.search(r"forall|exists|\(or |\(when |\(either |\( - ", domain)

    def test_no_name_means_two_things(self, board: Handover) -> None:
        """A type, a predicate and an action of one name are an error to many planners."""
        domain = PlanningTask(board).domain()
        types = re.search(r"\(:types (.*) - object\)", domain)
        assert types
        names = types[1].split() + re.findall(r"\(:action (\S+)", domain)
        names += re.findall(r"(?m)^    \((\w+)[ )]", domain.partition("(:functions")[0])
        assert len(names) == len(set(names))

    def test_costs_are_whole_micrometres_and_the_file_says_by_how_much_they_are_off(
        self, board: Handover
    ) -> None:
        """The plan costs 1.867086 m."""
        made = PlanningTask(board)
        assert made.plan().endswith("; cost = 1867086 (general cost)\n")
        assert "(= (cost-place_pcb location_pcb_start) 144000)" in made.problem()
        assert "; Costs are in whole micrometres, rounded to the nearest." in made.domain()
        assert "; Order of operations: the task's hand-made chart." in made.domain()

    def test_every_name_stands_beside_its_identifier(self, board: Handover) -> None:
        """So that whoever reads the file knows what was meant."""
        assert ';   pick_switch_1 = "pick(switch_1)"\n' in PlanningTask(board).domain()

    def test_a_time_is_in_whole_microseconds(self) -> None:
        """Of the task's own figures, where the chart judges and nobody tells times."""
        made = PlanningTask(handed("inverter_time"))
        assert "whole microseconds" in made.domain()

    def test_a_matrix_of_whole_numbers_is_not_rounded(self) -> None:
        """And a node that cannot be reached from another has no cost from there."""
        model = make_model(load_problem(CONFIGS / "br17.10.sop").task, Setup())
        made = PlanningTask(handed_over(model, Setup(), None))
        assert "not rounded" in made.domain()
        assert "(from-visit_1 ?from - thing)" in made.domain()


class TestWhatPddlCannotSay:
    def test_chance(self) -> None:
        """With what to do instead."""
        with pytest.raises(
            OptionError, match=r"pick\(switch_1\) is left to chance.*grasp_failure=0"
        ):
            exported(PddlExporter(), handed("inverter_grasps"))

    def test_verdicts_that_are_no_order(self) -> None:
        """Unless the order that they come to is wanted; the file then says where it is from."""
        by_boxes = Setup(collision=("aabb",))
        with pytest.raises(OptionError, match="kinematic, aabb judge each skill in each state"):
            exported(PddlExporter(), handed("inverter_board", by_boxes))
        files = exported(PddlExporter(), handed("inverter_board", by_boxes, derived=True))
        assert "derived from the verdicts of kinematic, aabb" in str(files["domain.pddl"])

    def test_costs_that_planners_add_up_wrongly(self) -> None:
        """They have 32 bits; whole numbers are handed over as they are."""
        with pytest.raises(NoActionCosts, match="32 bits"):
            scale_of([200.5], "m", 20)
        assert scale_of([3.0, 4.0], "", 20).exact

    @pytest.mark.parametrize("small", [4e-7, 1.9e-5])
    def test_costs_that_rounding_may_hide_unless_that_is_accepted(self, small: float) -> None:
        """Twenty skills may be off by ten microseconds, and two plans against each other by 20."""
        with pytest.raises(NoActionCosts, match=r"plans could change places.*accept_rounding=true"):
            scale_of([1.5, small, 0.0], "s", 20)
        assert not scale_of([1.5, small], "s", 20, accept_rounding=True).exact
        assert not scale_of([1.5, 2.1e-5, 0.0], "s", 20).exact


class TestFastDownward:
    """An optimal planner that shares nothing with us."""

    @pytest.mark.slow(reason="a planner of others; verify runs it in every run")
    def test_proves_the_board(self, planner: None, board: Handover) -> None:
        """1.867086 m, with the same skills."""
        agrees(board)

    @pytest.mark.slow(reason="seconds a config; the board in every run")
    @pytest.mark.parametrize("name", CHARTED)
    def test_proves_every_config_that_goes_by_its_chart(self, planner: None, name: str) -> None:
        """To within half a micrometre a skill."""
        agrees(best(name))

    @pytest.mark.slow(reason="seconds a config; the board in every run")
    def test_proves_least_times_by_the_chart(self, planner: None) -> None:
        """In whole microseconds, of the task's own figures."""
        agrees(solved(load_problem(CONFIGS / "inverter_time.yaml").task))

    @pytest.mark.slow(reason="up to half a minute a board; the inverter board in every run")
    @pytest.mark.parametrize(("parts", "seed"), SEEDS)
    def test_proves_boards_made_at_random(self, planner: None, parts: int, seed: int) -> None:
        """Of 6 to 20 parts."""
        agrees(solved(generated(parts, seed)))

    def test_that_is_not_installed_is_a_message(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """It says which extra has it."""
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
        with pytest.raises(OptionError, match=r"pip install 'skillplan\[planner\]'"):
            fast_downward.driver()


@pytest.mark.slow(reason="unified-planning takes seconds to import; texts are read in every run")
@pytest.mark.filterwarnings("ignore")
def test_a_validator_takes_the_plan_and_refuses_a_wrong_order(board: Handover) -> None:
    """Unified-planning reads domain, problem and plan, and knows what the plan costs."""
    io: Any = pytest.importorskip("unified_planning.io", reason="unified-planning: skillplan[test]")
    shortcuts: Any = pytest.importorskip("unified_planning.shortcuts")
    made = PlanningTask(board)
    reader = io.PDDLReader()
    problem = reader.parse_problem_string(made.domain(), made.problem())

    def judged(lines: list[str]) -> Any:
        plan = reader.parse_plan_string(problem, "\n".join(lines))
        with shortcuts.PlanValidator(problem_kind=problem.kind) as validator:
            return validator.validate(problem, plan)

    lines = made.plan().splitlines()
    good = judged(lines)
    assert "VALID" == good.status.name
    assert [1_867_086] == list(good.metric_evaluations.values())
    assert "INVALID" == judged([*lines[2:4], *lines[:2], *lines[4:]]).status.name
