"""The executor `ray`: jobs are done by actors of a Ray cluster.

It knows jobs as bytes only, never tasks, back ends or what is learned.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

__version__ = "0.2.0"
