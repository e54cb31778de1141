"""Worker processes, which do jobs for this process.

Only this package starts processes. The content of jobs is not its concern.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
