"""Deep learning for skillplan: DQN and PPO, each in a folder, on common ground.

It holds what computes with torch. It never reads or writes files, grades its own policies, or
imports the command line, views or trainings of skillplan.
"""

import os

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

__version__ = "0.3.0"

try:
    os.getcwd()
except OSError:
    # PyTorch's library MKL would end the whole program when it is loaded.
    message = "the current folder is gone, and PyTorch needs one; change to a folder that exists"
    raise ImportError(message) from None
