from .behaviour_tree import PORTS as PORTS
from .behaviour_tree import BehaviourTreeExporter as BehaviourTreeExporter
from .behaviour_tree import escape_text as escape_text
from .behaviour_tree import unescape_text as unescape_text
from .exporter import Exporter as Exporter
from .exporter import Handover as Handover
from .exporter import Identifiers as Identifiers
from .exporter import TrainedPolicy as TrainedPolicy
from .exporter import quote as quote
from .pddl.action_costs import NoActionCosts as NoActionCosts
from .pddl.action_costs import choose_scale as choose_scale
from .pddl.conditions import ConsistentStates as ConsistentStates
from .pddl.exporter import ActionNames as ActionNames
from .pddl.exporter import PddlExporter as PddlExporter
from .pddl.exporter import PlanningTask as PlanningTask
from .plan_files import MAX_BYTES as MAX_BYTES
from .plan_files import read_plan as read_plan
from .plan_table import COLUMNS as COLUMNS
from .plan_table import CsvExporter as CsvExporter
from .plan_table import read_cell as read_cell
from .structured_text import StructuredTextExporter as StructuredTextExporter

__all__ = [
    "COLUMNS",
    "MAX_BYTES",
    "PORTS",
    "ActionNames",
    "BehaviourTreeExporter",
    "ConsistentStates",
    "CsvExporter",
    "Exporter",
    "Handover",
    "Identifiers",
    "NoActionCosts",
    "PddlExporter",
    "PlanningTask",
    "StructuredTextExporter",
    "TrainedPolicy",
    "choose_scale",
    "escape_text",
    "quote",
    "read_cell",
    "read_plan",
    "unescape_text",
]
