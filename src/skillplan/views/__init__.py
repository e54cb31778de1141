"""Tables, figures, reports and videos of records.

It never computes a result, and only the CLI imports it.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
