from .arm_files import ArmFileError as ArmFileError
from .arm_files import read_arm as read_arm
from .board_generator import MOST_PARTS as MOST_PARTS
from .board_generator import MOST_TOOLS as MOST_TOOLS
from .board_generator import BoardGenerator as BoardGenerator
from .board_generator import RandomOrder as RandomOrder
from .consistency import find_issues as find_issues
from .domain import AssemblyDomain as AssemblyDomain
from .geometry_faults import measure_distances_m as measure_distances_m
from .grounding import MOST_STEPS as MOST_STEPS
from .grounding import ground as ground
from .layout import get_layout as get_layout
from .layout_family import draw_layouts as draw_layouts
from .mesh_files import MAX_BYTES as MAX_BYTES
from .mesh_files import MAX_CORNERS as MAX_CORNERS
from .mesh_files import MAX_PIECES as MAX_PIECES
from .mesh_files import SUFFIXES as SUFFIXES
from .mesh_files import MeshFileError as MeshFileError
from .mesh_files import parse_mesh as parse_mesh
from .mesh_files import parse_objects as parse_objects
from .mesh_files import read_mesh as read_mesh
from .mesh_files import read_pieces as read_pieces
from .overview import find_hints as find_hints
from .part_schema import MeshConfig as MeshConfig
from .resting import TABLE as TABLE
from .resting import find_bearers as find_bearers
from .resting import find_goal_rests as find_goal_rests
from .schema import AssemblyConfig as AssemblyConfig
from .tool_schema import ToolConfig as ToolConfig

__all__ = [
    "MAX_BYTES",
    "MAX_CORNERS",
    "MAX_PIECES",
    "MOST_PARTS",
    "MOST_STEPS",
    "MOST_TOOLS",
    "SUFFIXES",
    "TABLE",
    "ArmFileError",
    "AssemblyConfig",
    "AssemblyDomain",
    "BoardGenerator",
    "MeshConfig",
    "MeshFileError",
    "RandomOrder",
    "ToolConfig",
    "draw_layouts",
    "find_bearers",
    "find_goal_rests",
    "find_hints",
    "find_issues",
    "get_layout",
    "ground",
    "measure_distances_m",
    "parse_mesh",
    "parse_objects",
    "read_arm",
    "read_mesh",
    "read_pieces",
]
