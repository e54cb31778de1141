"""Collision detectors: check a skill's motion. They know tasks, never physics or solvers."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
