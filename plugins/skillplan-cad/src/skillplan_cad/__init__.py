"""Import CAD as a task: parts, contacts, screws, and a blocking relation along directions.

Lengths are metres; only `relation.json` and printed output use millimetres.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

__version__ = "0.3.0"
