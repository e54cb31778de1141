"""Conformance suites for plugin authors: inherit one, name your plugin, and run pytest.

::

    class TestMySolver(SolverSuite):
        solver = "my-solver"

Every built-in passes the same suites. The tasks they use are small and made here, so that
an installed skillplan is all they need; they go through the registry and the referee like any
other run. Nothing but tests imports this package.
"""

from __future__ import annotations

from skillplan.testing.back_end_suites import DetectorSuite, EngineSuite
from skillplan.testing.domain_suite import DomainSuite
from skillplan.testing.executor_suite import ExecutorSuite
from skillplan.testing.exporter_suite import ExporterSuite
from skillplan.testing.solver_suite import SolverSuite
from skillplan.testing.tasks import (
    chance_task,
    hostile_task,
    lid_content,
    lid_task,
    reachable_states,
    shut_box_task,
)

__all__ = [
    "DetectorSuite",
    "DomainSuite",
    "EngineSuite",
    "ExecutorSuite",
    "ExporterSuite",
    "SolverSuite",
    "chance_task",
    "hostile_task",
    "lid_content",
    "lid_task",
    "reachable_states",
    "shut_box_task",
]
