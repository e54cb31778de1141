"""Detectors and engines compared on executions known to be right or wrong, and with each other.

Never a part of solving.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
