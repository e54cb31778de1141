"""Processes that do jobs for this one.

The only floor that starts any, and it never knows what a job means.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
