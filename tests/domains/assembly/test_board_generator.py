"""Boards at random: without a fault, as dense as asked for, comparable with each other."""

from __future__ import annotations

import dataclasses
import math
import random
import tempfile
from collections.abc import Mapping
from itertools import combinations, pairwise, permutations
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.chart import closure, cycle, derive_chart, reduction
from skillplan.domains.assembly import MOST_PARTS, MOST_TOOLS, BoardGenerator, RandomOrder
from skillplan.errors import OptionError
from skillplan.pipeline import Setup, load_problem, make_feasibility, solve
from skillplan.records import Status
from skillplan.task import Task
from thinned import slow_case
from yaml_data import yaml_text

BOARDS = st.builds(
    BoardGenerator,
    parts=st.integers(1, 40),
    density=st.floats(0, 1),
    tools=st.integers(1, MOST_TOOLS),
    seed=st.integers(0, 2**63 - 1),
)


def content(board: BoardGenerator) -> Any:
    return yaml_text(board.text())


def loaded(board: BoardGenerator) -> Task:
    """Return the task of a board, which has no fault."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "board.yaml"
        path.write_text(board.text(), "utf-8")
        return load_problem(path).task


def order(task: Task) -> set[tuple[str, str]]:
    return closure((line.before, line.after) for line in task.chart)


def but_for(parts: Mapping[str, Any], key: str) -> dict[str, Any]:
    return {name: {k: v for k, v in part.items() if k != key} for name, part in parts.items()}


class TestAnyBoard:
    @settings(max_examples=examples(40))
    @given(board=BOARDS)
    def test_it_is_a_faultless_task(self, board):
        """By all that a file is checked for: names, reach, overlap, circles, step limit."""
        task = loaded(board)
        assert board.parts == len(task.operations)
        assert board.task_name == task.name
        assert 2 * board.parts + board.tools == len(task.skills)

    @settings(max_examples=examples(40))
    @given(board=BOARDS)
    def test_its_chart_has_the_density_to_the_nearest_pair(self, board):
        """The pairs that its closure orders; without any there is no chart."""
        task = loaded(board)
        result = order(task)
        assert () == cycle(result)
        assert board.ordered_pairs == len(result)
        assert abs(len(result) - board.density * board.pairs) <= 0.5
        assert ("chart" in content(board)) == bool(result)

    @settings(max_examples=examples(40))
    @given(board=BOARDS)
    def test_all_tools_are_used(self, board):
        """As many as there are parts for."""
        created = content(board)
        used = {part["tool"] for part in created["parts"].values()}
        assert min(board.parts, board.tools) == len(used)
        assert used <= set(created["tools"])

    @given(board=BOARDS)
    def test_the_same_arguments_write_the_same_text(self, board):
        """To the letter; and its second line says which they are."""
        assert board.text() == dataclasses.replace(board).text()
        assert board.text().isascii()
        words = board.text().splitlines()[1].split(": ", 1)[1].split()
        assert ["skillplan", "generate", "assembly"] == words[:3]
        given_to = dict(zip(words[3::2], words[4::2], strict=True))
        assert board == BoardGenerator(
            int(given_to["--parts"]),
            float(given_to["--density"]),
            int(given_to["--tools"]),
            int(given_to["--seed"]),
        )


class TestBoardsOfASeed:
    @settings(max_examples=examples(40))
    @given(board=BOARDS, density=st.floats(0, 1))
    def test_another_density_changes_the_chart_only(self, board, density):
        """Shapes, starts, goals and tools stay, and the denser chart holds the other."""
        boards = sorted([board, dataclasses.replace(board, density=density)], key=_density)
        sparse, dense = map(content, boards)
        for key in ("chart", "description"):
            sparse.pop(key, None)
            dense.pop(key, None)
        assert sparse == dense
        less, more = (closure(pairs(item.chart)) for item in boards)
        assert less <= more

    @settings(max_examples=examples(40))
    @given(board=BOARDS, tools=st.integers(1, MOST_TOOLS))
    def test_other_tools_change_no_part_but_for_its_tool(self, board, tools):
        """Nor the chart."""
        first, other = content(board), content(dataclasses.replace(board, tools=tools))
        assert but_for(first["parts"], "tool") == but_for(other["parts"], "tool")
        assert first.get("chart") == other.get("chart")

    @settings(max_examples=examples(40))
    @given(board=BOARDS, parts=st.integers(1, 40))
    def test_more_parts_leave_the_others_where_they_are(self, board, parts):
        """A larger board has the parts of the smaller one, with their tools, and more."""
        small, large = sorted([board.parts, parts])
        fewer = content(dataclasses.replace(board, parts=small))["parts"]
        assert fewer.items() <= content(dataclasses.replace(board, parts=large))["parts"].items()

    def test_another_seed_is_another_board(self):
        """In its parts and in its chart."""
        first, other = (content(BoardGenerator(10, 0.3, 2, seed)) for seed in (1, 2))
        assert but_for(first["parts"], "tool") != but_for(other["parts"], "tool")
        assert first["chart"] != other["chart"]


def _density(board: BoardGenerator) -> float:
    return board.density


def pairs(chart: Mapping[str, list[str]]) -> set[tuple[str, str]]:
    return {(before, item) for before, after in chart.items() for item in after}


@pytest.mark.parametrize(
    "density",
    [
        slow_case(0.3, reason="a board of 256 parts; smaller ones in every run"),
        *(slow_case(density, reason="another density in every run") for density in (0.0, 1.0)),
    ],
)
def test_the_largest_board_is_faultless_too(density):
    """As many parts and tools as there may be."""
    board = BoardGenerator(MOST_PARTS, density, MOST_TOOLS, 7)
    assert round(density * 32_640) == len(order(loaded(board)))


def test_the_geometry_orders_nothing():
    """Without a chart every part may be placed at any time, by the boxes about all of them."""
    task = loaded(BoardGenerator(30, 0.0, 3, 1))
    setup = Setup(collision=("aabb",))
    derived = derive_chart(make_feasibility(task, setup))
    assert ((), {}, {}, ()) == (
        derived.relations,
        derived.impossible,
        derived.conditional,
        derived.undecided,
    )


def test_no_change_of_tools_is_done_in_two():
    """By way of a third holder it costs more, so that the step limit leaves room for every plan."""
    created = content(BoardGenerator(9, 0.3, MOST_TOOLS, 1))
    holders_m = [tool["holder_m"] for tool in created["tools"].values()]
    for first, via, other in permutations(holders_m, 3):
        assert math.dist(first, via) + math.dist(via, other) > math.dist(first, other) + 1e-5
    assert 3 * 9 == created["step_limit"]


def test_a_total_order_leaves_one_way():
    """Of density 1, each part is placed before the next by the chart."""
    task = loaded(BoardGenerator(12, 1.0, 1, 4))
    skills = [step.skill for step in solve(task).steps]
    placed = [name[6:-1] for name in skills if name.startswith("place(")]
    before = order(task)
    assert (12, 66) == (len(placed), len(before))
    assert set(pairwise(placed)) <= before


@pytest.mark.parametrize("density", [slow_case(0.0, reason="more orders; fewer in every run"), 0.4])
@pytest.mark.parametrize("tools", [1, 2])
def test_brute_force_and_exact_search_find_the_same_optimum(tools, density):
    """Of five parts, on a board that is small enough to be searched through."""
    task = loaded(BoardGenerator(5, density, tools, 2))
    setup = Setup()
    proved, searched = (solve(task, name, setup) for name in ("exact", "exhaustive"))
    assert Status.OPTIMAL is proved.status is searched.status
    assert proved.cost == pytest.approx(searched.cost, abs=1e-9)


@pytest.mark.slow(reason="searches several boards; brute force in every run")
def test_a_denser_chart_costs_no_less():
    """As what it allows is allowed by the other."""
    costs = [solve(loaded(BoardGenerator(8, density, 2, 3))).cost for density in (0, 0.2, 0.5, 1)]
    assert costs == sorted(costs)
    assert costs[0] < costs[-1]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"parts": 0}, "parts must be from 1 to 256, not 0."),
        ({"parts": 257}, "parts must be from 1 to 256, not 257."),
        ({"density": -0.1}, "density must be from 0 to 1, not -0.1."),
        ({"density": float("nan")}, "density must be from 0 to 1, not nan."),
        ({"tools": 9}, "tools must be from 1 to 8, not 9."),
        ({"seed": -1}, "seed must be at least 0, not -1."),
        ({"name": "9 lives"}, "'9 lives' cannot be the name of a task"),
        ({"name": "a" * 65}, "must begin with a letter and have at most 64"),
    ],
)
def test_a_value_out_of_its_range_is_refused(values, message):
    """In words, with the range."""
    with pytest.raises(OptionError) as refused:
        BoardGenerator(**{"parts": 5, "density": 0.5, **values})
    assert message in str(refused.value)


class TestGraspsThatFail:
    def test_a_share_of_the_parts_may_be_missed(self):
        """By probabilities between the two, with a way home; the rest of the board is the same."""
        plain = BoardGenerator(12, 0.2, 2, 7)
        failing = dataclasses.replace(plain, failures=(0.1, 0.4), failing_share=0.33)
        parts = content(failing)["parts"]
        missed = {n: part["grasp_failure"] for n, part in parts.items() if "grasp_failure" in part}
        assert 4 == len(missed)
        assert all(0.1 <= miss <= 0.4 for miss in missed.values())
        assert content(plain)["parts"] == but_for(parts, "grasp_failure")
        assert content(failing)["robot"]["look_m"] == content(failing)["robot"]["home_m"]
        task = loaded(failing)
        assert not task.deterministic
        assert task.step_limit > loaded(plain).step_limit
        assert failing.summary.endswith("; 4 grasps may fail")
        assert failing.text() == dataclasses.replace(failing).text()

    @pytest.mark.parametrize("failures", [(0.4, 0.1), (-0.1, 0.2), (0.5, 1.0)])
    def test_what_is_no_range_of_probabilities_is_refused(self, failures):
        with pytest.raises(OptionError, match="failures must be LEAST:GREATEST"):
            BoardGenerator(4, 0.2, failures=failures)

    @pytest.mark.parametrize("share", [0.0, 1.5])
    def test_a_share_is_above_0_and_at_most_1(self, share):
        with pytest.raises(OptionError, match="failing share"):
            BoardGenerator(4, 0.2, failures=(0.1, 0.4), failing_share=share)


# Partial orders at random: of just as many pairs as wanted, each within all larger ones.


COUNTS = st.integers(0, 12)


def covers(count: int, pairs: int, seed: int = 0) -> set[tuple[str, str]]:
    """Return what comes right before what."""
    order = RandomOrder(count, random.Random(seed).random, pairs)
    return {(str(a), str(b)) for a, after in order.covers().items() for b in after}


@given(count=COUNTS, share=st.floats(0, 1), seed=st.integers(0, 2**64))
def test_the_closure_holds_just_as_many_pairs(count, share, seed):
    """Any number from none to all, without a cycle, and nothing is said twice."""
    pairs = round(share * count * (count - 1) / 2)
    right_after = covers(count, pairs, seed)
    assert pairs == len(closure(right_after))
    assert () == cycle(right_after)
    assert right_after == reduction(right_after)


@given(count=st.integers(2, 9), seed=st.integers(0, 2**64))
def test_every_order_is_part_of_every_larger_one(count, seed):
    """From no pair to all, one more at a time."""
    most = count * (count - 1) // 2
    orders = [closure(covers(count, pairs, seed)) for pairs in range(most + 1)]
    assert all(smaller < larger for smaller, larger in pairwise(orders))


def test_any_two_elements_may_come_either_way_round():
    """No element is before another by its number; chains come up, and so do elements without."""
    drawn = [closure(covers(6, 5, seed)) for seed in range(200)]
    both_ways = {(str(a), str(b)) for a, b in combinations(range(6), 2)}
    both_ways |= {(b, a) for a, b in both_ways}
    assert both_ways == set().union(*drawn)
    heights = {1 + max(map(len, _chains(pairs))) for pairs in drawn}
    assert {2, 3} <= heights
    assert len({frozenset(pairs) for pairs in drawn}) > 190


def _chains(pairs: set[tuple[str, str]]) -> list[set[str]]:
    """Return, of every element that something follows, what is before it and itself."""
    return [{b for b, c in pairs if c == a} | {a} for a, _ in pairs]


@pytest.mark.parametrize(("count", "pairs"), [(0, 1), (3, 4), (3, -1)])
def test_more_pairs_than_there_are_is_an_error(count, pairs):
    """And so are fewer than none."""
    with pytest.raises(ValueError, match=f"{count} elements have from 0 to"):
        RandomOrder(count, random.random, pairs)
