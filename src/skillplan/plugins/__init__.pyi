from .blame import Interrupted as Interrupted

__all__ = [
    "Interrupted",
]
