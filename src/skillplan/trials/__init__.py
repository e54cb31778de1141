"""Comparison of detectors and engines on executions that are known to be right or wrong."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
