from .back_end_suites import DetectorSuite as DetectorSuite
from .back_end_suites import EngineSuite as EngineSuite
from .back_end_suites import SimulationSuite as SimulationSuite
from .executor_suite import ExecutorSuite as ExecutorSuite
from .executor_suite import ExpensiveBoxes as ExpensiveBoxes
from .suites import DomainSuite as DomainSuite
from .suites import ExporterSuite as ExporterSuite
from .suites import SamplerSuite as SamplerSuite
from .suites import SolverSuite as SolverSuite
from .suites import solved_lid as solved_lid
from .tasks import chance_task as chance_task
from .tasks import hostile_task as hostile_task
from .tasks import lid_content as lid_content
from .tasks import lid_task as lid_task
from .tasks import reachable_states as reachable_states
from .tasks import shut_box_task as shut_box_task

__all__ = [
    "DetectorSuite",
    "DomainSuite",
    "EngineSuite",
    "ExecutorSuite",
    "ExpensiveBoxes",
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
    "solved_lid",
]
