from .audit import ask_again as ask_again
from .audit import draw_kept as draw_kept
from .audit import draw_reused as draw_reused
from .audit import recheck_kept as recheck_kept
from .check_workers import CheckWorkers as CheckWorkers
from .feasibility import CheckCount as CheckCount
from .feasibility import Feasibility as Feasibility
from .single_check import Checked as Checked
from .single_check import check as check
from .single_check import introduce as introduce
from .variants import list_queried_skills as list_queried_skills
from .verdict_cache import DiskVerdictCache as DiskVerdictCache
from .verdict_cache import VerdictCache as VerdictCache
from .verdict_files import VerdictFolder as VerdictFolder
from .verdict_files import VerdictRecord as VerdictRecord
from .verdict_files import code_origin as code_origin
from .verdict_files import content_hash as content_hash
from .verdict_files import read_record as read_record
from .verdict_files import verdict_key as verdict_key

__all__ = [
    "CheckCount",
    "CheckWorkers",
    "Checked",
    "DiskVerdictCache",
    "Feasibility",
    "VerdictCache",
    "VerdictFolder",
    "VerdictRecord",
    "ask_again",
    "check",
    "code_origin",
    "content_hash",
    "draw_kept",
    "draw_reused",
    "introduce",
    "list_queried_skills",
    "read_record",
    "recheck_kept",
    "verdict_key",
]
