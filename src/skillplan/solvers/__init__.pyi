from .auto import AutoSolver as AutoSolver
from .gap import deviation as deviation
from .gap import relative_gap as relative_gap
from .kernels import compiled as compiled
from .learning.carried_over import NamedNetwork as NamedNetwork
from .learning.episode_kernels import Environment as Environment
from .learning.episode_kernels import Schedule as Schedule
from .learning.episode_kernels import monte_carlo_episodes as monte_carlo_episodes
from .learning.episode_kernels import random_bits as random_bits
from .learning.episodic_solver import greedy_rows as greedy_rows
from .learning.family_learner import FamilyLesson as FamilyLesson
from .learning.learner import End as End
from .learning.learner import Episode as Episode
from .learning.learner import Learned as Learned
from .learning.learner import Learner as Learner
from .learning.learner import LearnerOptions as LearnerOptions
from .learning.learner import Snapshot as Snapshot
from .learning.learner import Training as Training
from .learning.network_choice import NetworkChoice as NetworkChoice
from .learning.network_choice import reachable_policy as reachable_policy
from .learning.network_policy import NetworkPolicy as NetworkPolicy
from .learning.network_policy import allowed_scores as allowed_scores
from .learning.network_policy import allowing as allowing
from .learning.network_policy import random_actions as random_actions
from .learning.sarsa import SarsaSolver as SarsaSolver
from .learning.training_length import usual_steps as usual_steps
from .search.csp import CspSolver as CspSolver
from .search.exact import ExactSolver as ExactSolver
from .search.exhaustive import ExhaustiveSolver as ExhaustiveSolver
from .search.landmark_bound import COST_UNIT as COST_UNIT
from .search.landmark_bound import LandmarkBound as LandmarkBound
from .search.landmark_bound import from_units as from_units
from .search.landmark_bound import to_units as to_units
from .solution import Plan as Plan
from .solution import Policy as Policy
from .solution import Solution as Solution
from .solver import Solver as Solver
from .stop import Progress as Progress
from .stop import Stop as Stop

__all__ = [
    "COST_UNIT",
    "AutoSolver",
    "CspSolver",
    "End",
    "Environment",
    "Episode",
    "ExactSolver",
    "ExhaustiveSolver",
    "FamilyLesson",
    "LandmarkBound",
    "Learned",
    "Learner",
    "LearnerOptions",
    "NamedNetwork",
    "NetworkChoice",
    "NetworkPolicy",
    "Plan",
    "Policy",
    "Progress",
    "SarsaSolver",
    "Schedule",
    "Snapshot",
    "Solution",
    "Solver",
    "Stop",
    "Training",
    "allowed_scores",
    "allowing",
    "compiled",
    "deviation",
    "from_units",
    "greedy_rows",
    "monte_carlo_episodes",
    "random_actions",
    "random_bits",
    "reachable_policy",
    "relative_gap",
    "to_units",
    "usual_steps",
]
