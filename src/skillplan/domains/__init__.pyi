from .domain import Account as Account
from .domain import Domain as Domain
from .domain import Listing as Listing
from .domain import Strict as Strict
from .load import Problem as Problem
from .load import apply_changes as apply_changes
from .load import load_task as load_task

__all__ = [
    "Account",
    "Domain",
    "Listing",
    "Problem",
    "Strict",
    "apply_changes",
    "load_task",
]
