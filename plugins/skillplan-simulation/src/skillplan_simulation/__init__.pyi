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
from .kinematics import kinematics_of as kinematics_of
from .kinematics import of_quaternion as of_quaternion
from .kinematics import pose_of as pose_of
from .kinematics import turn_between as turn_between
from .motions import ArmMotion as ArmMotion
from .motions import JointMotion as JointMotion
from .pictures.annotations import Projection as Projection
from .pictures.painted_camera import PaintedCamera as PaintedCamera
from .record import Record as Record
from .robot_shapes import hand_of as hand_of
from .simulator import FINGERS as FINGERS
from .simulator import HAND as HAND
from .simulator import ROBOT as ROBOT
from .simulator import STEPS_PER_S as STEPS_PER_S
from .simulator import Touch as Touch
from .static_friction import Pads as Pads
from .static_friction import utilisation as utilisation
from .verdicts import PairLimits as PairLimits
from .verdicts import frame_means as frame_means
from .verdicts import pair_verdict as pair_verdict

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
    "ToolChanger",
    "Touch",
    "Vector",
    "Workcell",
    "frame_means",
    "hand_of",
    "kinematics_of",
    "of_quaternion",
    "pair_verdict",
    "pose_of",
    "turn_between",
    "utilisation",
]
