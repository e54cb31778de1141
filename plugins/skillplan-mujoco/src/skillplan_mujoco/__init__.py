"""A second physics engine: skills executed by a simulated arm in MuJoCo.

What the arm does, and what that proves, is shared with every engine and lives in
`skillplan_simulation`; here is the world it does it in.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
