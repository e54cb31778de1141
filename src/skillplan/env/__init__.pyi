from .observation import Observation as Observation
from .observation import RewardFunction as RewardFunction
from .sb3_vec_env import Sb3VecEnv as Sb3VecEnv
from .skill_env import SkillEnv as SkillEnv
from .skill_vector_env import SkillVectorEnv as SkillVectorEnv
from .transition_table import COMPLETE as COMPLETE
from .transition_table import GOES_ON as GOES_ON
from .transition_table import INFEASIBLE as INFEASIBLE
from .transition_table import OUT_OF_TIME as OUT_OF_TIME

ENVIRONMENT: str

__all__ = [
    "COMPLETE",
    "GOES_ON",
    "INFEASIBLE",
    "OUT_OF_TIME",
    "Observation",
    "RewardFunction",
    "Sb3VecEnv",
    "SkillEnv",
    "SkillVectorEnv",
]
