from .aabb import AabbDetector as AabbDetector
from .boxes import WorldBox as WorldBox
from .boxes import centroid as centroid
from .boxes import contact_area as contact_area
from .boxes import sweep_hits as sweep_hits
from .boxes import world_box as world_box
from .boxes import world_boxes as world_boxes
from .decomposition import NoPieces as NoPieces
from .decomposition import decomposition_of as decomposition_of
from .detector import Detector as Detector
from .hulls import Hull as Hull
from .hulls import HullDetector as HullDetector
from .hulls import HullRole as HullRole
from .hulls import HullScene as HullScene
from .precedence import PrecedenceDetector as PrecedenceDetector
from .solid import TOUCH_M as TOUCH_M
from .solid import Solid as Solid
from .solid import covered as covered
from .surface import deepest_within as deepest_within
from .surface import depths as depths
from .surface import outermost as outermost
from .surface import polyhedron_of as polyhedron_of

__all__ = [
    "TOUCH_M",
    "AabbDetector",
    "Detector",
    "Hull",
    "HullDetector",
    "HullRole",
    "HullScene",
    "NoPieces",
    "PrecedenceDetector",
    "Solid",
    "WorldBox",
    "centroid",
    "contact_area",
    "covered",
    "decomposition_of",
    "deepest_within",
    "depths",
    "outermost",
    "polyhedron_of",
    "sweep_hits",
    "world_box",
    "world_boxes",
]
