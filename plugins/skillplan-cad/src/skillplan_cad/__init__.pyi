from .blocking.ray_mesh import RayMesh as RayMesh
from .build_relation import assemble_relation as assemble_relation
from .build_relation import find_blocked as find_blocked
from .build_relation import find_joints as find_joints
from .importing.findings import Confirmation as Confirmation
from .importing.findings import analyse_product as analyse_product
from .importing.findings import analyse_units as analyse_units
from .importing.findings import describe_unit_doubt as describe_unit_doubt
from .importing.materials import assign_materials as assign_materials
from .importing.materials import parse_material as parse_material
from .importing.planned import choose_attitude as choose_attitude
from .importing.planned import find_common_pattern as find_common_pattern
from .importing.planned import list_attitude_warnings as list_attitude_warnings
from .importing.planned import list_stuck as list_stuck
from .importing.planned import list_thinned as list_thinned
from .importing.planned import list_turn_lines as list_turn_lines
from .importing.settings import ImportSettings as ImportSettings
from .importing.settings import parse_settings as parse_settings
from .joints.fastener_names import recognise_kind as recognise_kind
from .joints.fasteners_of import FastenerOptions as FastenerOptions
from .joints.fits import FitOptions as FitOptions
from .joints.fits import compute_allowance_m as compute_allowance_m
from .joints.fits import compute_thread_depth_m as compute_thread_depth_m
from .joints.fits import relieve_fits as relieve_fits
from .nests.nest import KeepFree as KeepFree
from .nests.nest import Nest as Nest
from .nests.nest import NestSettings as NestSettings
from .nests.nest import build_jaws as build_jaws
from .nests.nest import build_nest as build_nest
from .nests.nest_check import NestCheck as NestCheck
from .nests.nest_check import check_nest as check_nest
from .planning.assembly_plan import Planner as Planner
from .planning.assembly_plan import add_groups as add_groups
from .planning.assembly_plan import find_groups as find_groups
from .planning.assembly_plan import list_names as list_names
from .planning.bearing import ATTITUDES as ATTITUDES
from .planning.bearing import Bearing as Bearing
from .planning.bearing import find_bearing as find_bearing
from .planning.bearing import find_best_bearing as find_best_bearing
from .planning.free_paths import find_free_path as find_free_path
from .planning.precedence import derive_precedence as derive_precedence
from .planning.precedence import encode_set as encode_set
from .planning.precedence import find_touching as find_touching
from .planning.precedence import is_connected as is_connected
from .planning.precedence import list_members as list_members
from .planning.replay import replay as replay
from .planning.sequence import Sequencer as Sequencer
from .planning.shrunk_meshes import shrink_mesh as shrink_mesh
from .planning.stability import Stability as Stability
from .planning.turns import add_turns as add_turns
from .planning.watch import Watch as Watch
from .product import Face as Face
from .product import Part as Part
from .product import Product as Product
from .reading.mending import mend as mend
from .reading.occt_reader import read_document as read_document
from .reading.product_reader import ReadOptions as ReadOptions
from .reading.product_reader import find_shapes as find_shapes
from .reading.product_reader import read_product as read_product
from .reading.raw_part import Instance as Instance
from .reading.raw_part import RawPart as RawPart
from .reading.raw_part import StepContent as StepContent
from .reading.step_file import Limits as Limits
from .reading.step_file import prepare as prepare
from .reading.step_file import read_in_process as read_in_process
from .relation import Blocking as Blocking
from .relation import Contact as Contact
from .relation import Fastener as Fastener
from .relation import LeftOut as LeftOut
from .relation import Relation as Relation
from .relation import RelationPart as RelationPart
from .relation import Sensitive as Sensitive
from .relation_file import format_relation as format_relation
from .relation_file import read_relation as read_relation
from .writing.arm_choice import choose_arm as choose_arm
from .writing.build_task import build_task as build_task
from .writing.convex_pieces import decompose_convex as decompose_convex
from .writing.grouped_task import find_parted_groups as find_parted_groups
from .writing.grouped_task import join_groups as join_groups
from .writing.heading import choose_heading as choose_heading
from .writing.held_part import Load as Load
from .writing.held_part import list_holds as list_holds
from .writing.lanes import Lane as Lane
from .writing.mesh_grasps import GraspFinder as GraspFinder
from .writing.task_document import Item as Item
from .writing.task_document import assign_task_names as assign_task_names
from .writing.task_document import build_tool_entries as build_tool_entries
from .writing.task_document import lay_out_parts as lay_out_parts
from .writing.task_document import lay_out_table as lay_out_table
from .writing.trial import TaskTrials as TaskTrials
from .writing.upright import place_upright as place_upright

__version__: str

__all__ = [
    "ATTITUDES",
    "Bearing",
    "Blocking",
    "Confirmation",
    "Contact",
    "Face",
    "Fastener",
    "FastenerOptions",
    "FitOptions",
    "GraspFinder",
    "ImportSettings",
    "Instance",
    "Item",
    "KeepFree",
    "Lane",
    "LeftOut",
    "Limits",
    "Load",
    "Nest",
    "NestCheck",
    "NestSettings",
    "Part",
    "Planner",
    "Product",
    "RawPart",
    "RayMesh",
    "ReadOptions",
    "Relation",
    "RelationPart",
    "Sensitive",
    "Sequencer",
    "Stability",
    "StepContent",
    "TaskTrials",
    "Watch",
    "add_groups",
    "add_turns",
    "analyse_product",
    "analyse_units",
    "assemble_relation",
    "assign_materials",
    "assign_task_names",
    "build_jaws",
    "build_nest",
    "build_task",
    "build_tool_entries",
    "check_nest",
    "choose_arm",
    "choose_attitude",
    "choose_heading",
    "compute_allowance_m",
    "compute_thread_depth_m",
    "decompose_convex",
    "derive_precedence",
    "describe_unit_doubt",
    "encode_set",
    "find_bearing",
    "find_best_bearing",
    "find_blocked",
    "find_common_pattern",
    "find_free_path",
    "find_groups",
    "find_joints",
    "find_parted_groups",
    "find_shapes",
    "find_touching",
    "format_relation",
    "is_connected",
    "join_groups",
    "lay_out_parts",
    "lay_out_table",
    "list_attitude_warnings",
    "list_holds",
    "list_members",
    "list_names",
    "list_stuck",
    "list_thinned",
    "list_turn_lines",
    "mend",
    "parse_material",
    "parse_settings",
    "place_upright",
    "prepare",
    "read_document",
    "read_in_process",
    "read_product",
    "read_relation",
    "recognise_kind",
    "relieve_fits",
    "replay",
    "shrink_mesh",
]
