"""Deep reinforcement learning for skillplan: DQN and PPO, each in a folder, on common ground.

It holds what computes with torch. It never reads or writes files, grades its own policies, or
imports the command line, views or trainings of skillplan.
"""

__version__ = "0.2.0"
