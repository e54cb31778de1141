"""One policy learned on small boards, tried on larger ones and on other kinds of boards."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import skillplan_torch as torch_plugin
from skillplan.errors import OptionError
from skillplan.pipeline import load_problem, make_model, solve
from skillplan.records import is_relational, write_relational
from skillplan.solvers import FamilyLesson
from skillplan.training import GeneratedFamily, follow_policy, read_policy

CONFIGS = Path(__file__).parents[3] / "configs"
TINY = {"boards": 2, "rounds": 2, "updates": 3, "batch": 8, "width": 16, "layers": 1}


def learned(family: str, seed: int = 0, **options: int) -> FamilyLesson:
    solver = torch_plugin.RelationalSolver(torch_plugin.RelationalOptions(**options))
    tasks = GeneratedFamily.parse(family).tasks(solver.boards, seed)
    return solver.learn((make_model(task) for task in tasks), seed, lambda: None)


def lessons_of(boards: list[torch_plugin.Board]) -> torch_plugin.Lessons:
    lessons = torch_plugin.Lessons()
    chance = np.random.Generator(np.random.PCG64(0))
    for board in boards:
        lessons.add(board.walk(lambda graph: 0, chance, 1.0))
    return lessons


@pytest.fixture(scope="module")
def boards():
    return [torch_plugin.Board.of(make_model(task)) for task in GeneratedFamily(3, 6).tasks(4, 1)]


def test_numpy_answers_as_torch_does(boards):
    """To 1e-6 of what scores are, also where a batch pads smaller boards."""
    network = torch_plugin.TorchNetwork(torch_plugin.NetworkSize(), seed=5)
    lessons = lessons_of(boards)
    features, pairs, present, *_ = lessons.batch(np.arange(len(lessons)))
    with torch.no_grad():
        theirs = network.scores(features, pairs, present).numpy()
    answers = network.network()
    sizes = set()
    for row, (graph, _) in enumerate(lessons):
        ours = answers.scores(graph)
        sizes.add(len(ours))
        assert np.abs(ours - theirs[row, : len(ours)]).max() <= 1e-6 * max(1.0, np.abs(ours).max())
    assert len(sizes) > 2


def test_the_teacher_knows_the_optimum(boards):
    for board in boards:
        best = solve(board.model.task, "exact")
        assert board.least == pytest.approx(best.cost)


def test_the_best_choice_has_no_regret_and_a_dead_end_the_most(boards):
    for graph, regrets in lessons_of(boards):
        assert regrets.min() == 0.0
        blocked = graph.features[:, 2] > 0
        assert (regrets[blocked] == 1.0).all()


@pytest.mark.slow(reason="two trainings; those of dqn and ppo in every run")
def test_the_same_boards_and_seed_give_the_same_network():
    item, again = (learned("generated:3-4", **TINY).policy for _ in range(2))
    for name, array in item.weights.items():
        assert np.array_equal(array, again.weights[name])


def test_boards_that_are_too_large_to_be_taught_are_refused():
    with pytest.raises(OptionError, match="at most 14 elements"):
        learned("generated:15", **TINY)


def test_without_a_policy_to_follow_it_refuses():
    model = make_model(load_problem(CONFIGS / "inverter_board.yaml").task)
    why = torch_plugin.RelationalSolver().refuses(model)
    assert why is not None
    assert "train --family" in why


@pytest.mark.slow(reason="learns on 40 boards; a tiny one in every run")
def test_what_is_learned_on_few_parts_completes_boards_of_more(tmp_path):
    """Unseen ones of twice the parts, and a board with screws; answered from its files alone."""
    lesson = learned("generated:4-6", boards=40, rounds=3, updates=50, batch=64, width=32)
    write_relational(
        tmp_path,
        lesson.policy,
        solver="relational",
        options={},
        family="generated:4-6",
        boards=40,
        seed=0,
        trace=lesson.trace,
        trial=None,
        wall_s=0.0,
    )
    policy = read_policy(tmp_path).policy
    tasks = list(GeneratedFamily(8, 10).tasks(4, 9))
    tasks.append(load_problem(CONFIGS / "inverter_board.yaml").task)
    for task in tasks:
        _, walked = follow_policy(policy, task)
        assert walked.complete, task.name
        best = solve(task, "auto").cost
        assert best is not None
        assert walked.cost <= 1.15 * best
    solver = torch_plugin.RelationalSolver(torch_plugin.RelationalOptions(run=str(tmp_path)))
    solution = solver.solve(make_model(tasks[0]))
    assert solution.plan is not None


@pytest.mark.slow(reason="tries a policy on 20 boards")
def test_the_command_line_trains_and_keeps_what_was_learned(tmp_path, capsys):
    """The printed document is the kept one; a second training does not go into the folder."""
    from skillplan.cli import main

    out = tmp_path / "run"
    words = [word for key, value in TINY.items() for word in ("-O", f"{key}={value}")]
    command = ["train", "--family", "generated:3-4", "--solver", "relational", *words]
    command += ["--out", str(out)]
    with pytest.raises(SystemExit):
        main([*command, "--format", "json"])
    printed = json.loads(capsys.readouterr().out)
    assert json.loads((out / "relational.json").read_text("utf-8")) == printed
    assert (printed["boards"], printed["trial"]["boards"]) == (2, 20)
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert ended.value.code == 2
    assert "--out" in capsys.readouterr().err


# Policies that carry over as files: what is read is what was written; damage is named.


SIZE = torch_plugin.NetworkSize(width=8, heads=2, layers=1, pair_width=4)


def a_network() -> torch_plugin.RelationalNetwork:
    chance = np.random.Generator(np.random.PCG64(0))
    shapes = SIZE.shapes().items()
    arrays = {name: chance.normal(size=shape).astype(np.float32) for name, shape in shapes}
    return torch_plugin.RelationalNetwork(SIZE, arrays)


@pytest.fixture
def stored(tmp_path):
    content: dict[str, Any] = {
        "solver": "relational",
        "options": {"boards": 3},
        "family": "generated:3-5",
        "boards": 3,
        "seed": 1,
        "trace": {"states": 12},
        "trial": None,
        "wall_s": 1.5,
    }
    write_relational(tmp_path, a_network(), **content)
    return tmp_path


def test_what_is_read_is_what_was_written(stored):
    policy = read_policy(stored)
    assert is_relational(str(stored))
    assert SIZE.width == policy.policy.dimensions["width"]
    assert policy.content.family == "generated:3-5"
    for name, array in a_network().arrays.items():
        assert np.array_equal(array, policy.policy.weights[name])


def test_another_folder_is_none(tmp_path):
    assert not is_relational(str(tmp_path))


def test_weights_that_were_changed_are_named(stored):
    path = stored / "relational.safetensors"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(OptionError, match=r"safetensors: is damaged: its hash is not the one in"):
        read_policy(stored)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("element_features", ["another"], "has other features"),
        ("boards", 0, "is damaged"),
        ("size", {"width": 16, "heads": 2, "layers": 1, "pair_width": 4}, "is damaged"),
    ],
)
def test_a_document_that_was_changed_is_named(stored, key, value, message):
    path = stored / "relational.json"
    document = json.loads(path.read_text("utf-8"))
    path.write_text(json.dumps({**document, key: value}), "utf-8")
    with pytest.raises(OptionError, match=message):
        read_policy(stored)


def test_missing_weights_are_named(stored):
    (stored / "relational.safetensors").unlink()
    with pytest.raises(OptionError, match="cannot be read"):
        read_policy(stored)
