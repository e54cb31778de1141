from .engine import Engine as Engine
from .kinematic import KinematicEngine as KinematicEngine
from .kinematic import straight_down as straight_down
from .linear_motions import LinearMotion as LinearMotion
from .linear_motions import grasp_of as grasp_of
from .linear_motions import jaws_about as jaws_about
from .linear_motions import linear_motions as linear_motions
from .linear_motions import widest_m as widest_m
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
    "grasp_of",
    "jaws_about",
    "linear_motions",
    "straight_down",
    "widest_m",
]
