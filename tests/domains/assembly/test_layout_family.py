"""Families of layouts: the same product, laid out at random, every layout without a fault."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import config_content
from skillplan.domains.assembly import (
    AssemblyConfig,
    AssemblyDomain,
    find_issues,
    get_layout,
    measure_distances_m,
)
from skillplan.errors import OptionError, TaskError
from skillplan.pipeline import Setup, load_problem, solve
from thinned import slow_case

CONFIGS = Path(__file__).parents[3] / "configs"
BOARD = CONFIGS / "inverter_board.yaml"
SEEDS = st.integers(0, 2**31)


@pytest.fixture(scope="module")
def board():
    return load_problem(BOARD)


def config_of(name: str = "inverter_board", **family: float) -> AssemblyConfig:
    """Return the content of a file in configs/ with another block ``family``."""
    content = config_content(name)
    if family:
        content["family"] = family
    return AssemblyConfig.model_validate(content, context={"folder": CONFIGS})


def variants(config: AssemblyConfig, seed: int = 0, count: int = 3) -> list[AssemblyConfig]:
    return AssemblyDomain().variants(config, seed, count)


class TestLayouts:
    @given(seed=SEEDS)
    @settings(max_examples=examples(25))
    def test_every_one_is_faultless(self, seed):
        """By all that a file is checked for."""
        for layout in variants(config_of(), seed):
            assert [] == find_issues(layout)

    @given(seed=SEEDS)
    @settings(max_examples=examples(25))
    def test_starts_move_by_themselves_and_goals_together(self, seed):
        """No further than the family says; what is given in millimetres stays in tenths of them."""
        config = config_of(start_shift_m=0.03, goal_shift_m=0.02)
        (layout,) = variants(config, seed, 1)
        moved = {name: moves("start", config, layout, name) for name in config.parts}
        assert len(set(moved.values())) == len(moved)
        assert all(abs(shift) <= 0.03 for shifts in moved.values() for shift in shifts)
        together = {moves("goal", config, layout, name) for name in config.parts}
        together |= {
            shifts(
                get_layout(config).hole(config.screws[name]),
                get_layout(layout).hole(layout.screws[name]),
            )
            for name in config.screws
        }
        ((x_m, y_m),) = together
        assert max(abs(x_m), abs(y_m)) <= 0.02
        assert config.tools == layout.tools

    @given(seed=SEEDS)
    @settings(max_examples=examples(25))
    def test_parts_keep_the_gap_that_is_asked_for(self, seed):
        """From where others lie and belong; where the file has less, no less than that."""
        config = config_of(start_shift_m=0.04, goal_shift_m=0.02, gap_m=0.03)
        assert config.family is not None
        known_m = measure_distances_m(config)
        assert 0 < min(known_m.values()) < 0.03
        for layout in variants(config, seed):
            for pair, apart_m in measure_distances_m(layout).items():
                assert apart_m >= min(config.family.gap_m, known_m[pair]) - 1e-9

    def test_what_lies_on_a_part_moves_along_and_feeders_stay(self):
        """A stack stays a stack, and a part from a feeder comes from there."""
        config = config_of("motor_drive", start_shift_m=0.01)
        (layout,) = variants(config, count=1)
        stack = [moves("start", config, layout, name) for name in ("heat_sink", "bridge")]
        assert stack[0] == stack[1] != (0.0, 0.0)
        assert (0.0, 0.0) == moves("start", config, layout, "clip_1")
        assert config.feeders == layout.feeders

    @pytest.mark.slow(reason="tries many layouts; the other errors in every run")
    def test_one_that_is_never_faultless_is_an_error_that_names_the_fault(self):
        """A metre to and fro puts one of twelve parts out of reach, or close to another."""
        with pytest.raises(OptionError, match="has no faultless layout 0 with seed 7") as caught:
            variants(config_of("motor_drive", start_shift_m=1.0, gap_m=0.1), 7)
        assert "parts." in str(caught.value) or "lies" in str(caught.value)
        assert "Lower the lengths of its block 'family'" in str(caught.value)

    def test_meshes_come_along(self):
        """What was read from files once is not read again."""
        config = config_of("sensor_stack", start_shift_m=0.01)
        for layout in variants(config):
            assert config.parts["coil"].meshes == layout.parts["coil"].meshes
            (mesh,) = layout.parts["coil"].meshes or ()
            assert 12 == len(mesh.corners)


class TestFamily:
    @pytest.mark.slow(reason="grounds several boards; the same seed in every run")
    @given(seed=SEEDS)
    @settings(max_examples=10)
    def test_its_tasks_differ_in_costs_alone(self, seed):
        """The same facts, skills, chart, goal, observation and reward."""
        problem = load_problem(BOARD)
        for task in problem.variants(seed, 3):
            mine = problem.task
            assert (mine.facts, mine.chart, mine.goal) == (task.facts, task.chart, task.goal)
            assert (mine.observation, mine.reward) == (task.observation, task.reward)
            assert mine.initial == task.initial
            costs = []
            for skill, other in zip(mine.skills, task.skills, strict=True):
                assert (skill.name, skill.precondition) == (other.name, other.precondition)
                assert skill.outcomes == other.outcomes
                if skill.applicable(mine.initial):
                    costs.append((skill.cost.at(mine.initial), other.cost.at(mine.initial)))
            assert any(not math.isclose(first, other) for first, other in costs)

    @pytest.mark.slow(reason="draws families twice; their names and hashes in every run")
    def test_the_same_seed_gives_the_same_and_more_begin_with_the_same(self, board):
        """So that some may be learned on and others kept unseen."""
        hashes = [task.sha256 for task in board.variants(3, 8)]
        assert hashes == [task.sha256 for task in board.variants(3, 8)]
        assert hashes[:5] == [task.sha256 for task in board.variants(3, 5)]
        assert not set(hashes) & {task.sha256 for task in board.variants(4, 8)}

    def test_each_has_a_name_and_a_hash_of_its_own(self, board):
        """Numbered after the file's task."""
        tasks = board.variants(0, 12)
        assert [f"inverter-board/{i}" for i in range(12)] == [task.name for task in tasks]
        assert 13 == len({board.sha256, *(task.sha256 for task in tasks)})
        assert all(len(task.sha256) == 64 for task in tasks)

    def test_the_block_is_no_part_of_the_task(self, board):
        """With another one, or none, a file is the same task."""
        other = load_problem(BOARD, changes={"family.gap_m": "0.01"})
        assert other.sha256 == board.sha256
        assert other.variants(0, 1)[0].sha256 != board.variants(0, 1)[0].sha256

    @pytest.mark.parametrize(("count", "orders"), [(3, 2), slow_case(40, 4, reason="40 boards")])
    def test_every_optimum_is_proved_at_once(self, board, count, orders):
        """With several orders among them, in seconds."""
        tasks = board.variants(1, count)
        begin_s = time.perf_counter()
        results = [solve(task) for task in tasks]
        assert time.perf_counter() - begin_s < 20
        assert {"optimal"} == {str(result.status) for result in results}
        assert orders <= len({tuple(s.action for s in result.steps) for result in results})
        assert count == len({f"{result.cost:.9f}" for result in results})

    @pytest.mark.slow(reason="solves eight boards by boxes; one board by boxes in every run")
    def test_the_chart_is_right_on_all_of_them(self, board):
        """By boxes, which know starts and goals, the same optimum."""
        for task in board.variants(2, 8):
            by_boxes = solve(task, setup=Setup(collision=("aabb",)))
            assert by_boxes.cost == pytest.approx(solve(task).cost)

    @pytest.mark.slow(reason="grounds a family; another family in every run")
    def test_one_whose_grasps_fail_has_a_family_too(self):
        """The probabilities stay."""
        changes = {"family.start_shift_m": "0.01"}
        problem = load_problem(CONFIGS / "inverter_grasps.yaml", changes=changes)
        for task in problem.variants(0, 2):
            assert solve(task, "value-iteration").status == "optimal"
            assert task.skill("pick(clock)").outcomes == problem.task.skill("pick(clock)").outcomes


class TestBadInput:
    def test_a_file_without_the_block_has_none(self):
        """The message says what to write."""
        problem = load_problem(CONFIGS / "sensor_stack.yaml")
        with pytest.raises(OptionError, match=r"describes no family of layouts\. Give it a block"):
            problem.variants(0, 1)

    def test_another_kind_has_none(self):
        """In words."""
        problem = load_problem(CONFIGS / "swarmitfix_triangular.yaml")
        with pytest.raises(OptionError, match="kind 'swarmitfix' have no families of layouts"):
            problem.variants(0, 1)

    @pytest.mark.parametrize(("seed", "count"), [(-1, 1), (0, 0), (0, -3)])
    def test_numbers_are_in_range(self, board, seed, count):
        """A family of none is no family."""
        with pytest.raises(OptionError, match="seed >= 0 and count >= 1"):
            board.variants(seed, count)

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"family": "{}"}, "give 'start_shift_m' or 'goal_shift_m' above 0"),
            ({"family": "{start_shift_m: -0.1}"}, "family.start_shift_m"),
            ({"family": "{start_shift: 0.1}"}, "start_shift_m"),
            ({"family": "{goal_shift_m: 2}"}, "family.goal_shift_m"),
            ({"family": "0.05"}, "family: must be a mapping"),
        ],
    )
    def test_lengths_are_in_range_and_something_moves(self, changes, message):
        """One line each."""
        with pytest.raises(TaskError) as caught:
            load_problem(BOARD, changes=changes)
        (line,) = str(caught.value).splitlines()
        assert message in line


def moves(
    place: str, config: AssemblyConfig, drawn: AssemblyConfig, name: str
) -> tuple[float, float]:
    """Return the shift of a part's start or goal in x and y [m]."""
    before, after = (
        getattr(get_layout(layout), place)(name).pose.position for layout in (config, drawn)
    )
    return shifts(before, after)


def shifts(first: tuple[float, ...], other: tuple[float, ...]) -> tuple[float, float]:
    assert first[2] == other[2]
    return round(other[0] - first[0], 6), round(other[1] - first[1], 6)
