from .component_jobs import ComponentJobs as ComponentJobs
from .enumeration import enumerate_feasibility as enumerate_feasibility
from .obstruction import explain_obstruction as explain_obstruction
from .policy_value import evaluate_policy as evaluate_policy
from .policy_value import roll_out as roll_out
from .policy_value import sample_policy as sample_policy
from .replay import Replay as Replay
from .replay import Step as Step
from .replay import replay as replay
from .sequencing import SequencingProblem as SequencingProblem
from .skill_model import SkillModel as SkillModel
from .skill_model import Transition as Transition
from .tabular_mdp import TabularMDP as TabularMDP
from .tabular_mdp import compute_least_expected_cost as compute_least_expected_cost

__all__ = [
    "ComponentJobs",
    "Replay",
    "SequencingProblem",
    "SkillModel",
    "Step",
    "TabularMDP",
    "Transition",
    "compute_least_expected_cost",
    "enumerate_feasibility",
    "evaluate_policy",
    "explain_obstruction",
    "replay",
    "roll_out",
    "sample_policy",
]
