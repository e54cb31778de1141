"""The sequential ordering problem (SOP), compiled: jobs into an order at the least cost."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
