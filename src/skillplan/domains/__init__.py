"""Kinds of task: a YAML schema and the grounding of its content to tasks, one folder a kind."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
