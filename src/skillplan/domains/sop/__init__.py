"""Sequential ordering: a TSPLIB ``.sop`` file, or the same in YAML, as a task (Escudero 1988)."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
