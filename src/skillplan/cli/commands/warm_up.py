"""``skillplan warm-up``, and the notice of commands that compile kernels themselves."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from skillplan.cli.writing import tell
from skillplan.solvers.kernels import on_compilation

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.physics.performance import Performer
    from skillplan.task.task import Task

NOTICE = (
    "skillplan: compiling kernels, once on this machine: up to half a minute "
    "('skillplan warm-up' compiles them all ahead)"
)


def command() -> int:
    """Compile the kernels of searches, learners and pictures ahead of their first use.

    The compiled code is kept on this machine. It takes about a minute.
    """
    import time

    from skillplan.cli.writing import write_out

    kernels: list[str] = []
    steps = list(warm_up_steps())
    begin_s = time.perf_counter()
    remove_listener = on_compilation(kernels.append)
    try:
        for number, (name, compile_kernels) in enumerate(steps, 1):
            tell(f"compiling {number} of {len(steps)}: {name}")
            compile_kernels()
    finally:
        remove_listener()
    wall_s = time.perf_counter() - begin_s
    if kernels:
        write_out(f"{len(kernels)} kernels compiled in {wall_s:.1f} s; they are kept\n")
    else:
        write_out("nothing to compile: all kernels are kept already\n")
    return 0


def warm_up_steps() -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield names of groups of kernels, and functions that compile them."""
    from skillplan.solvers.ordering.portfolio import warm_up

    yield "searches over orders", warm_up
    yield "dynamic programming", _compile_dynamic_programming
    yield "tabular reinforcement learning", lambda: _solve({}, "q-learning", "monte-carlo")
    yield "plans by learned models", lambda: _solve({}, "learned-model")
    engine = _find_drawing_engine()
    if engine is not None:
        # All engines draw by the same kernels.
        yield "pictures of simulations", lambda: _draw_picture(engine)


def _compile_dynamic_programming() -> None:
    import numpy as np

    from skillplan.solvers.mdp.label_setting import compute_costs_to_go

    for changes in ({}, {"parts.part_1.grasp_failure": "0.1"}):
        _solve(changes, "value-iteration", "policy-iteration")
    # If all skills cost the same, another search finds the cheapest paths.
    compute_costs_to_go(np.array([0, 1, 1]), np.array([1]), np.array([False, True]))


def _find_drawing_engine() -> type[Performer] | None:
    from skillplan.physics.performance import Performer
    from skillplan.pipeline import registry

    engines: list[Any] = [registry.load("physics", name) for name in registry.names("physics")]
    return next((engine for engine in engines if issubclass(engine, Performer)), None)


def _draw_picture(engine: Any) -> None:
    task = _make_board({})
    skill = next(skill for skill in task.skills if skill.applicable(task.initial))
    engine(task).picture(skill, task.initial)


def _solve(changes: Mapping[str, str], *solvers: str) -> None:
    """Solve a small board, so that the kernels of the solvers are compiled."""
    from skillplan.pipeline.solving import solve

    task = _make_board(changes)
    for solver in solvers:
        solve(task, solver)


def _make_board(changes: Mapping[str, str]) -> Task:
    import tempfile
    from pathlib import Path

    from skillplan.domains.assembly.board_generator import BoardGenerator
    from skillplan.pipeline.setup import load_problem

    board = BoardGenerator(parts=4, density=0.5, tools=2, name="warm-up")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "board.yaml"
        path.write_text(board.text("any"), "utf-8")
        return load_problem(path, None, changes).task


@contextmanager
def announce_compilation() -> Iterator[None]:
    """Print a notice on a terminal before the first kernel is compiled."""
    if not sys.stderr.isatty():
        yield
        return
    announced: list[str] = []

    def announce(kernel: str) -> None:
        if not announced:
            tell(NOTICE)
        announced.append(kernel)

    remove_listener = on_compilation(announce)
    try:
        yield
    finally:
        remove_listener()
