from .contact_detectors import ContactPairsDetector as ContactPairsDetector
from .execution.controlled_robot import ControlledRobot as ControlledRobot
from .execution.controlled_robot import ToolChanger as ToolChanger
from .execution.plan_execution import Film as Film
from .execution.planned_paths import PlannedPaths as PlannedPaths
from .execution.skill_runner import SkillRunner as SkillRunner
from .execution.surroundings import LinkBounds as LinkBounds
from .execution.surroundings import Located as Located
from .execution.surroundings import Neighbourhood as Neighbourhood
from .execution.surroundings import Surroundings as Surroundings
from .execution.workcell import Fallen as Fallen
from .execution.workcell import SupportTrials as SupportTrials
from .execution.workcell import Workcell as Workcell
from .execution_settings import ExecutionSettings as ExecutionSettings
from .kinematics import Vector as Vector
from .kinematics import compute_turn as compute_turn
from .kinematics import convert_quaternion as convert_quaternion
from .kinematics import get_kinematics as get_kinematics
from .kinematics import make_pose as make_pose
from .motions import ArmMotion as ArmMotion
from .motions import JointMotion as JointMotion
from .pictures.annotations import Projection as Projection
from .pictures.painted_camera import PaintedCamera as PaintedCamera
from .record import Record as Record
from .robot_shapes import get_hand as get_hand
from .round_bodies import undo_spin as undo_spin
from .simulator import FINGERS as FINGERS
from .simulator import HAND as HAND
from .simulator import ROBOT as ROBOT
from .simulator import STEPS_PER_S as STEPS_PER_S
from .simulator import Touch as Touch
from .static_friction import Pads as Pads
from .static_friction import compute_utilisation as compute_utilisation
from .verdicts import PairLimits as PairLimits
from .verdicts import Tolerances as Tolerances
from .verdicts import average_frames as average_frames
from .verdicts import check_pairs as check_pairs
from .verdicts import check_postcondition as check_postcondition

__all__ = [
    "FINGERS",
    "HAND",
    "ROBOT",
    "STEPS_PER_S",
    "ArmMotion",
    "ContactPairsDetector",
    "ControlledRobot",
    "ExecutionSettings",
    "Fallen",
    "Film",
    "JointMotion",
    "LinkBounds",
    "Located",
    "Neighbourhood",
    "Pads",
    "PaintedCamera",
    "PairLimits",
    "PlannedPaths",
    "Projection",
    "Record",
    "SkillRunner",
    "SupportTrials",
    "Surroundings",
    "Tolerances",
    "ToolChanger",
    "Touch",
    "Vector",
    "Workcell",
    "average_frames",
    "check_pairs",
    "check_postcondition",
    "compute_turn",
    "compute_utilisation",
    "convert_quaternion",
    "get_hand",
    "get_kinematics",
    "make_pose",
    "undo_spin",
]
