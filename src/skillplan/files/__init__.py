"""Reading and writing files safely: limits, regular files only, atomic replacement.

It never knows what a file means; `schema_errors` only words what a schema finds wrong in one.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
