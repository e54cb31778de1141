from .detector_trials import CHART as CHART
from .detector_trials import try_detectors as try_detectors
from .engine_agreement import EngineAgreement as EngineAgreement
from .engine_agreement import compare_engines as compare_engines
from .fault_injection import LEAST_HIT_M as LEAST_HIT_M
from .fault_injection import OBSTACLE as OBSTACLE
from .fault_injection import Truth as Truth
from .fault_injection import find_standing_boxes as find_standing_boxes
from .fault_injection import inject_collisions as inject_collisions
from .fault_injection import inject_near_misses as inject_near_misses
from .fault_injection import is_possible as is_possible

__all__ = [
    "CHART",
    "LEAST_HIT_M",
    "OBSTACLE",
    "EngineAgreement",
    "Truth",
    "compare_engines",
    "find_standing_boxes",
    "inject_collisions",
    "inject_near_misses",
    "is_possible",
    "try_detectors",
]
