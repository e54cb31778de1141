from .certificate import Claim as Claim
from .certificate import Outcome as Outcome
from .certificate import Verdict as Verdict
from .chain_result import ChainPart as ChainPart
from .chain_result import ChainResult as ChainResult
from .evaluation import Evaluation as Evaluation
from .evaluation import Optimum as Optimum
from .execution.comparisons import detectors_document as detectors_document
from .execution.comparisons import find_decisive as find_decisive
from .execution.comparisons import list_wrong as list_wrong
from .execution.simulation import PlannedTimes as PlannedTimes
from .execution.simulation import Simulation as Simulation
from .interval import Estimate as Estimate
from .interval import interquartile_mean as interquartile_mean
from .interval import mean as mean
from .interval import share as share
from .interval import t_quantile as t_quantile
from .questions import DerivedOrder as DerivedOrder
from .questions import chart_document as chart_document
from .result import Origin as Origin
from .result import Result as Result
from .result import SimulationOutcome as SimulationOutcome
from .result import Status as Status
from .result import tolerance as tolerance
from .stored.policy_file import fingerprint as fingerprint
from .stored.policy_file import policy_document as policy_document
from .stored.policy_file import read_policy as read_policy
from .stored.policy_file import start_state as start_state
from .stored.result_file import StoredClaims as StoredClaims
from .stored.result_folder import MANIFEST as MANIFEST
from .stored.result_folder import check_finished as check_finished
from .stored.result_folder import is_relational as is_relational
from .sweep.plan import GRID as GRID
from .sweep.plan import Axis as Axis
from .sweep.plan import Choice as Choice
from .sweep.plan import SampledPlan as SampledPlan
from .sweep.plan import Span as Span
from .sweep.plan import Start as Start
from .sweep.plan import SweepPlan as SweepPlan
from .sweep.plan import Trial as Trial
from .sweep.plan import TriedSetting as TriedSetting
from .sweep.plan import setting_text as setting_text
from .sweep.result import StartOutcome as StartOutcome
from .sweep.result import SweepRecord as SweepRecord
from .sweep.result import SweepResult as SweepResult
from .sweep.result import record_of as record_of
from .task_difference import MISSING as MISSING
from .task_difference import Difference as Difference
from .task_difference import differences as differences
from .task_difference import resolved_config as resolved_config
from .task_difference import what_changed as what_changed
from .training.network_policy_file import read_network as read_network
from .training.network_policy_file import write_network as write_network
from .training.published_runs import TABLE_III as TABLE_III
from .training.published_runs import published_runs as published_runs
from .training.relational_file import write_relational as write_relational
from .training.result import GreedyRollOut as GreedyRollOut
from .training.result import LayoutOutcome as LayoutOutcome
from .training.result import LayoutsResult as LayoutsResult
from .training.result import RandomBaseline as RandomBaseline
from .training.result import RunOutcome as RunOutcome
from .training.result import RunStatus as RunStatus
from .training.result import Sampling as Sampling
from .training.result import Tally as Tally
from .training.result import TrainingRecord as TrainingRecord
from .training.result import TrainingResult as TrainingResult
from .training.result import training_record as training_record
from .training.run_folder import CHECKPOINT as CHECKPOINT
from .training.run_folder import METRICS as METRICS
from .training.run_folder import PROGRESS as PROGRESS
from .training.run_folder import TASK_CONFIG as TASK_CONFIG
from .training.run_folder import FiguresRecord as FiguresRecord
from .training.run_folder import GroupProgress as GroupProgress
from .training.run_folder import RunFolder as RunFolder
from .training.run_folder import RunManifest as RunManifest
from .training.run_folder import RunMetrics as RunMetrics
from .training.run_folder import TaskReference as TaskReference
from .training.run_folder import copy_name as copy_name
from .training.run_folder import group_path as group_path
from .training.run_folder import is_run_folder as is_run_folder
from .training.run_folder import metrics_line as metrics_line
from .training.run_folder import parse_metrics as parse_metrics
from .training.run_folder import read_metrics as read_metrics
from .training.run_folder import run_path as run_path
from .training.shortfall import Shortfall as Shortfall
from .training.shortfall import shortfall_of as shortfall_of

__all__ = [
    "CHECKPOINT",
    "GRID",
    "MANIFEST",
    "METRICS",
    "MISSING",
    "PROGRESS",
    "TABLE_III",
    "TASK_CONFIG",
    "Axis",
    "ChainPart",
    "ChainResult",
    "Choice",
    "Claim",
    "DerivedOrder",
    "Difference",
    "Estimate",
    "Evaluation",
    "FiguresRecord",
    "GreedyRollOut",
    "GroupProgress",
    "LayoutOutcome",
    "LayoutsResult",
    "Optimum",
    "Origin",
    "Outcome",
    "PlannedTimes",
    "RandomBaseline",
    "Result",
    "RunFolder",
    "RunManifest",
    "RunMetrics",
    "RunOutcome",
    "RunStatus",
    "SampledPlan",
    "Sampling",
    "Shortfall",
    "Simulation",
    "SimulationOutcome",
    "Span",
    "Start",
    "StartOutcome",
    "Status",
    "StoredClaims",
    "SweepPlan",
    "SweepRecord",
    "SweepResult",
    "Tally",
    "TaskReference",
    "TrainingRecord",
    "TrainingResult",
    "Trial",
    "TriedSetting",
    "Verdict",
    "chart_document",
    "check_finished",
    "copy_name",
    "detectors_document",
    "differences",
    "find_decisive",
    "fingerprint",
    "group_path",
    "interquartile_mean",
    "is_relational",
    "is_run_folder",
    "list_wrong",
    "mean",
    "metrics_line",
    "parse_metrics",
    "policy_document",
    "published_runs",
    "read_metrics",
    "read_network",
    "read_policy",
    "record_of",
    "resolved_config",
    "run_path",
    "setting_text",
    "share",
    "shortfall_of",
    "start_state",
    "t_quantile",
    "tolerance",
    "training_record",
    "what_changed",
    "write_network",
    "write_relational",
]
