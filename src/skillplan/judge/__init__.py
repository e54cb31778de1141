"""Grading of solvers: replays of plans, checks of claims, second proofs."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
