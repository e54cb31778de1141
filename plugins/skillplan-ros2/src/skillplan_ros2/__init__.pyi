from .exporter import TEXT_TYPE as TEXT_TYPE
from .exporter import TRAJECTORY_TYPE as TRAJECTORY_TYPE
from .exporter import TURN_TYPE as TURN_TYPE
from .exporter import list_message_types as list_message_types

__version__: str

__all__ = [
    "TEXT_TYPE",
    "TRAJECTORY_TYPE",
    "TURN_TYPE",
    "list_message_types",
]
