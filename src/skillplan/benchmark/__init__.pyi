from .agents import BASELINES as BASELINES
from .instances import Instance as Instance
from .instances import InstanceFile as InstanceFile
from .instances import format_instances as format_instances
from .instances import hash_instances as hash_instances
from .instances import load_instances as load_instances
from .instances import parse_instances as parse_instances
from .runs import Campaign as Campaign
from .runs import do_runs as do_runs
from .submission import Row as Row
from .submission import Submission as Submission
from .submission import check_rows as check_rows

__all__ = [
    "BASELINES",
    "Campaign",
    "Instance",
    "InstanceFile",
    "Row",
    "Submission",
    "check_rows",
    "do_runs",
    "format_instances",
    "hash_instances",
    "load_instances",
    "parse_instances",
]
