from .engine import Engine as Engine
from .kinematic import KinematicEngine as KinematicEngine
from .kinematic import find_downward_ring as find_downward_ring
from .linear_motions import LinearMotion as LinearMotion
from .linear_motions import choose_grasp as choose_grasp
from .linear_motions import find_opening_m as find_opening_m
from .linear_motions import grasp_boxes as grasp_boxes
from .linear_motions import plan_linear_motions as plan_linear_motions
from .performance import HEIGHT as HEIGHT
from .performance import WIDTH as WIDTH
from .performance import Angle as Angle
from .performance import Arrival as Arrival
from .performance import Contact as Contact
from .performance import Image as Image
from .performance import MotionPlans as MotionPlans
from .performance import Performance as Performance
from .performance import PerformedSkill as PerformedSkill
from .performance import Sample as Sample
from .performance import View as View

__all__ = [
    "HEIGHT",
    "WIDTH",
    "Angle",
    "Arrival",
    "Contact",
    "Engine",
    "Image",
    "KinematicEngine",
    "LinearMotion",
    "MotionPlans",
    "Performance",
    "PerformedSkill",
    "Sample",
    "View",
    "choose_grasp",
    "find_downward_ring",
    "find_opening_m",
    "grasp_boxes",
    "plan_linear_motions",
]
