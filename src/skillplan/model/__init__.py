"""The lazy skill-transition model; it never queries a back end itself, `checks` does."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
