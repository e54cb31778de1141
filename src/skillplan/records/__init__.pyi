from .certificate import Claim as Claim
from .certificate import Outcome as Outcome
from .certificate import Verdict as Verdict
from .chain_result import ChainPart as ChainPart
from .chain_result import ChainResult as ChainResult
from .evaluation import Evaluation as Evaluation
from .evaluation import Optimum as Optimum
from .execution.comparisons import find_decisive as find_decisive
from .execution.comparisons import list_wrong as list_wrong
from .execution.comparisons import make_detectors_document as make_detectors_document
from .execution.simulation import PlannedTimes as PlannedTimes
from .execution.simulation import Simulation as Simulation
from .interval import Estimate as Estimate
from .interval import Profile as Profile
from .interval import interquartile_mean as interquartile_mean
from .interval import mean as mean
from .interval import performance_profile as performance_profile
from .interval import probability_of_improvement as probability_of_improvement
from .interval import share as share
from .interval import stratified_iqm as stratified_iqm
from .interval import t_quantile as t_quantile
from .questions import DerivedOrder as DerivedOrder
from .questions import make_chart_document as make_chart_document
from .result import Origin as Origin
from .result import Result as Result
from .result import SimulationOutcome as SimulationOutcome
from .result import Status as Status
from .result import tolerance as tolerance
from .stored.policy_file import fingerprint as fingerprint
from .stored.policy_file import make_policy_document as make_policy_document
from .stored.policy_file import read_policy as read_policy
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
from .sweep.plan import format_setting as format_setting
from .sweep.result import StartOutcome as StartOutcome
from .sweep.result import SweepRecord as SweepRecord
from .sweep.result import SweepResult as SweepResult
from .sweep.result import parse_record as parse_record
from .task_difference import MISSING as MISSING
from .task_difference import Difference as Difference
from .task_difference import describe_changes as describe_changes
from .task_difference import differences as differences
from .task_difference import resolve_config as resolve_config
from .training.method_comparison import MethodComparison as MethodComparison
from .training.method_comparison import compare_methods as compare_methods
from .training.method_comparison import make_trainings_document as make_trainings_document
from .training.network_policy_file import read_network as read_network
from .training.network_policy_file import write_network as write_network
from .training.published_runs import TABLE_III as TABLE_III
from .training.published_runs import get_published_runs as get_published_runs
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
from .training.result import summarise_training as summarise_training
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
from .training.run_folder import format_metrics_line as format_metrics_line
from .training.run_folder import get_copy_name as get_copy_name
from .training.run_folder import get_group_path as get_group_path
from .training.run_folder import get_run_path as get_run_path
from .training.run_folder import parse_metrics as parse_metrics
from .training.run_folder import read_metrics as read_metrics
from .training.shortfall import Shortfall as Shortfall
from .training.shortfall import analyse_shortfall as analyse_shortfall

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
    "MethodComparison",
    "Optimum",
    "Origin",
    "Outcome",
    "PlannedTimes",
    "Profile",
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
    "analyse_shortfall",
    "check_finished",
    "compare_methods",
    "describe_changes",
    "differences",
    "find_decisive",
    "fingerprint",
    "format_metrics_line",
    "format_setting",
    "get_copy_name",
    "get_group_path",
    "get_published_runs",
    "get_run_path",
    "interquartile_mean",
    "is_relational",
    "list_wrong",
    "make_chart_document",
    "make_detectors_document",
    "make_policy_document",
    "make_trainings_document",
    "mean",
    "parse_metrics",
    "parse_record",
    "performance_profile",
    "probability_of_improvement",
    "read_metrics",
    "read_network",
    "read_policy",
    "resolve_config",
    "share",
    "stratified_iqm",
    "summarise_training",
    "t_quantile",
    "tolerance",
    "write_network",
    "write_relational",
]
