from .domain import SopDomain as SopDomain
from .problem import NodeOrder as NodeOrder
from .problem import SopConfig as SopConfig
from .problem import nodes_of as nodes_of
from .tsplib_file import read_tsplib as read_tsplib

__all__ = [
    "NodeOrder",
    "SopConfig",
    "SopDomain",
    "nodes_of",
    "read_tsplib",
]
