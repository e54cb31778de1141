from .domain import Account as Account
from .domain import Domain as Domain
from .domain import Listing as Listing
from .domain import Strict as Strict
from .load import Problem as Problem
from .load import load_task as load_task
from .load import overridden as overridden

__all__ = [
    "Account",
    "Domain",
    "Listing",
    "Problem",
    "Strict",
    "load_task",
    "overridden",
]
