"""Reports as single pages of HTML, in which names from documents are escaped."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
