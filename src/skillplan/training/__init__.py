"""Training of learners: runs kept in a folder, and taken up again bit for bit."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
