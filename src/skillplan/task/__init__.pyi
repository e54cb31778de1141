from .back_end import BackEnd as BackEnd
from .cost import NEVER as NEVER
from .cost import CaseCost as CaseCost
from .cost import ConstantCost as ConstantCost
from .cost import Cost as Cost
from .cost import DistanceCost as DistanceCost
from .cost import TableCost as TableCost
from .cost import WeightedCost as WeightedCost
from .cost import compute_planar_distance as compute_planar_distance
from .motion import AXES as AXES
from .motion import Event as Event
from .motion import Grasp as Grasp
from .motion import GraspKind as GraspKind
from .motion import Motion as Motion
from .motion import Route as Route
from .motion import Visit as Visit
from .pose import DOWN as DOWN
from .pose import Point as Point
from .pose import Pose as Pose
from .pose import cross as cross
from .pose import dot as dot
from .pose import plus as plus
from .pose import unit as unit
from .reward import DistanceReward as DistanceReward
from .reward import Penalty as Penalty
from .reward import RewardScheme as RewardScheme
from .scene import WORLD as WORLD
from .scene import Body as Body
from .scene import Holder as Holder
from .scene import Placement as Placement
from .scene import Robot as Robot
from .scene import Scene as Scene
from .scene import Shank as Shank
from .scene import Tool as Tool
from .scene import ToolKind as ToolKind
from .scene import Workholder as Workholder
from .scene import Zone as Zone
from .shape import Box as Box
from .shape import Cylinder as Cylinder
from .shape import Mesh as Mesh
from .shape import move_shape as move_shape
from .skill import Case as Case
from .skill import Outcome as Outcome
from .skill import Skill as Skill
from .state import Condition as Condition
from .state import Facts as Facts
from .state import State as State
from .task import BackEndChoice as BackEndChoice
from .task import Literal as Literal
from .task import Metric as Metric
from .task import Place as Place
from .task import Precedence as Precedence
from .task import Task as Task
from .task import find_unreachable_facts as find_unreachable_facts
from .task import read_start_state as read_start_state
from .verdict import Verdict as Verdict
from .verdict import VerdictStatus as VerdictStatus

__all__ = [
    "AXES",
    "DOWN",
    "NEVER",
    "WORLD",
    "BackEnd",
    "BackEndChoice",
    "Body",
    "Box",
    "Case",
    "CaseCost",
    "Condition",
    "ConstantCost",
    "Cost",
    "Cylinder",
    "DistanceCost",
    "DistanceReward",
    "Event",
    "Facts",
    "Grasp",
    "GraspKind",
    "Holder",
    "Literal",
    "Mesh",
    "Metric",
    "Motion",
    "Outcome",
    "Penalty",
    "Place",
    "Placement",
    "Point",
    "Pose",
    "Precedence",
    "RewardScheme",
    "Robot",
    "Route",
    "Scene",
    "Shank",
    "Skill",
    "State",
    "TableCost",
    "Task",
    "Tool",
    "ToolKind",
    "Verdict",
    "VerdictStatus",
    "Visit",
    "WeightedCost",
    "Workholder",
    "Zone",
    "compute_planar_distance",
    "cross",
    "dot",
    "find_unreachable_facts",
    "move_shape",
    "plus",
    "read_start_state",
    "unit",
]
