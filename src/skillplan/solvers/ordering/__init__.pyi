from .instance import MOST as MOST
from .instance import NO_ARC as NO_ARC
from .instance import NO_FAMILY as NO_FAMILY
from .instance import JobOrders as JobOrders
from .instance import OrderingInstance as OrderingInstance
from .local_search.iterated_descent import descend_again as descend_again
from .local_search.iterated_descent import note_reversals as note_reversals
from .local_search.ruin_and_recreate import Annealing as Annealing
from .local_search.ruin_and_recreate import cheapest_first as cheapest_first
from .local_search.ruin_and_recreate import followers as followers
from .local_search.ruin_and_recreate import improve as improve
from .local_search.ruin_and_recreate import nearest as nearest
from .parallel_search import Helpers as Helpers
from .portfolio import METHODS as METHODS
from .portfolio import OrderingSearch as OrderingSearch
from .relaxation.branch_and_cut import BranchAndCut as BranchAndCut
from .relaxation.branch_and_cut import tighten as tighten
from .relaxation.cut_relaxation import CutRelaxation as CutRelaxation
from .relaxation.cut_relaxation import Duals as Duals
from .relaxation.cut_relaxation import PairPrices as PairPrices
from .relaxation.cut_relaxation import charges_of as charges_of
from .relaxation.cut_relaxation import repaired as repaired
from .relaxation.pair_relaxation import PairRelaxation as PairRelaxation
from .relaxation.pair_relaxation import open_pairs as open_pairs
from .relaxation.pair_relaxation import violated_triples as violated_triples
from .relaxation.precedence_cuts import least_changes as least_changes
from .relaxation.precedence_cuts import propagate as propagate
from .relaxation.precedence_cuts import separate as separate
from .relaxation.precedence_cuts import separate_between as separate_between
from .relaxation.precedence_cuts import set_up_cuts as set_up_cuts
from .subsets.two_ended_search import CompletionBounds as CompletionBounds
from .subsets.two_ended_search import TwoEndedSearch as TwoEndedSearch
from .subsets.two_ended_search import beam as beam
from .subsets.two_ended_search import side_by_side as side_by_side

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
    "beam",
    "charges_of",
    "cheapest_first",
    "descend_again",
    "followers",
    "improve",
    "least_changes",
    "nearest",
    "note_reversals",
    "open_pairs",
    "propagate",
    "repaired",
    "separate",
    "separate_between",
    "set_up_cuts",
    "side_by_side",
    "tighten",
    "violated_triples",
]
