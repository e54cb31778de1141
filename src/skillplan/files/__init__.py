"""Safe reading and writing of files: limits, regular files only, atomic replacement.

The content of files is not its concern; `schema_errors` only describes faults that a schema finds.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
