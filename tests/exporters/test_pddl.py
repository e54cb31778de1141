"""PDDL: what the texts say, what is refused, and what planners of others make of it."""

from __future__ import annotations

import random
import re
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from handovers import BY_CHART, CONFIGS, best, solved
from random_boards import board_text, seed_blocks
from situations import assembly, crowded_assemblies, model_of
from skillplan import exporters
from skillplan.collision import AabbDetector
from skillplan.domains.assembly import AssemblyConfig, BoardGenerator, ground
from skillplan.errors import OptionError
from skillplan.judge import fast_downward
from skillplan.model import replay
from skillplan.pipeline import Setup, export_files, load_problem, make_handover, make_model, solve
from skillplan.records import Status
from skillplan.task import Condition, Task
from thinned import release_case

BY_BOXES = Setup(collision=("aabb",))
CHARTED = ["battery_module", "inverter_ur5e", "relay_rail", "sensor_stack", "motor_drive"]
SEEDS = [(parts, seed) for seed, parts in enumerate((6, 7, 8, 9, 10, 12, 14, 16, 18, 20))]


@pytest.fixture(scope="session")
def planner():
    """Fast Downward, where it is installed."""
    try:
        fast_downward.find_driver()
    except OptionError as missing:
        pytest.skip(str(missing))


def handed(name: str, setup: Setup = BY_CHART) -> exporters.Handover:
    """Return a config without a plan."""
    model = make_model(load_problem(CONFIGS / f"{name}.yaml").task, setup)
    return make_handover(model, setup, None)


def generated(parts: int, seed: int) -> Task:
    """Return a board made at random, with six tenths of all pairs in order."""
    content = yaml.safe_load(BoardGenerator(parts, 0.6, 1, seed, "").text())
    return ground(AssemblyConfig.model_validate(content), "")


def agrees(handover: exporters.Handover) -> None:
    """Compare Fast Downward's optimum with ours: they differ by rounding alone."""
    assert handover.plan is not None
    planning_task = exporters.PlanningTask(handover, accept_rounding=True)
    answer = fast_downward.run_planner(planning_task, 140.0)
    assert answer.cost is not None, answer.silence
    per_unit = planning_task.scale.per_unit
    exported = int(planning_task.plan().split()[-3])
    assert exported == sum(round(step.cost * per_unit) for step in handover.plan.steps)
    assert answer.cost <= exported
    plan = replay(handover.model, [handover.task.skill(name) for name in answer.skills])
    rounding = (len(handover.skills) + len(answer.skills)) / 2 / per_unit
    assert plan.complete
    assert handover.plan.cost - 1e-9 <= plan.cost <= handover.plan.cost + rounding


def rack_task() -> Task:
    """Return three tools in a row of equal pitch, and a part each for two of them."""
    size = {"size_m": [0.01, 0.01, 0.01]}
    return assembly(
        {
            "kind": "assembly",
            "name": "rack",
            "robot": {"home_m": [0.307, 0.0]},
            "tools": {
                name: {"type": "suction", "holder_m": [0.6, y]}
                for name, y in (("b", 0.0), ("a", -0.1), ("c", 0.1))
            },
            "initial_tool": "a",
            "parts": {
                "p": {"tool": "c", "start_m": [0.45, 0.25], "goal_m": [0.35, -0.25], **size},
                "q": {"tool": "b", "start_m": [0.50, 0.25], "goal_m": [0.40, -0.25], **size},
            },
            "chart": [{"before": "p", "after": ["q"]}],
        }
    )


def bridge_content() -> Any:
    """Return three posts and a plate over them, as the content of a file."""
    post = {"tool": "cup", "size_m": [0.012, 0.03, 0.03]}
    parts = {
        f"post_{i}": {**post, "start_m": [0.3 + i / 10, 0.2], "goal_m": [0.4 + dx, -0.2]}
        for i, dx in enumerate((-0.03, 0.01, 0.03))
    }
    plate = {"tool": "cup", "size_m": [0.08, 0.03, 0.01], "start_m": [0.6, 0.2]}
    return {
        "kind": "assembly",
        "name": "bridge",
        "robot": {"home_m": [0.307, 0.0]},
        "tools": {"cup": {"type": "suction", "holder_m": [0.6, 0.0]}},
        "initial_tool": "cup",
        "parts": {**parts, "plate": {**plate, "goal_m": [0.4, -0.2], "goal_on": [*parts]}},
    }


class TestTheTexts:
    def test_there_is_an_action_a_skill_with_where_the_robot_stands_alone(self, board):
        """The chart is written out, and no list of a type is empty."""
        domain = exporters.PlanningTask(board).domain()
        assert 16 == domain.count("(:action ")
        assert {"(?from - location)"} == set(re.findall(r":parameters (\(.*\))", domain))
        brace = domain.partition("(:action place_brace")[2].partition("(:action")[0]
        assert {"(held part_brace)", "(placed part_transformer)"} <= set(
            re.findall(r"\(\w+ \w+\)", brace)
        )
        assert not re.search(r"forall|exists|\(or |\(when |\(either |\( - ", domain)

    def test_no_name_means_two_things(self, board):
        """A type, a predicate and an action of one name are an error to many planners."""
        domain = exporters.PlanningTask(board).domain()
        types = re.search(r"\(:types (.*) - object\)", domain)
        assert types
        names = types[1].split() + re.findall(r"\(:action (\S+)", domain)
        names += re.findall(r"(?m)^    \((\w+)[ )]", domain.partition("(:functions")[0])
        assert len(names) == len(set(names))

    def test_costs_are_whole_micrometres_and_the_file_says_by_how_much_they_are_off(self, board):
        """The plan costs 1.867086 m."""
        planning_task = exporters.PlanningTask(board)
        assert planning_task.plan().endswith("; cost = 1867086 (general cost)\n")
        assert "(= (cost-place_pcb location_pcb_start) 144000)" in planning_task.problem()
        assert "; Costs are in whole micrometres, rounded to the nearest." in planning_task.domain()
        assert "; Order of operations: the task's hand-made chart." in planning_task.domain()

    def test_every_name_stands_beside_its_identifier(self, board):
        """So that whoever reads the file knows what was meant."""
        assert ';   pick_switch_1 = "pick(switch_1)"\n' in exporters.PlanningTask(board).domain()

    def test_a_time_is_in_whole_microseconds(self):
        """Of the task's own figures, where the chart judges and nobody tells times."""
        planning_task = exporters.PlanningTask(handed("inverter_time"))
        assert "whole microseconds" in planning_task.domain()

    def test_a_matrix_of_whole_numbers_is_not_rounded(self):
        """And a node that cannot be reached from another has no cost from there."""
        model = make_model(load_problem(CONFIGS / "br17.10.sop").task, Setup())
        planning_task = exporters.PlanningTask(make_handover(model, Setup(), None))
        assert "not rounded" in planning_task.domain()
        assert "(from-visit_1 ?from - thing)" in planning_task.domain()


class TestConditionsAndCosts:
    """Actions of a skill, against the model in states that need not be reachable."""

    @settings(max_examples=examples(200, 10))
    @given(content=crowded_assemblies(odd_turns=False), seed=st.integers(0, 2**32))
    def test_in_every_state_actions_and_model_agree_on_verdict_and_cost(self, content, seed):
        """One action at least where the skill is feasible, each at its cost; else none."""
        task, rng = assembly(content), random.Random(seed)
        by_boxes = AabbDetector(task, AabbDetector.Options(check_support=rng.random() < 0.7))
        model = model_of(task, by_boxes)
        actions = exporters.PlanningTask(exporters.Handover(model), accept_rounding=True).variants
        states, facts = exporters.ConsistentStates(task), task.facts
        for _ in range(40):
            skill = rng.choice(task.skills)
            needs, bars = skill.precondition.requires.bits, skill.precondition.forbids.bits
            drawn = [1 << rng.randrange(len(facts)) for _ in range(6)]
            state = states.member((needs | drawn[0] | drawn[1], bars | sum({*drawn[2:]} - {0})))
            if state is None or not skill.applicable(state):
                continue
            fitting = [
                action
                for action in actions
                if action.skill is skill
                and Condition(action.requires, action.forbids).holds(state)
                and (not action.origins or {*action.origins} & {*state})
            ]
            assert bool(fitting) == model.verdict(state, skill).is_feasible
            for item in fitting:
                costs = [cost for place, cost in item.origins.items() if place in state]
                assert [model.cost(state, skill)] == (costs or [item.constant])

    def test_which_tool_is_put_back_decides_what_a_change_costs(self):
        """Also in a rack of equal pitch, where the shortest way is the same for two tools."""
        domain = exporters.PlanningTask(
            make_handover(model_of(rack_task()), BY_CHART, None)
        ).domain()
        loads = set(re.findall(r"\(:action (load_b\S*)", domain))
        assert {"load_b-tool_a", "load_b-tool_c"} == loads

    def test_a_choice_of_supports_is_an_action_each(self):
        """A plate stays up on any two of three posts that are not on one side."""
        task = assembly(bridge_content())
        planning_task = exporters.PlanningTask(
            make_handover(make_model(task, BY_BOXES), BY_BOXES, None)
        )
        domain = planning_task.domain()
        actions = re.findall(r"\(:action (place_plate\S*)\s.*\s.*:precondition (.*)", domain)
        assert ["place_plate-case_1", "place_plate-case_2"] == [name for name, _ in actions]
        posts = [set(re.findall(r"\(placed part_(post_\d)\)", needs)) for _, needs in actions]
        assert [{"post_0", "post_2"}, {"post_0", "post_1"}] == posts
        assert planning_task.left_out == ""

    def test_an_action_names_its_skill_without_asking_back_ends(self):
        """Whatever tells the actions of a skill apart stands behind a hyphen."""
        names = exporters.ActionNames(rack_task())
        assert "load(b)" == names.skill_of("LOAD_B-TOOL_A")
        assert names.skill_of("load_z-tool_a") is None


class TestWhatPddlCannotSay:
    def test_chance(self):
        """With what to do instead."""
        with pytest.raises(
            OptionError, match=r"pick\(switch_1\) is left to chance.*grasp_failure=0"
        ):
            export_files(exporters.PddlExporter(), handed("inverter_grasps"))

    def test_costs_that_planners_add_up_wrongly(self):
        """They have 32 bits; whole numbers are handed over as they are."""
        with pytest.raises(exporters.NoActionCosts, match="32 bits"):
            exporters.choose_scale([200.5], "m", 20)
        assert exporters.choose_scale([3.0, 4.0], "", 20).exact

    @pytest.mark.parametrize("small", [4e-7, 1.9e-5])
    def test_costs_that_rounding_may_hide_unless_that_is_accepted(self, small):
        """Twenty skills may be off by ten microseconds, and two plans against each other by 20."""
        with pytest.raises(
            exporters.NoActionCosts, match=r"plans could change places.*accept_rounding=true"
        ):
            exporters.choose_scale([1.5, small, 0.0], "s", 20)
        assert not exporters.choose_scale([1.5, small], "s", 20, accept_rounding=True).exact
        assert not exporters.choose_scale([1.5, 2.1e-5, 0.0], "s", 20).exact


class TestFastDownward:
    """An optimal planner that shares nothing with us."""

    @pytest.mark.parametrize("limit", [6, 5])
    def test_proves_the_step_limit_if_it_is_part_of_the_task(self, planner, limit):
        """The rack takes six skills; in five there is no plan."""
        model = make_model(rack_task().replace(step_limit=limit), BY_CHART)
        counted = exporters.PlanningTask(make_handover(model, BY_CHART, None), count_steps=True)
        answer = fast_downward.run_planner(counted, 60.0)
        assert (2_540_905 if limit == 6 else None) == answer.cost
        assert (limit == 5) == answer.unsolvable

    @pytest.mark.parametrize("seeds", seed_blocks(2, 14, 200, reason="two boards in every run"))
    def test_proves_what_exact_search_proves_with_one_to_four_tools(self, planner, tmp_path, seeds):
        """The exported plan costs what the result costs, and no plan costs less."""
        for seed in seeds:
            path = tmp_path / "board.yaml"
            path.write_text(board_text(seed, tmp_path, tight=False), "utf-8")
            task = load_problem(path).task
            setup = BY_BOXES if seed % 2 else BY_CHART
            if solve(task, "exact", setup).status is Status.INFEASIBLE:
                planning_task = exporters.PlanningTask(
                    make_handover(make_model(task, setup), setup, None)
                )
                assert fast_downward.run_planner(planning_task, 140.0).unsolvable, seed
            else:
                agrees(solved(task, setup))

    @pytest.mark.slow(reason="a planner of others; verify runs it in every run")
    def test_proves_the_board(self, planner, board):
        """1.867086 m, with the same skills."""
        agrees(board)

    @pytest.mark.slow(reason="seconds a config; the board in every run")
    @pytest.mark.parametrize("name", CHARTED)
    def test_proves_every_config_that_goes_by_its_chart(self, planner, name):
        """To within half a micrometre a skill."""
        agrees(best(name))

    @pytest.mark.slow(reason="seconds a config; the board in every run")
    def test_proves_least_times_by_the_chart(self, planner):
        """In whole microseconds, of the task's own figures."""
        agrees(solved(load_problem(CONFIGS / "inverter_time.yaml").task))

    @pytest.mark.slow(reason="seconds a board; the inverter board in every run")
    @pytest.mark.parametrize(
        ("parts", "seed"),
        [
            release_case(parts, seed, reason="ten seconds; larger boards in the whole suite")
            if parts == 16
            else (parts, seed)
            for parts, seed in SEEDS
        ],
    )
    def test_proves_boards_made_at_random(self, planner, parts, seed):
        """Of 6 to 20 parts."""
        agrees(solved(generated(parts, seed)))

    def test_that_is_not_installed_is_a_message(self, monkeypatch):
        """It says which extra has it."""
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
        with pytest.raises(OptionError, match=r"pip install 'skillplan\[planner\]'"):
            fast_downward.find_driver()


@pytest.mark.slow(reason="unified-planning takes seconds to import; texts are read in every run")
@pytest.mark.filterwarnings("ignore")
def test_a_validator_takes_the_plan_and_refuses_a_wrong_order(board):
    """Unified-planning reads domain, problem and plan, and knows what the plan costs."""
    io: Any = pytest.importorskip("unified_planning.io", reason="unified-planning: skillplan[test]")
    shortcuts: Any = pytest.importorskip("unified_planning.shortcuts")
    planning_task = exporters.PlanningTask(board)
    reader = io.PDDLReader()
    problem = reader.parse_problem_string(planning_task.domain(), planning_task.problem())

    def judged(lines: list[str]) -> Any:
        plan = reader.parse_plan_string(problem, "\n".join(lines))
        with shortcuts.PlanValidator(problem_kind=problem.kind) as validator:
            return validator.validate(problem, plan)

    lines = planning_task.plan().splitlines()
    good = judged(lines)
    assert "VALID" == good.status.name
    assert [1_867_086] == list(good.metric_evaluations.values())
    assert "INVALID" == judged([*lines[2:4], *lines[:2], *lines[4:]]).status.name
