from .detector_trials import CHART as CHART
from .detector_trials import try_detectors as try_detectors
from .engine_agreement import EngineAgreement as EngineAgreement
from .engine_agreement import compare_engines as compare_engines
from .fault_injection import LEAST_HIT_M as LEAST_HIT_M
from .fault_injection import OBSTACLE as OBSTACLE
from .fault_injection import Truth as Truth
from .fault_injection import injected_collisions as injected_collisions
from .fault_injection import is_possible as is_possible
from .fault_injection import near_misses as near_misses
from .fault_injection import standing_boxes as standing_boxes

__all__ = [
    "CHART",
    "LEAST_HIT_M",
    "OBSTACLE",
    "EngineAgreement",
    "Truth",
    "compare_engines",
    "injected_collisions",
    "is_possible",
    "near_misses",
    "standing_boxes",
    "try_detectors",
]
