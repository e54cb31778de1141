"""The executor `ray`: actors of a Ray cluster do the jobs.

Jobs are bytes to it, never tasks, back ends or learned models.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

__version__ = "0.3.0"
