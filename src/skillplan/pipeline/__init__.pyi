from . import registry as registry
from .advising import advise as advise
from .advising import list_changes as list_changes
from .certification import certify as certify
from .chain import solve_chain as solve_chain
from .comparison import Terms as Terms
from .comparison import compare_solvers as compare_solvers
from .comparison import rows_in_turn as rows_in_turn
from .comparison import rows_side_by_side as rows_side_by_side
from .examples import list_examples as list_examples
from .examples import read_example as read_example
from .exchange import describe_policy as describe_policy
from .exchange import export_files as export_files
from .exchange import list_notes as list_notes
from .exchange import make_exporter as make_exporter
from .exchange import make_handover as make_handover
from .exchange import read_given_plan as read_given_plan
from .obstacles import preview_problem as preview_problem
from .pareto import solve_front as solve_front
from .performing import choose_variants as choose_variants
from .performing import find_arm_meshes as find_arm_meshes
from .registry import names as names
from .separate_process import GRACE_S as GRACE_S
from .setup import Setup as Setup
from .setup import load_problem as load_problem
from .solving import SearchRequest as SearchRequest
from .solving import describe as describe
from .solving import grade as grade
from .solving import list_solvers as list_solvers
from .solving import make_feasibility as make_feasibility
from .solving import make_model as make_model
from .solving import make_solver as make_solver
from .solving import map_solvers as map_solvers
from .solving import open_warm_cache as open_warm_cache
from .solving import search as search
from .solving import solve as solve

__all__ = [
    "GRACE_S",
    "SearchRequest",
    "Setup",
    "Terms",
    "advise",
    "certify",
    "choose_variants",
    "compare_solvers",
    "describe",
    "describe_policy",
    "export_files",
    "find_arm_meshes",
    "grade",
    "list_changes",
    "list_examples",
    "list_notes",
    "list_solvers",
    "load_problem",
    "make_exporter",
    "make_feasibility",
    "make_handover",
    "make_model",
    "make_solver",
    "map_solvers",
    "names",
    "open_warm_cache",
    "preview_problem",
    "read_example",
    "read_given_plan",
    "registry",
    "rows_in_turn",
    "rows_side_by_side",
    "search",
    "solve",
    "solve_chain",
    "solve_front",
]
