from .evaluation import RunsEvaluation as RunsEvaluation
from .evaluation import check_same_task as check_same_task
from .family_training import GeneratedFamily as GeneratedFamily
from .family_training import follow_policy as follow_policy
from .family_training import read_policy as read_policy
from .groups import GroupJob as GroupJob
from .groups import GroupTraining as GroupTraining
from .groups import make_group_cache as make_group_cache
from .policies import measure_random_baseline as measure_random_baseline
from .policies import prove_optimum as prove_optimum
from .policies import roll_out_greedily as roll_out_greedily
from .policies import sample_roll_outs as sample_roll_outs
from .run_files import Checkpoint as Checkpoint
from .run_files import FileChange as FileChange
from .run_files import apply_changes as apply_changes
from .run_files import make_opening_record as make_opening_record
from .run_files import make_scalars_record as make_scalars_record
from .run_files import read_checkpoint as read_checkpoint
from .run_files import write_checkpoint as write_checkpoint
from .trainer import Trainer as Trainer
from .training_folder import TrainingFolder as TrainingFolder
from .training_plan import GROUP_RUNS as GROUP_RUNS
from .training_plan import Groups as Groups
from .training_plan import TrainingPlan as TrainingPlan
from .training_plan import make_even_groups as make_even_groups
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
    "follow_policy",
    "make_even_groups",
    "make_group_cache",
    "make_opening_record",
    "make_scalars_record",
    "measure_random_baseline",
    "plan_training",
    "prove_optimum",
    "read_checkpoint",
    "read_policy",
    "roll_out_greedily",
    "sample_roll_outs",
    "write_checkpoint",
]
