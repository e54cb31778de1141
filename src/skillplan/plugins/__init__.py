"""What is known of plugins before any is called: who installed them, and what they raise.

Imports no plugin; which are valid, `skillplan.pipeline.registry` says.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
