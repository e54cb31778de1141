"""The detector `swept`: inverse kinematics, trajectory times and swept collisions of an arm.

It computes geometry without a simulator.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
