from .engine import MujocoEngine as MujocoEngine
from .engine import MujocoSimulator as MujocoSimulator
from .world import World as World

__all__ = [
    "MujocoEngine",
    "MujocoSimulator",
    "World",
]
