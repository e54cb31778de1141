from .instance import MOST as MOST
from .instance import NO_ARC as NO_ARC
from .instance import NO_FAMILY as NO_FAMILY
from .instance import JobOrders as JobOrders
from .instance import OrderingInstance as OrderingInstance
from .local_search.iterated_descent import descend_again as descend_again
from .local_search.iterated_descent import note_reversals as note_reversals
from .local_search.ruin_and_recreate import Annealing as Annealing
from .local_search.ruin_and_recreate import build_greedy as build_greedy
from .local_search.ruin_and_recreate import find_followers as find_followers
from .local_search.ruin_and_recreate import find_nearest as find_nearest
from .local_search.ruin_and_recreate import improve as improve
from .parallel_search import Helpers as Helpers
from .portfolio import METHODS as METHODS
from .portfolio import OrderingSearch as OrderingSearch
from .relaxation.branch_and_cut import BranchAndCut as BranchAndCut
from .relaxation.branch_and_cut import tighten as tighten
from .relaxation.cut_relaxation import CutRelaxation as CutRelaxation
from .relaxation.cut_relaxation import Duals as Duals
from .relaxation.cut_relaxation import PairPrices as PairPrices
from .relaxation.cut_relaxation import build_charges as build_charges
from .relaxation.cut_relaxation import repair as repair
from .relaxation.pair_relaxation import PairRelaxation as PairRelaxation
from .relaxation.pair_relaxation import find_open_pairs as find_open_pairs
from .relaxation.pair_relaxation import find_violated_triples as find_violated_triples
from .relaxation.precedence_cuts import count_changes as count_changes
from .relaxation.precedence_cuts import find_set_up_cuts as find_set_up_cuts
from .relaxation.precedence_cuts import propagate as propagate
from .relaxation.precedence_cuts import separate as separate
from .relaxation.precedence_cuts import separate_between as separate_between
from .subsets.two_ended_search import CompletionBounds as CompletionBounds
from .subsets.two_ended_search import TwoEndedSearch as TwoEndedSearch
from .subsets.two_ended_search import run_beam as run_beam
from .subsets.two_ended_search import run_in_parallel as run_in_parallel

__all__ = [
    "METHODS",
    "MOST",
    "NO_ARC",
    "NO_FAMILY",
    "Annealing",
    "BranchAndCut",
    "CompletionBounds",
    "CutRelaxation",
    "Duals",
    "Helpers",
    "JobOrders",
    "OrderingInstance",
    "OrderingSearch",
    "PairPrices",
    "PairRelaxation",
    "TwoEndedSearch",
    "build_charges",
    "build_greedy",
    "count_changes",
    "descend_again",
    "find_followers",
    "find_nearest",
    "find_open_pairs",
    "find_set_up_cuts",
    "find_violated_triples",
    "improve",
    "note_reversals",
    "propagate",
    "repair",
    "run_beam",
    "run_in_parallel",
    "separate",
    "separate_between",
    "tighten",
]
