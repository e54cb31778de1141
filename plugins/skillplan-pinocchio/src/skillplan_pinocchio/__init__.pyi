from .arm_model import ArmModel as ArmModel
from .arm_model import LinkPiece as LinkPiece
from .arm_model import get_closing_yaw_rad as get_closing_yaw_rad
from .arm_model import make_hand_pose as make_hand_pose
from .arm_model import make_pose_down as make_pose_down
from .convex_pieces import convex_pieces as convex_pieces
from .gravity import GravityCheck as GravityCheck
from .hand_sweeps import HandSweeps as HandSweeps
from .hand_sweeps import build_hand_parts as build_hand_parts
from .inverse_kinematics import Strokes as Strokes
from .inverse_kinematics import Unreachable as Unreachable
from .inverse_kinematics import iterate_descents as iterate_descents
from .inverse_kinematics import iterate_elbows as iterate_elbows
from .inverse_kinematics import iterate_postures as iterate_postures
from .inverse_kinematics import iterate_strokes as iterate_strokes
from .inverse_kinematics import solve as solve
from .kinematics.joint_path import JointPath as JointPath
from .kinematics.numeric_inverse import NumericInverse as NumericInverse
from .kinematics.numeric_inverse import Unreached as Unreached
from .kinematics.serial_arm import SerialArm as SerialArm
from .kinematics.ur_inverse import UrInverse as UrInverse
from .kinematics.ur_inverse import UrLengths as UrLengths
from .mass_properties import compute_mass_properties as compute_mass_properties
from .motion_plan import LinkSweep as LinkSweep
from .motion_plan import MotionPlanner as MotionPlanner
from .planning.arm_bodies import ArmBodies as ArmBodies
from .planning.arm_bodies import build_arm_solids as build_arm_solids
from .planning.continuous_check import ITSELF as ITSELF
from .planning.continuous_check import ContinuousCheck as ContinuousCheck
from .planning.continuous_check import SelfCheck as SelfCheck
from .planning.travel import Travel as Travel
from .planning.travel import Unfound as Unfound
from .planning.travel_planner import TravelHeights as TravelHeights
from .planning.travel_planner import TravelPlanner as TravelPlanner
from .shapes import TABLE as TABLE
from .shapes import ConvexPiece as ConvexPiece
from .shapes import Obstacle as Obstacle
from .shapes import SurfacePiece as SurfacePiece
from .shapes import collect_obstacles as collect_obstacles
from .shapes import compute_box_corners as compute_box_corners
from .shapes import get_corners as get_corners
from .shapes import make_pieces as make_pieces
from .shapes import make_standing_pieces as make_standing_pieces
from .shapes import make_table as make_table
from .shapes import measure_distance as measure_distance
from .support import compute_planar_hull as compute_planar_hull
from .support import find_supports as find_supports
from .support import intersect as intersect
from .sweep import Sweep as Sweep
from .swept import SweptDetector as SweptDetector
from .timing.skill_times import bound_duration_s as bound_duration_s
from .timing.slow_zones import SlowZones as SlowZones
from .timing.trajectory import JointLimits as JointLimits
from .timing.trajectory import find_fastest_trajectory as find_fastest_trajectory

__all__ = [
    "ITSELF",
    "TABLE",
    "ArmBodies",
    "ArmModel",
    "ContinuousCheck",
    "ConvexPiece",
    "GravityCheck",
    "HandSweeps",
    "JointLimits",
    "JointPath",
    "LinkPiece",
    "LinkSweep",
    "MotionPlanner",
    "NumericInverse",
    "Obstacle",
    "SelfCheck",
    "SerialArm",
    "SlowZones",
    "Strokes",
    "SurfacePiece",
    "Sweep",
    "SweptDetector",
    "Travel",
    "TravelHeights",
    "TravelPlanner",
    "Unfound",
    "Unreachable",
    "Unreached",
    "UrInverse",
    "UrLengths",
    "bound_duration_s",
    "build_arm_solids",
    "build_hand_parts",
    "collect_obstacles",
    "compute_box_corners",
    "compute_mass_properties",
    "compute_planar_hull",
    "convex_pieces",
    "find_fastest_trajectory",
    "find_supports",
    "get_closing_yaw_rad",
    "get_corners",
    "intersect",
    "iterate_descents",
    "iterate_elbows",
    "iterate_postures",
    "iterate_strokes",
    "make_hand_pose",
    "make_pieces",
    "make_pose_down",
    "make_standing_pieces",
    "make_table",
    "measure_distance",
    "solve",
]
