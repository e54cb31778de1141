from .arm_model import ArmModel as ArmModel
from .arm_model import LinkPiece as LinkPiece
from .arm_model import closing_yaw_rad as closing_yaw_rad
from .arm_model import hand_pose as hand_pose
from .arm_model import pose_down as pose_down
from .convex_pieces import convex_pieces as convex_pieces
from .gravity import GravityCheck as GravityCheck
from .hand_sweeps import HandSweeps as HandSweeps
from .hand_sweeps import hand_parts as hand_parts
from .inverse_kinematics import Strokes as Strokes
from .inverse_kinematics import Unreachable as Unreachable
from .inverse_kinematics import descent_paths as descent_paths
from .inverse_kinematics import elbows as elbows
from .inverse_kinematics import postures as postures
from .inverse_kinematics import solve as solve
from .inverse_kinematics import strokes as strokes
from .kinematics.joint_path import JointPath as JointPath
from .kinematics.numeric_inverse import NumericInverse as NumericInverse
from .kinematics.numeric_inverse import Unreached as Unreached
from .kinematics.serial_arm import SerialArm as SerialArm
from .kinematics.ur_inverse import UrInverse as UrInverse
from .kinematics.ur_inverse import UrLengths as UrLengths
from .mass_properties import mass_properties as mass_properties
from .motion_plan import LinkSweep as LinkSweep
from .motion_plan import MotionPlanner as MotionPlanner
from .planning.arm_bodies import ArmBodies as ArmBodies
from .planning.arm_bodies import arm_solids as arm_solids
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
from .shapes import box_corners as box_corners
from .shapes import corners_of as corners_of
from .shapes import nearness as nearness
from .shapes import obstacles_of as obstacles_of
from .shapes import pieces_of as pieces_of
from .shapes import standing_pieces_of as standing_pieces_of
from .shapes import table as table
from .support import intersection as intersection
from .support import planar_hull as planar_hull
from .support import supports_of as supports_of
from .sweep import Sweep as Sweep
from .swept import SweptDetector as SweptDetector
from .timing.skill_times import least_between_s as least_between_s
from .timing.trajectory import JointLimits as JointLimits
from .timing.trajectory import fastest_trajectory as fastest_trajectory

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
    "arm_solids",
    "box_corners",
    "closing_yaw_rad",
    "convex_pieces",
    "corners_of",
    "descent_paths",
    "elbows",
    "fastest_trajectory",
    "hand_parts",
    "hand_pose",
    "intersection",
    "least_between_s",
    "mass_properties",
    "nearness",
    "obstacles_of",
    "pieces_of",
    "planar_hull",
    "pose_down",
    "postures",
    "solve",
    "standing_pieces_of",
    "strokes",
    "supports_of",
    "table",
]
