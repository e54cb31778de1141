from .blocking.ray_mesh import RayMesh as RayMesh
from .build_relation import blocked_of as blocked_of
from .build_relation import joints_of as joints_of
from .build_relation import relation_of as relation_of
from .importing.findings import Confirmation as Confirmation
from .importing.planned import attitude as attitude
from .importing.planned import attitude_warnings as attitude_warnings
from .planning.assembly_plan import Planner as Planner
from .planning.assembly_plan import groups_of as groups_of
from .planning.assembly_plan import holds as holds
from .planning.assembly_plan import names_of as names_of
from .planning.assembly_plan import with_groups as with_groups
from .planning.bearing import ATTITUDES as ATTITUDES
from .planning.bearing import Bearing as Bearing
from .planning.bearing import bearing_of as bearing_of
from .planning.bearing import best_bearing as best_bearing
from .planning.free_paths import free_path as free_path
from .planning.precedence import as_set as as_set
from .planning.precedence import is_connected as is_connected
from .planning.precedence import members as members
from .planning.precedence import precedence_of as precedence_of
from .planning.precedence import touching as touching
from .planning.replay import replay as replay
from .planning.sequence import Sequencer as Sequencer
from .planning.shrunk_meshes import shrunk as shrunk
from .planning.stability import Stability as Stability
from .product import Face as Face
from .product import Part as Part
from .product import Product as Product
from .reading.glb import parts_of as parts_of
from .reading.mending import mended as mended
from .reading.product_reader import ReadOptions as ReadOptions
from .reading.product_reader import read_product as read_product
from .reading.product_reader import shapes_of as shapes_of
from .reading.raw_part import RawPart as RawPart
from .reading.step_file import Limits as Limits
from .reading.step_file import prepare as prepare
from .reading.step_file import read_apart as read_apart
from .relation import Blocking as Blocking
from .relation import Contact as Contact
from .relation import Fastener as Fastener
from .relation import Relation as Relation
from .relation import RelationPart as RelationPart
from .relation import Sensitive as Sensitive
from .relation_file import read_relation as read_relation
from .relation_file import relation_text as relation_text
from .writing.task_document import Item as Item
from .writing.task_document import task_names as task_names
from .writing.task_document import task_of as task_of
from .writing.task_document import tray as tray
from .writing.top_grasp import standing as standing
from .writing.top_grasp import top_grasp as top_grasp

__version__: str

__all__ = [
    "ATTITUDES",
    "Bearing",
    "Blocking",
    "Confirmation",
    "Contact",
    "Face",
    "Fastener",
    "Item",
    "Limits",
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
    "as_set",
    "attitude",
    "attitude_warnings",
    "bearing_of",
    "best_bearing",
    "blocked_of",
    "free_path",
    "groups_of",
    "holds",
    "is_connected",
    "joints_of",
    "members",
    "mended",
    "names_of",
    "parts_of",
    "precedence_of",
    "prepare",
    "read_apart",
    "read_product",
    "read_relation",
    "relation_of",
    "relation_text",
    "replay",
    "shapes_of",
    "shrunk",
    "standing",
    "task_names",
    "task_of",
    "top_grasp",
    "touching",
    "tray",
    "with_groups",
]
