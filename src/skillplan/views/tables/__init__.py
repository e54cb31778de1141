"""Records as tables for terminal, CSV and Markdown; never a figure that a record does not hold."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
