from .batched_adam import BatchedAdam as BatchedAdam
from .batched_network import BatchedNetwork as BatchedNetwork
from .batched_network import padded as padded
from .dqn.replay_memory import ReplayMemory as ReplayMemory
from .dqn.solver import DqnSolver as DqnSolver
from .ppo.rollout_buffer import RolloutBuffer as RolloutBuffer
from .ppo.solver import PpoSolver as PpoSolver
from .relational.elements import ELEMENT_FEATURES as ELEMENT_FEATURES
from .relational.elements import ElementOrder as ElementOrder
from .relational.elements import ElementPaths as ElementPaths
from .relational.elements import ElementView as ElementView
from .relational.elements import Sight as Sight
from .relational.learning import Board as Board
from .relational.learning import Lessons as Lessons
from .relational.learning import TorchNetwork as TorchNetwork
from .relational.network import ElementChoice as ElementChoice
from .relational.network import NetworkSize as NetworkSize
from .relational.network import RelationalNetwork as RelationalNetwork
from .relational.solver import RelationalOptions as RelationalOptions
from .relational.solver import RelationalSolver as RelationalSolver
from .reward_scaling import RewardScaling as RewardScaling

__version__: str

__all__ = [
    "ELEMENT_FEATURES",
    "BatchedAdam",
    "BatchedNetwork",
    "Board",
    "DqnSolver",
    "ElementChoice",
    "ElementOrder",
    "ElementPaths",
    "ElementView",
    "Lessons",
    "NetworkSize",
    "PpoSolver",
    "RelationalNetwork",
    "RelationalOptions",
    "RelationalSolver",
    "ReplayMemory",
    "RewardScaling",
    "RolloutBuffer",
    "Sight",
    "TorchNetwork",
    "padded",
]
