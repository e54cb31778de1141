"""Deep reinforcement learning for skillplan: DQN and PPO."""

__version__ = "0.1.0"
