"""Verdicts of back ends: the floor that queries them, once, reuses and keeps the answers.

It never knows about solvers.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
