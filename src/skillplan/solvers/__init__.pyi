from .auto import AutoSolver as AutoSolver
from .kernels import compiled as compiled
from .learned_model.action_model import Conditions as Conditions
from .learned_model.plan_search import Words as Words
from .learned_model.planned_episodes import PlannedEpisodes as PlannedEpisodes
from .learned_model.solver import GOAL as GOAL
from .learned_model.solver import LearnedModelSolver as LearnedModelSolver
from .learned_model.solver import LearnedModelTraining as LearnedModelTraining
from .learned_model.solver import OutcomeTable as OutcomeTable
from .learning.episode_kernels import random_bits as random_bits
from .learning.episode_training import BestPolicies as BestPolicies
from .learning.episode_training import CompletedEpisode as CompletedEpisode
from .learning.family_learner import FamilyLesson as FamilyLesson
from .learning.learner import End as End
from .learning.learner import Episode as Episode
from .learning.learner import Learned as Learned
from .learning.learner import Learner as Learner
from .learning.learner import LearnerOptions as LearnerOptions
from .learning.learner import NetworkChoice as NetworkChoice
from .learning.learner import Snapshot as Snapshot
from .learning.learner import Training as Training
from .learning.learner import is_certain as is_certain
from .learning.learner import reachable_policy as reachable_policy
from .learning.learner import usual_steps as usual_steps
from .learning.network_policy import ActionRule as ActionRule
from .learning.network_policy import NamedNetwork as NamedNetwork
from .learning.network_policy import NetworkPolicy as NetworkPolicy
from .learning.network_policy import allowed_scores as allowed_scores
from .learning.network_policy import allowing as allowing
from .learning.network_policy import lookup_network as lookup_network
from .learning.network_policy import random_actions as random_actions
from .learning.observation_counts import ObservationCounts as ObservationCounts
from .learning.observation_counts import double_rows as double_rows
from .learning.observation_counts import take_rows as take_rows
from .learning.tabular import EpisodicSolver as EpisodicSolver
from .learning.tabular import SarsaSolver as SarsaSolver
from .search.csp import CspSolver as CspSolver
from .search.exact import ExactSolver as ExactSolver
from .search.exhaustive import ExhaustiveSolver as ExhaustiveSolver
from .search.front import Objective as Objective
from .search.front import search_front as search_front
from .search.landmark_bound import COST_UNIT as COST_UNIT
from .search.landmark_bound import LandmarkBound as LandmarkBound
from .search.landmark_bound import convert_from_units as convert_from_units
from .search.landmark_bound import convert_to_units as convert_to_units
from .solution import Plan as Plan
from .solution import Policy as Policy
from .solution import Solution as Solution
from .solution import deviation as deviation
from .solution import relative_gap as relative_gap
from .solver import Solver as Solver
from .stop import Progress as Progress
from .stop import Stop as Stop

__all__ = [
    "COST_UNIT",
    "GOAL",
    "ActionRule",
    "AutoSolver",
    "BestPolicies",
    "CompletedEpisode",
    "Conditions",
    "CspSolver",
    "End",
    "Episode",
    "EpisodicSolver",
    "ExactSolver",
    "ExhaustiveSolver",
    "FamilyLesson",
    "LandmarkBound",
    "Learned",
    "LearnedModelSolver",
    "LearnedModelTraining",
    "Learner",
    "LearnerOptions",
    "NamedNetwork",
    "NetworkChoice",
    "NetworkPolicy",
    "Objective",
    "ObservationCounts",
    "OutcomeTable",
    "Plan",
    "PlannedEpisodes",
    "Policy",
    "Progress",
    "SarsaSolver",
    "Snapshot",
    "Solution",
    "Solver",
    "Stop",
    "Training",
    "Words",
    "allowed_scores",
    "allowing",
    "compiled",
    "convert_from_units",
    "convert_to_units",
    "deviation",
    "double_rows",
    "is_certain",
    "lookup_network",
    "random_actions",
    "random_bits",
    "reachable_policy",
    "relative_gap",
    "search_front",
    "take_rows",
    "usual_steps",
]
