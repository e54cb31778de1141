"""From CAD to a task: parts, contacts, screws, and which part blocks which in which direction.

Lengths are metres throughout; only `relation.json` and what is printed have millimetres.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

__version__ = "0.2.0"
