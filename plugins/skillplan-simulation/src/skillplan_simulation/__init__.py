"""Execution of skills by a simulated arm, and the verdicts on it, for any physics engine.

A plugin with an engine implements the interface in `simulator`. This package imports no engine.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
