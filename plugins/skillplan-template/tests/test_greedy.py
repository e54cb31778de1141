"""The template passes the suite that every solver has to pass."""

from skillplan.testing import SolverSuite


class TestGreedySolver(SolverSuite):
    solver = "greedy"
