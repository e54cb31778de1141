from .option_values import read_space as read_space
from .option_values import read_values as read_values
from .option_values import spaced as spaced
from .parameter_study import do_sampled as do_sampled
from .parameter_study import do_study as do_study
from .parameter_study import make_sampler as make_sampler
from .parameter_study import plan_sampled as plan_sampled
from .parameter_study import plan_study as plan_study
from .parameter_study import shared_trials as shared_trials
from .parameter_study import value_of as value_of
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
    "plan_sampled",
    "plan_study",
    "read_space",
    "read_values",
    "shared_trials",
    "spaced",
    "value_of",
]
