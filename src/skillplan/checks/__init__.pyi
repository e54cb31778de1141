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
from .verdict_files import compute_verdict_key as compute_verdict_key
from .verdict_files import hash_content as hash_content
from .verdict_files import identify_code as identify_code
from .verdict_files import read_record as read_record

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
    "compute_verdict_key",
    "draw_kept",
    "draw_reused",
    "hash_content",
    "identify_code",
    "introduce",
    "list_queried_skills",
    "read_record",
    "recheck_kept",
]
