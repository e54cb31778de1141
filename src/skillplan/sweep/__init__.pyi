from .option_values import read_space as read_space
from .option_values import read_values as read_values
from .option_values import space_evenly as space_evenly
from .parameter_study import do_sampled as do_sampled
from .parameter_study import do_study as do_study
from .parameter_study import make_sampler as make_sampler
from .parameter_study import open_trials as open_trials
from .parameter_study import plan_sampled as plan_sampled
from .parameter_study import plan_study as plan_study
from .parameter_study import rate_setting as rate_setting
from .sampler import FinishedTrial as FinishedTrial
from .sampler import Question as Question
from .sampler import SharedTrials as SharedTrials
from .study_folder import StudyFolder as StudyFolder
from .study_runs import StudyJob as StudyJob
from .study_runs import do_run as do_run

__all__ = [
    "FinishedTrial",
    "Question",
    "SharedTrials",
    "StudyFolder",
    "StudyJob",
    "do_run",
    "do_sampled",
    "do_study",
    "make_sampler",
    "open_trials",
    "plan_sampled",
    "plan_study",
    "rate_setting",
    "read_space",
    "read_values",
    "space_evenly",
]
