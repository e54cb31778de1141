from .actor import DONE as DONE
from .actor import READY as READY
from .cluster import signals_held as signals_held
from .executor import RayExecutor as RayExecutor
from .fingerprint import LIBRARIES as LIBRARIES
from .fingerprint import differences as differences
from .worker import RayWorker as RayWorker

__version__: str

__all__ = [
    "DONE",
    "LIBRARIES",
    "READY",
    "RayExecutor",
    "RayWorker",
    "differences",
    "signals_held",
]
