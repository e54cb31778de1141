"""The detector `swept`: inverse kinematics, trajectory times and swept collisions of a Panda.

It computes geometry, without a simulator; it never executes a skill, solves or shows anything.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
