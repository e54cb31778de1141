"""A policy over elements: blind to their order and number, and told no more than it says."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import skillplan_torch as torch_plugin
from skillplan.domains.assembly import BoardGenerator
from skillplan.errors import OptionError
from skillplan.model import roll_out
from skillplan.pipeline import load_problem, make_model
from skillplan.task import Task

CONFIGS = Path(__file__).parents[3] / "configs"
SMALL = torch_plugin.NetworkSize(width=16, heads=2, layers=2, pair_width=4)


@pytest.fixture(scope="module")
def board_task():
    return load_problem(CONFIGS / "inverter_board.yaml").task


@pytest.fixture(scope="module")
def motor_drive_task():
    return load_problem(CONFIGS / "motor_drive.yaml").task


def a_network(
    seed: int = 0, size: torch_plugin.NetworkSize = SMALL
) -> torch_plugin.RelationalNetwork:
    chance = np.random.Generator(np.random.PCG64(seed))
    shapes = size.shapes().items()
    arrays = {name: chance.normal(0, 0.3, shape).astype(np.float32) for name, shape in shapes}
    return torch_plugin.RelationalNetwork(size, arrays)


def a_board(tmp_path: Path, parts: int, tools: int = 2, seed: int = 3) -> Task:
    path = tmp_path / f"board-{parts}-{seed}.yaml"
    path.write_text(BoardGenerator(parts, 0.3, tools, seed).text(), "utf-8")
    return load_problem(path).task


def view_of(task: Task) -> torch_plugin.ElementView:
    return torch_plugin.ElementView(
        torch_plugin.ElementPaths(task), torch_plugin.ElementOrder.of(make_model(task))
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_order_of_elements_does_not_matter(seed, tmp_path):
    """Permuted elements have the permuted scores."""
    task = a_board(tmp_path, 9, seed=seed)
    graph = view_of(task)(task.initial)
    order = np.random.Generator(np.random.PCG64(seed)).permutation(9)
    permuted = torch_plugin.ElementGraph(
        graph.elements[order],
        tuple(graph.routes[node] for node in order),
        graph.features[order],
        graph.pairs[np.ix_(order, order)],
    )
    network = a_network(seed)
    assert network.scores(permuted) == pytest.approx(network.scores(graph)[order], abs=1e-5)


def test_nor_does_the_order_of_parts_in_the_file(tmp_path):
    """Every skill has the score that it had, by its name."""
    path, other = tmp_path / "one.yaml", tmp_path / "other.yaml"
    path.write_text(BoardGenerator(7, 0.3, 3, 5).text(), "utf-8")
    content = yaml.safe_load(path.read_text("utf-8"))
    content["parts"] = dict(reversed(content["parts"].items()))
    other.write_text(yaml.safe_dump(content, sort_keys=False), "utf-8")
    first, second = (load_problem(item).task for item in (path, other))
    network = a_network()
    scores = [
        torch_plugin.ElementChoice(network, make_model(entry)).scores(entry.initial)
        for entry in (first, second)
    ]
    assert list(scores[0]) != list(scores[1])
    assert scores[0] == pytest.approx(scores[1], abs=1e-5)


def test_it_is_defined_for_any_number_of_elements(tmp_path):
    network = a_network()
    for parts in (1, 2, 5, 24):
        task = a_board(tmp_path, parts, tools=1)
        graph = view_of(task)(task.initial)
        scores = network.scores(graph)
        assert (parts,) == scores.shape
        assert np.isfinite(scores).all()


def test_what_it_is_told_costs_is_what_the_model_asks_for(board_task):
    """From the initial state, with the tool changes that come between."""
    model, paths = make_model(board_task), torch_plugin.ElementPaths(board_task)
    for element, name in enumerate(paths.elements):
        skill = paths.next_skill(element, board_task.initial.bits)
        assert skill is not None
        route = paths.route(skill, board_task.initial.bits)
        assert route is not None
        first = board_task.skill(route.first)
        cost, state = model.cost(board_task.initial, first), board_task.initial
        assert first.applicable(state)
        if route.between:
            state = first.prediction.apply(state)
            cost += model.cost(state, skill)
        assert route.cost == pytest.approx(cost), name


def test_what_it_is_told_of_the_order_is_the_chart(board_task):
    order = torch_plugin.ElementOrder.of(make_model(board_task))
    names = list(board_task.operations)
    for line in board_task.chart:
        assert order.before[names.index(line.before), names.index(line.after)]
    assert order.before[names.index("pcb"), names.index("screw_1")], "closed by transitivity"


def test_of_a_choice_it_is_told_what_is_left_of_it():
    """Three elements: 0 goes before 1 or before 2. With 1 done, it has to go before 2."""
    order = torch_plugin.ElementOrder(
        np.zeros((3, 3), dtype=np.bool_), ((0, ((0, 0b010), (0, 0b100))),)
    )
    assert not order.after(0).any()
    assert np.argwhere(order.after(0b010)).tolist() == [[0, 2]]
    assert not order.after(0b001).any()


def test_of_a_choice_of_supports_it_waits_for_the_nearest():
    """Element 0 needs 1 and 2, or 3."""
    order = torch_plugin.ElementOrder(
        np.zeros((4, 4), dtype=np.bool_), ((0, ((0b0110, 0), (0b1000, 0))),)
    )
    assert np.argwhere(order.after(0)).tolist() == [[3, 0]]
    assert not order.after(0b1000).any()


def test_it_takes_only_what_is_applicable(motor_drive_task):
    """Whatever it has learned; tools are changed in actions of their own there."""
    for seed in range(2):
        model = make_model(motor_drive_task)
        choose = torch_plugin.ElementChoice(a_network(seed), model)
        skills = roll_out(model, choose)
        state = motor_drive_task.initial
        for skill in skills:
            assert skill.applicable(state)
            state = skill.prediction.apply(state)


def test_a_task_without_elements_is_refused():
    task = load_problem(CONFIGS / "br17.10.sop").task
    with pytest.raises(OptionError, match=r"cannot act on br17\.10: it has"):
        torch_plugin.ElementChoice(a_network(), make_model(task))


@pytest.mark.parametrize("fault", ["missing", "shape", "nan"])
def test_arrays_that_do_not_fit_are_refused(fault):
    arrays: dict[str, Any] = dict(a_network().arrays)
    if fault == "missing":
        del arrays["score.last"]
    elif fault == "shape":
        arrays["score.last"] = arrays["score.last"].T
    else:
        arrays["score.last"] = np.full_like(arrays["score.last"], np.nan)
    with pytest.raises(ValueError, match=r"arrays|score\.last"):
        torch_plugin.RelationalNetwork(SMALL, arrays)


def test_an_answer_on_24_parts_takes_less_than_5_ms(tmp_path):
    """Of processor time, with a network of the default size."""
    task = a_board(tmp_path, 24, tools=4)
    choose = torch_plugin.ElementChoice(
        a_network(size=torch_plugin.NetworkSize()), make_model(task)
    )
    choose(task.initial)
    begin_s = time.process_time()
    for _ in range(20):
        choose(task.initial)
    assert (time.process_time() - begin_s) / 20 < 0.005
