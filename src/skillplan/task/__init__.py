"""Tasks as pure data: states, conditions, skills, costs, rewards, scenes and verdicts."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
