"""Conformance suites for plugin authors: inherit one, name your plugin, and run pytest.

::

    class TestMySolver(SolverSuite):
        solver = "my-solver"

Every built-in passes the same suites. The tasks they use are small and made here, so that
an installed skillplan is all they need; they go through the registry and the referee like any
other run. Nothing but tests imports this package.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

# Looked up when they are used: a process that only does a job of a suite imports none of them.
_HOMES = {
    "DetectorSuite": "back_end_suites",
    "DomainSuite": "suites",
    "EngineSuite": "back_end_suites",
    "ExecutorSuite": "executor_suite",
    "ExporterSuite": "suites",
    "SamplerSuite": "suites",
    "SimulationSuite": "back_end_suites",
    "SolverSuite": "suites",
    "chance_task": "tasks",
    "hostile_task": "tasks",
    "lid_content": "tasks",
    "lid_task": "tasks",
    "reachable_states": "tasks",
    "shut_box_task": "tasks",
}

if TYPE_CHECKING:
    from skillplan.testing.back_end_suites import DetectorSuite, EngineSuite, SimulationSuite
    from skillplan.testing.executor_suite import ExecutorSuite
    from skillplan.testing.suites import DomainSuite, ExporterSuite, SamplerSuite, SolverSuite
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
    "SamplerSuite",
    "SimulationSuite",
    "SolverSuite",
    "chance_task",
    "hostile_task",
    "lid_content",
    "lid_task",
    "reachable_states",
    "shut_box_task",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value
