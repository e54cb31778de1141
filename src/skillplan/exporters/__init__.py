"""A task, or a plan of it, in formats that other tools read; and plans read back from them.

Writes no file itself, and decides nothing: what a format cannot say is refused in words.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
