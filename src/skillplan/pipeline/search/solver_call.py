"""A call to a solver, here or in a process of its own: blamed for what it raises, made plain."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from skillplan.errors import SearchStopped, SolverError
from skillplan.judge.plain_solution import plain_solution
from skillplan.model.skill_model import SkillModel
from skillplan.plugins.blame import blame, ends_program
from skillplan.solvers.solution import Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.workers.supervised import doing


@contextmanager
def blamed(plugin: type[Solver]) -> Iterator[None]:
    """Name the solver, and the line of its code, in whatever it raises that is not in words.

    Raises
    ------
    SolverError
        In the place of what the solver raises.
    """
    try:
        yield
    except BaseException as error:
        blame(
            error, plugin, lambda words: f"The solver {plugin.name!r} failed: {words}", SolverError
        )


def plain_answer(solver: Solver, model: SkillModel, seed: int, stop: Stop) -> Solution:
    """Let a solver search, and return what it claims as plain values.

    Where the model stopped it, that is the best plan and bound that `stop` was given.

    Raises
    ------
    SolverError
        If it fails, or returns what is no solution.
    """
    names = ", ".join(back_end.name for back_end in model.feasibility.back_ends)
    activity = f"the search by the solver {solver.name!r} with {names}"
    left_s = stop.left_s
    # The model ends a solver that does not poll a second after the limit; this comes after it.
    limit_s = None if left_s is None else 1.1 * left_s + 1.5
    try:
        if stop.interrupted:
            # A signal while the task was prepared.
            raise SearchStopped
        with doing(activity, limit_s=limit_s), blamed(type(solver)):
            solution = solver.solve(model, seed=seed)
    except SearchStopped:
        # Polled, as it may be the first to learn that the time is over.
        stop()
        solution = Solution(stop.best, stop.lower_bound)
    if not isinstance(solution, Solution):
        raise SolverError(
            f"The solver {solver.name!r} returned {type(solution).__name__}, not a Solution."
        )
    try:
        return plain_solution(solution)
    except BaseException as error:
        if ends_program(error):
            raise
        words = f"The solver {solver.name!r} returned a Solution that cannot be read"
        raise SolverError(f"{words}: {error}.") from None
