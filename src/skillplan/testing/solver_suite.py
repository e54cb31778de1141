"""What every solver owes its users."""

from __future__ import annotations

from typing import Any, ClassVar

from skillplan.pipeline import registry
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import make_model, make_solver, solve
from skillplan.records.result import Status
from skillplan.solvers.stop import Stop
from skillplan.testing.options import assert_options_described
from skillplan.testing.tasks import lid_task, shut_box_task


class SolverSuite:
    """What every solver owes its users."""

    solver: ClassVar[str]
    options: ClassVar[dict[str, Any]] = {}

    def _setup(self) -> Setup:
        return Setup(options={self.solver: self.options})

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry finds it under its name, with a summary and described options."""
        plugin = registry.load("solver", self.solver)
        assert plugin.name == self.solver
        assert_options_described(plugin)
        assert (plugin.__doc__ or "").strip()

    def test_it_solves_the_lid_task(self) -> None:
        """The referee grants a plan."""
        result = solve(lid_task(), self.solver, self._setup())
        assert result.status in (Status.OPTIMAL, Status.SOLVED), result.reason

    def test_the_same_seed_gives_the_same_plan(self) -> None:
        """One seed governs all randomness."""
        first, second = (solve(lid_task(), self.solver, self._setup(), seed=7) for _ in range(2))
        assert [s.skill for s in first.steps] == [s.skill for s in second.steps]
        assert first.cost == second.cost

    def test_it_is_honest_where_there_is_no_plan(self) -> None:
        """It finds none, and does not pretend."""
        result = solve(shut_box_task(), self.solver, self._setup())
        assert result.status in (Status.INFEASIBLE, Status.UNSOLVED), result.reason

    def test_it_stops_when_told_to(self) -> None:
        """An interrupted search ends with what it has, not with an error."""
        stop = Stop()
        stop.interrupt()
        result = solve(lid_task(), self.solver, self._setup(), stop=stop)
        assert result.status in (
            Status.OPTIMAL,
            Status.SOLVED,
            Status.UNSOLVED,
        ), result.reason

    def test_it_refuses_in_words_or_not_at_all(self) -> None:
        """A refusal is a sentence."""
        model = make_model(lid_task())
        refusal = make_solver(self.solver, self.options).refuses(model)
        assert refusal is None or (isinstance(refusal, str) and refusal.strip())
