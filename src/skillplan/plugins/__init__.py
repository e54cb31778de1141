"""Plugins before they are imported: their distributions, and messages about their errors.

Imports no plugin; `skillplan.pipeline.registry` validates them.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
