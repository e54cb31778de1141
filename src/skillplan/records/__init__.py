"""Results as data with their JSON and the files they are kept in; never a table or a picture."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
