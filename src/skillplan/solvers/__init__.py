"""Solvers: find a plan or policy on a model. They never import physics or collision."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
