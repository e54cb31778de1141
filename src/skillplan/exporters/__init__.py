"""Exporters of tasks and plans, and a reader of plans. They write no files.

A format refuses, with a message, tasks that it cannot represent.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
