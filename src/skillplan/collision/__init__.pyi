from .aabb import AabbDetector as AabbDetector
from .boxes import WorldBox as WorldBox
from .boxes import centroid as centroid
from .boxes import contact_area as contact_area
from .boxes import sweep_hits as sweep_hits
from .boxes import world_box as world_box
from .boxes import world_boxes as world_boxes
from .decomposition import NoPieces as NoPieces
from .decomposition import decompose as decompose
from .detector import Detector as Detector
from .hulls import Hull as Hull
from .hulls import HullDetector as HullDetector
from .hulls import HullRole as HullRole
from .hulls import HullScene as HullScene
from .precedence import PrecedenceDetector as PrecedenceDetector
from .solid import TOUCH_M as TOUCH_M
from .solid import Solid as Solid
from .solid import measure_union as measure_union
from .stability import StabilityDetector as StabilityDetector
from .standing import TILT_DEG as TILT_DEG
from .standing import Standing as Standing
from .standing import Touch as Touch
from .standing import Weight as Weight
from .standing import compute_margin_m as compute_margin_m
from .standing import decide_standing as decide_standing
from .standing import find_touches as find_touches
from .standing import weigh as weigh
from .surface import make_polyhedron as make_polyhedron
from .surface import measure_deepest as measure_deepest
from .surface import measure_depths as measure_depths
from .surface import measure_outermost as measure_outermost

__all__ = [
    "TILT_DEG",
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
    "StabilityDetector",
    "Standing",
    "Touch",
    "Weight",
    "WorldBox",
    "centroid",
    "compute_margin_m",
    "contact_area",
    "decide_standing",
    "decompose",
    "find_touches",
    "make_polyhedron",
    "measure_deepest",
    "measure_depths",
    "measure_outermost",
    "measure_union",
    "sweep_hits",
    "weigh",
    "world_box",
    "world_boxes",
]
