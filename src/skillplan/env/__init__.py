"""Gymnasium environments of the lazy model, for learners.

Importing this package registers the environment ``skillplan/Task-v0`` with Gymnasium.
"""

import lazy_loader as _lazy
from gymnasium.envs.registration import register, registry

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)

ENVIRONMENT = "skillplan/Task-v0"

if ENVIRONMENT not in registry:
    # A name instead of the class, because the loader of task files is in a higher layer.
    register(
        ENVIRONMENT,
        entry_point="skillplan.pipeline.gymnasium_entry:make_env",
        vector_entry_point="skillplan.pipeline.gymnasium_entry:make_vector_env",
    )
