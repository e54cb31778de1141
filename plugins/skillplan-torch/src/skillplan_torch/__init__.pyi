from .dqn.learner import DqnSolver as DqnSolver
from .dqn.update import ReplayMemory as ReplayMemory
from .network_learner import RewardScaling as RewardScaling
from .networks import BatchedAdam as BatchedAdam
from .networks import BatchedNetwork as BatchedNetwork
from .networks import padded as padded
from .ppo.learner import PpoSolver as PpoSolver
from .ppo.update import RolloutBuffer as RolloutBuffer
from .relational.elements import ELEMENT_FEATURES as ELEMENT_FEATURES
from .relational.elements import ElementGraph as ElementGraph
from .relational.elements import ElementOrder as ElementOrder
from .relational.elements import ElementPaths as ElementPaths
from .relational.elements import ElementView as ElementView
from .relational.learning import Board as Board
from .relational.learning import Lessons as Lessons
from .relational.learning import TorchNetwork as TorchNetwork
from .relational.network import ElementChoice as ElementChoice
from .relational.network import NetworkSize as NetworkSize
from .relational.network import RelationalNetwork as RelationalNetwork
from .relational.solver import RelationalOptions as RelationalOptions
from .relational.solver import RelationalSolver as RelationalSolver

__version__: str

__all__ = [
    "ELEMENT_FEATURES",
    "BatchedAdam",
    "BatchedNetwork",
    "Board",
    "DqnSolver",
    "ElementChoice",
    "ElementGraph",
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
    "TorchNetwork",
    "padded",
]
