from .domain import SopDomain as SopDomain
from .problem import NodeOrder as NodeOrder
from .problem import SopConfig as SopConfig
from .problem import list_nodes as list_nodes
from .tsplib_file import read_tsplib as read_tsplib

__all__ = [
    "NodeOrder",
    "SopConfig",
    "SopDomain",
    "list_nodes",
    "read_tsplib",
]
