"""Assembly of a board: parts, stacks, feeders, screws and tools, after Moller et al."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
