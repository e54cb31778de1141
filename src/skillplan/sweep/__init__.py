"""Parameter studies: a solver under many settings, each with several seeds, from several starts."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
