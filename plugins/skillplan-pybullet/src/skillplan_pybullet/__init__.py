"""An arm in pybullet: the engine, and a detector that reads its contact forces."""

import lazy_loader as _lazy

from skillplan_pybullet.quiet_output import quiet_output

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

# pybullet prints its build time when it is imported.
with quiet_output():
    import pybullet as pybullet
