"""Deep reinforcement learning for skillplan: DQN and PPO."""

__version__ = "0.2.0"
