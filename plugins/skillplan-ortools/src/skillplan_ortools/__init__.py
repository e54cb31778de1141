"""The solver `cp-sat`, by OR-Tools: the order of jobs as a circuit of a constraint model.

Its input is a sequencing problem, never a task or a back end.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

__version__ = "0.3.0"
