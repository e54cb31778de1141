from . import registry as registry
from .certification import certify as certify
from .chain import solve_chain as solve_chain
from .comparison import Terms as Terms
from .comparison import compare_solvers as compare_solvers
from .comparison import rows_side_by_side as rows_side_by_side
from .comparison import solve_all as solve_all
from .comparison import solve_chain_with_all as solve_chain_with_all
from .exchange import exported as exported
from .exchange import given_plan as given_plan
from .exchange import handed_over as handed_over
from .exchange import make_exporter as make_exporter
from .exchange import notes_of as notes_of
from .obstacles import preview as preview
from .performing import by_ways as by_ways
from .performing import looks_of_arm as looks_of_arm
from .registry import names as names
from .separate_process import GRACE_S as GRACE_S
from .setup import Setup as Setup
from .setup import load_problem as load_problem
from .solving import SearchRequest as SearchRequest
from .solving import describe as describe
from .solving import grade as grade
from .solving import make_feasibility as make_feasibility
from .solving import make_model as make_model
from .solving import make_solver as make_solver
from .solving import solve as solve
from .solving import solver_names as solver_names
from .solving import solvers_by_stage as solvers_by_stage
from .solving import warm_cache as warm_cache

__all__ = [
    "GRACE_S",
    "SearchRequest",
    "Setup",
    "Terms",
    "by_ways",
    "certify",
    "compare_solvers",
    "describe",
    "exported",
    "given_plan",
    "grade",
    "handed_over",
    "load_problem",
    "looks_of_arm",
    "make_exporter",
    "make_feasibility",
    "make_model",
    "make_solver",
    "names",
    "notes_of",
    "preview",
    "registry",
    "rows_side_by_side",
    "solve",
    "solve_all",
    "solve_chain",
    "solve_chain_with_all",
    "solver_names",
    "solvers_by_stage",
    "warm_cache",
]
