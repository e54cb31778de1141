from .evaluation import RunsEvaluation as RunsEvaluation
from .evaluation import check_same_task as check_same_task
from .family_training import GeneratedFamily as GeneratedFamily
from .family_training import follow_policy as follow_policy
from .family_training import read_policy as read_policy
from .groups import GroupJob as GroupJob
from .groups import GroupTraining as GroupTraining
from .groups import make_group_cache as make_group_cache
from .policies import greedy_roll_out as greedy_roll_out
from .policies import prove_optimum as prove_optimum
from .policies import random_baseline as random_baseline
from .policies import sampled_roll_outs as sampled_roll_outs
from .run_files import Checkpoint as Checkpoint
from .run_files import FileChange as FileChange
from .run_files import apply_changes as apply_changes
from .run_files import opening_record as opening_record
from .run_files import read_checkpoint as read_checkpoint
from .run_files import scalars_record as scalars_record
from .run_files import write_checkpoint as write_checkpoint
from .trainer import Trainer as Trainer
from .training_folder import TrainingFolder as TrainingFolder
from .training_plan import GROUP_RUNS as GROUP_RUNS
from .training_plan import Groups as Groups
from .training_plan import TrainingPlan as TrainingPlan
from .training_plan import even_groups as even_groups
from .training_plan import plan_training as plan_training

__all__ = [
    "GROUP_RUNS",
    "Checkpoint",
    "FileChange",
    "GeneratedFamily",
    "GroupJob",
    "GroupTraining",
    "Groups",
    "RunsEvaluation",
    "Trainer",
    "TrainingFolder",
    "TrainingPlan",
    "apply_changes",
    "check_same_task",
    "even_groups",
    "follow_policy",
    "greedy_roll_out",
    "make_group_cache",
    "opening_record",
    "plan_training",
    "prove_optimum",
    "random_baseline",
    "read_checkpoint",
    "read_policy",
    "sampled_roll_outs",
    "scalars_record",
    "write_checkpoint",
]
