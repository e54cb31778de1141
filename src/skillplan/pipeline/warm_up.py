"""Compile ahead what solvers would compile at their first use, once per machine."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from skillplan.domains.assembly.board_generator import BoardGenerator
from skillplan.pipeline.run import solve
from skillplan.pipeline.setup import load_problem
from skillplan.solvers.mdp.label_setting import costs_to_go
from skillplan.solvers.ordering.portfolio import warm_up

# A board that any solver is done with at once; with the second change some grasps fail.
_BOARD = BoardGenerator(parts=4, density=0.5, tools=2, name="warm-up")
_SURE: Mapping[str, str] = {}
_CHANCE = {"parts.part_1.grasp_failure": "0.1"}


def warm_up_steps() -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield what is to be compiled, in words, with what compiles it."""
    yield "searches over orders", warm_up
    yield "dynamic programming", _dynamic_programming
    yield "tabular reinforcement learning", _learners


def _dynamic_programming() -> None:
    for changes in (_SURE, _CHANCE):
        _solve(changes, "value-iteration", "policy-iteration")
    # Where all skills cost the same another search finds the cheapest paths.
    costs_to_go(np.array([0, 1, 1]), np.array([1]), np.array([False, True]))


def _learners() -> None:
    _solve(_SURE, "q-learning", "monte-carlo")


def _solve(changes: Mapping[str, str], *solvers: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "board.yaml"
        path.write_text(_BOARD.text("any"), "utf-8")
        task = load_problem(path, None, changes).task
    for solver in solvers:
        solve(task, solver)
