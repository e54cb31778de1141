"""A report as one page of HTML that needs nothing else; what others named is text in it."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
