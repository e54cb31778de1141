"""skillplan: in which order a robot uses its skills, with a proof or an honest gap.

Names are imported when first used, so that ``import skillplan`` is instant. ``__init__.pyi`` lists
them, for type checkers and at run time.
"""

from __future__ import annotations

import importlib
import sys

import lazy_loader as _lazy

__version__ = "0.3.0"

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

# If Gymnasium is loaded already, its registry gets the environment at once.
if "gymnasium" in sys.modules:
    importlib.import_module("skillplan.env")
