"""The SwarmItFIX bench: tasks, a solver for several robots, figures and chapters of reports.

It imports nothing itself, because ``skillplan plot --help`` reads the lines of its figures.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
