from .exporter import TEXT_TYPE as TEXT_TYPE
from .exporter import TRAJECTORY_TYPE as TRAJECTORY_TYPE
from .exporter import message_types as message_types

__version__: str

__all__ = [
    "TEXT_TYPE",
    "TRAJECTORY_TYPE",
    "message_types",
]
